//! Files that were written are read, and broken files are refused.

use super::*;
use crate::{Crs, GeoRef, Raster, source};
use elunar_base::Error;
use elunar_core::sun::Body;
use std::path::{Path, PathBuf};

pub(super) fn scratch() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Returns heights with gaps, many digits and a georeference, in odd sizes.
pub(super) fn heights(rows: usize, cols: usize) -> Raster {
    let mut samples: Vec<f32> = (0..rows * cols).map(|i| (i as f32 * 0.37).sin() * 1234.567 - 1900.0).collect();
    samples[rows * cols / 2] = f32::NAN;
    let georef = GeoRef {
        transform: [349_000.25, 2.0, 0.0, 600_000.5, 0.0, -2.5],
        crs: Crs::equirectangular(Body::Moon.radius_m(), 12.0, 180.0),
    };
    Raster { rows, cols, samples, georef: Some(georef) }
}

pub(super) fn same_bits(a: &[f32], b: &[f32]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a.is_nan() && b.is_nan()) || a.to_bits() == b.to_bits())
}

fn written(folder: &Path, raster: &Raster, options: &WriteOptions) -> PathBuf {
    let path = folder.join("a.tif");
    write(&path, raster, options).unwrap();
    path
}

#[test]
fn heights_come_back_bit_for_bit() {
    let folder = scratch();
    for (rows, cols) in [(1, 1), (5, 700), (300, 270), (256, 512)] {
        let raster = heights(rows, cols);
        let back = read(written(folder.path(), &raster, &WriteOptions::heights("test"))).unwrap();
        assert_eq!((back.rows, back.cols, &back.georef), (rows, cols, &raster.georef));
        assert!(same_bits(&back.samples, &raster.samples), "{rows} x {cols}");
    }
}

#[test]
fn images_come_back_rounded() {
    let folder = scratch();
    let mut raster = heights(40, 33);
    for (sample, highest) in [(SampleType::U8, 255.0), (SampleType::U16, 65535.0)] {
        raster.samples = (0..40 * 33).map(|i| i as f32 * highest / (40.0 * 33.0 - 1.0)).collect();
        let back = read(written(folder.path(), &raster, &WriteOptions::image(sample, "image"))).unwrap();
        let rounded: Vec<f32> = raster.samples.iter().map(|v| v.round()).collect();
        assert_eq!(back.samples, rounded);
        raster.samples[7] = f32::NAN;
        let back = read(written(folder.path(), &raster, &WriteOptions::image(sample, "image"))).unwrap();
        assert!(back.samples[7].is_nan(), "gaps survive");
        assert_eq!(back.samples[0], 1.0, "a valid zero is not turned into a gap");
        assert_eq!(back.valid_count(), 40 * 33 - 1);
    }
    raster.samples[3] = -2.0;
    let path = folder.path().join("b.tif");
    let error = write(&path, &raster, &WriteOptions::image(SampleType::U8, "x")).unwrap_err();
    assert!(matches!(error, Error::Usage(_)) && !path.exists(), "{error}");
}

#[test]
fn every_kind_of_transform_survives() {
    let folder = scratch();
    let mut raster = heights(20, 30);
    for transform in [
        [5.0, 1.5, 0.25, -7.0, 0.5, -2.0],
        [5.0, 1.5, 0.0, -7.0, 0.5, -2.0],
        [5.0, -1.5, 0.0, -7.0, 0.0, -2.0],
        [5.0, 2.0, 0.0, 9.0, 0.0, 2.0],
    ] {
        raster.georef = Some(GeoRef { transform, crs: Crs::polar(Body::Moon.radius_m(), true) });
        let back = read(written(folder.path(), &raster, &WriteOptions::heights("t"))).unwrap();
        assert_eq!(back.georef, raster.georef);
    }
    // Without a system, and with one of a single key.
    let keys = Crs { directory: vec![1, 1, 0, 1, 1024, 0, 1, 1], ..Crs::default() };
    for crs in [Crs::default(), keys] {
        raster.georef = Some(GeoRef { transform: [0.0, 1.0, 0.0, 0.0, 0.0, -1.0], crs });
        assert_eq!(read(written(folder.path(), &raster, &WriteOptions::heights("t"))).unwrap().georef, raster.georef);
    }
    raster.georef = None;
    assert_eq!(read(written(folder.path(), &raster, &WriteOptions::heights("t"))).unwrap().georef, None);
}

#[test]
fn pixel_is_point_files_are_moved_to_corners_and_back() {
    let folder = scratch();
    let mut raster = heights(20, 30);
    let georef = raster.georef.as_mut().unwrap();
    // Key 1025 is the second of the directory. Its value is the last number of the entry.
    assert_eq!(georef.crs.directory[8], 1025);
    georef.crs.directory[11] = 2;
    let back = read(written(folder.path(), &raster, &WriteOptions::heights("t"))).unwrap();
    assert_eq!(back.georef, raster.georef);
}

#[test]
fn the_nodata_value_is_isis_null() {
    assert_eq!(NODATA_TEXT.parse::<f64>().unwrap() as f32, NODATA);
    assert_eq!(NODATA.to_bits(), 0xFF7F_FFFB);
}

#[test]
fn big_files_are_big_tiff() {
    let raster = heights(60, 50);
    let folder = scratch();
    let options = WriteOptions { force_big: true, ..WriteOptions::heights("big") };
    let path = written(folder.path(), &raster, &options);
    assert_eq!(std::fs::read(&path).unwrap()[2..4], [43, 0], "BigTIFF signature");
    let back = read(&path).unwrap();
    assert!(same_bits(&back.samples, &raster.samples) && back.georef == raster.georef);
}

#[test]
fn truncated_files_are_refused_at_every_length() {
    let folder = scratch();
    let bytes = std::fs::read(written(folder.path(), &heights(40, 30), &WriteOptions::heights("t"))).unwrap();
    let path = folder.path().join("cut.tif");
    for length in (0..bytes.len()).step_by(7) {
        std::fs::write(&path, &bytes[..length]).unwrap();
        let error = read(&path).expect_err("a cut file");
        assert!(matches!(error, Error::Broken { .. } | Error::Unsupported { .. }), "{length}: {error}");
        assert!(error.to_string().contains("cut.tif"));
    }
}

#[test]
fn flipped_bytes_never_panic() {
    let folder = scratch();
    let bytes = std::fs::read(written(folder.path(), &heights(20, 17), &WriteOptions::heights("t"))).unwrap();
    let path = folder.path().join("flip.tif");
    let mut refused = 0;
    for at in 0..bytes.len() {
        for mask in [0x01, 0x80, 0xFF] {
            let mut bytes = bytes.clone();
            bytes[at] ^= mask;
            std::fs::write(&path, &bytes).unwrap();
            refused += usize::from(read(&path).is_err());
        }
    }
    assert!(refused > bytes.len() / 2, "{refused} of {} flips refused", 3 * bytes.len());
}

#[test]
fn a_small_file_cannot_claim_a_huge_raster() {
    let folder = scratch();
    let mut bytes = std::fs::read(written(folder.path(), &heights(40, 30), &WriteOptions::heights("t"))).unwrap();
    // The directory entries of width (256) and tile width (322), type 4 (u32), count 1, then the value.
    for tag in [256_u16, 257, 322, 323] {
        let entry = [tag.to_le_bytes().as_slice(), &4_u16.to_le_bytes(), &1_u32.to_le_bytes()].concat();
        let at = bytes.windows(8).position(|window| window == entry).expect("the entry") + 8;
        bytes[at..at + 4].copy_from_slice(&1_000_000_u32.to_le_bytes());
    }
    let path = folder.path().join("bomb.tif");
    std::fs::write(&path, &bytes).unwrap();
    let error = read(&path).unwrap_err().to_string();
    assert!(error.contains("cannot hold"), "{error}");
}

#[test]
fn missing_files_and_folders_are_named() {
    let folder = scratch();
    let error = read(folder.path().join("none.tif")).unwrap_err();
    assert!(matches!(error, Error::Io { .. }) && error.to_string().contains("none.tif"), "{error}");
    assert!(read(folder.path()).is_err());
    let error = write(&folder.path().join("no/such/a.tif"), &heights(4, 4), &WriteOptions::heights("t")).unwrap_err();
    assert!(matches!(error, Error::Io { .. }), "{error}");
    std::fs::write(folder.path().join("text.tif"), "not a tiff").unwrap();
    assert!(matches!(read(folder.path().join("text.tif")).unwrap_err(), Error::Broken { .. }));
}

#[test]
fn a_users_nodata_value_counts_as_the_tags_does() {
    let folder = scratch();
    let mut raster = heights(40, 30);
    // A tenth is not an `f32`, and the first gap has the tag's value.
    for (at, value) in [(3, -9999.0), (77, -9999.0), (78, 0.1), (79, 0.0)] {
        raster.samples[at] = value;
    }
    let path = written(folder.path(), &raster, &WriteOptions::heights("t"));
    let with = |nodata: Option<f64>| source::read_all(&*source::open_with(&path, nodata).unwrap()).unwrap().samples;
    let voids = |samples: &[f32]| (0..samples.len()).filter(|&i| samples[i].is_nan()).collect::<Vec<_>>();
    assert!(same_bits(&with(None), &raster.samples));
    assert_eq!(voids(&with(Some(-9999.0))), [3, 77, 600]);
    assert_eq!(voids(&with(Some(0.1))), [78, 600]);
    assert_eq!(voids(&with(Some(f64::NAN))), [600]);
    // It is compared with the stored number: these are kilometres.
    let mut options = WriteOptions::heights("t");
    options.unit = Some("km".into());
    let path = written(folder.path(), &raster, &options);
    let read = source::read_all(&*source::open_with(&path, Some(-9999.0)).unwrap()).unwrap().samples;
    assert!(voids(&read) == [3, 77, 600] && (read[0] - 1000.0 * raster.samples[0]).abs() < 1.0);
    // The same with integers, whose files have no tag if they have no gap.
    let grey = Raster { samples: (0..20).map(|i| (i % 5) as f32).collect(), rows: 4, cols: 5, georef: None };
    let path = written(folder.path(), &grey, &WriteOptions::image(SampleType::U8, "t"));
    let read = source::read_all(&*source::open_with(&path, Some(0.0)).unwrap()).unwrap().samples;
    assert_eq!(voids(&read), [0, 5, 10, 15]);
}

#[test]
fn the_sun_of_an_image_is_read_as_it_was_written() {
    let folder = scratch();
    let sun = |options: &WriteOptions| {
        let path = written(folder.path(), &heights(4, 4), options);
        let found = source::open(&path).unwrap().info().sun;
        (found.azimuth_deg, found.elevation_deg)
    };
    let plain = WriteOptions::heights("t");
    assert_eq!(sun(&plain), (None, None));
    assert_eq!(sun(&plain.clone().with_sun(Some(312.5), Some(31.25))), (Some(312.5), Some(31.25)));
    assert_eq!(sun(&plain.clone().with_sun(None, Some(31.0))), (None, Some(31.0)));
    let (azimuth_deg, _) = sun(&plain.with_item("SUN_AZIMUTH_DEG", "north"));
    assert!(azimuth_deg.unwrap().is_nan(), "something else than a number");
}

#[test]
fn items_are_read_by_their_name() {
    let folder = scratch();
    let bare = WriteOptions { unit: None, description: None, ..WriteOptions::heights("t") };
    let path = written(folder.path(), &heights(4, 4), &bare.clone().with_item("A", "first").with_item("MODEL", "nano"));
    assert_eq!(read_item(&path, "MODEL").unwrap().as_deref(), Some("nano"));
    assert_eq!(read_item(&path, "model").unwrap(), None);
    let described = written(folder.path(), &heights(4, 4), &WriteOptions::heights("t"));
    assert_eq!(read_item(&described, "DESCRIPTION").unwrap(), None, "that is of the band");
    assert_eq!(read_item(&written(folder.path(), &heights(4, 4), &bare), "MODEL").unwrap(), None);
}

#[test]
fn sizes_that_no_file_has_are_refused() {
    let folder = scratch();
    let path = folder.path().join("a.tif");
    let options = WriteOptions::heights("t");
    for (rows, cols) in [(0, 4), (4, 0), (1 << 31, 4), (4, 1 << 31)] {
        let text = Writer::create(&path, rows, cols, None, &options).unwrap_err().to_string();
        assert!(text.contains(&format!("sides of 1 to 2147483647 pixels expected, {rows} x {cols} found")), "{text}");
    }
    let text = write(&path, &Raster { rows: 5, ..heights(4, 4) }, &options).unwrap_err().to_string();
    assert!(text.contains("a.tif: 5 x 4 pixels expected, 16 samples found") && !path.exists(), "{text}");
}
