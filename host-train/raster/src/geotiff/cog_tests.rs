//! The streaming writer: the file does not depend on how rows arrive, other programs accept it, and no incomplete file remains.

use super::pyramid::halve;
use super::tests::{heights, same_bits, scratch};
use super::*;
use crate::Raster;
use elunar_base::Error;
use elunar_testing::oracle::{rasterio, rasterio_with};
use std::path::Path;
use std::process::Command;

const COMPRESSIONS: [Compression; 4] = [Compression::None, Compression::Lzw, Compression::Deflate, Compression::Zstd];

/// Returns a raster larger than two blocks in each direction, with odd sizes: 3 levels.
fn large() -> Raster {
    let mut raster = heights(1100, 1300);
    (0..1100 * 1300).filter(|i| i % 1300 < 400 && i / 1300 > 900).for_each(|i| raster.samples[i] = f32::NAN);
    raster
}

fn stream(path: &Path, raster: &Raster, options: &WriteOptions, rows_at_once: usize) {
    let mut writer = Writer::create(path, raster.rows, raster.cols, raster.georef.as_ref(), options).unwrap();
    raster.samples.chunks(rows_at_once * raster.cols).for_each(|rows| writer.write_rows(rows).unwrap());
    assert!(!path.exists(), "nothing is there before the end");
    writer.finish().unwrap();
}

#[test]
fn the_file_does_not_depend_on_how_the_rows_come() {
    let folder = scratch();
    let (raster, options) = (large(), WriteOptions::heights("t"));
    write(&folder.path().join("whole.tif"), &raster, &options).unwrap();
    let whole = std::fs::read(folder.path().join("whole.tif")).unwrap();
    for rows_at_once in [1, 37, 512, 1024] {
        let path = folder.path().join(format!("{rows_at_once}.tif"));
        stream(&path, &raster, &options, rows_at_once);
        assert!(std::fs::read(path).unwrap() == whole, "{rows_at_once} rows at once");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 5, "no temporary file is left");
}

#[test]
fn the_file_does_not_depend_on_the_number_of_threads() {
    let folder = scratch();
    let (raster, options) = (large(), WriteOptions::heights("t").with_band("second", None));
    let made: Vec<Vec<u8>> = [1, 2, 16]
        .into_iter()
        .map(|threads| {
            let path = folder.path().join(format!("{threads}.tif"));
            // Sixteen threads wait for 32 blocks, which is more than a band has.
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
                let mut writer =
                    Writer::create(&path, raster.rows, raster.cols, raster.georef.as_ref(), &options).unwrap();
                for rows in raster.samples.chunks(37 * raster.cols) {
                    writer.write_band_rows(1, rows).unwrap();
                    writer.write_band_rows(0, rows).unwrap();
                }
                writer.finish().unwrap();
            });
            std::fs::read(&path).unwrap()
        })
        .collect();
    assert!(made[0] == made[1] && made[0] == made[2]);
}

#[test]
fn every_compression_comes_back_bit_for_bit() {
    let folder = scratch();
    let raster = large();
    for compression in COMPRESSIONS {
        for force_big in [false, true] {
            let path = folder.path().join("a.tif");
            let mut options = WriteOptions::heights("t").with_compression(compression);
            options.force_big = force_big;
            write(&path, &raster, &options).unwrap();
            let back = read(&path).unwrap();
            assert!(same_bits(&back.samples, &raster.samples) && back.georef == raster.georef, "{compression:?}");
        }
        let mut image = heights(600, 70);
        image.samples.iter_mut().enumerate().for_each(|(i, v)| *v = (i * 7919 % 65536) as f32);
        let path = folder.path().join("i.tif");
        let options = WriteOptions::image(SampleType::U16, "i").with_compression(compression).without_gaps();
        write(&path, &image, &options).unwrap();
        assert_eq!(read(&path).unwrap().samples, image.samples, "{compression:?}");
    }
}

#[test]
fn wrong_amounts_of_rows_leave_no_file() {
    let folder = scratch();
    let path = folder.path().join("a.tif");
    let options = WriteOptions::heights("t");
    let create = || Writer::create(&path, 10, 4, None, &options).unwrap();
    let refused = |result: elunar_base::Result<()>| {
        let error = result.unwrap_err();
        assert!(matches!(error, Error::Usage(_)) && error.to_string().contains("a.tif"), "{error}");
    };
    refused(create().write_rows(&[0.0; 6]));
    refused(create().write_rows(&[0.0; 44]));
    let mut short = create();
    short.write_rows(&[0.0; 36]).unwrap();
    refused(short.finish());
    let mut full = create();
    full.write_rows(&[0.0; 40]).unwrap();
    full.write_rows(&[]).unwrap();
    refused(full.write_rows(&[0.0; 4]));
    drop(full);
    let mut whole =
        Writer::create(&path, 1, 1, None, &WriteOptions::image(SampleType::U8, "x").without_gaps()).unwrap();
    refused(whole.write_rows(&[f32::NAN]));
    refused(whole.write_rows(&[256.0]));
    assert!(Writer::create(&path, 0, 4, None, &options).is_err());
    assert!(Writer::create(folder.path(), 4, 4, None, &options).is_err());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn an_old_file_stays_until_the_new_one_is_whole() {
    let folder = scratch();
    let path = folder.path().join("a.tif");
    std::fs::write(&path, "old").unwrap();
    let mut writer = Writer::create(&path, 10, 4, None, &WriteOptions::heights("t")).unwrap();
    writer.write_rows(&[1.0; 20]).unwrap();
    drop(writer);
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// GDAL reads every compression and type bit for bit, rio-cogeo accepts the file, and each overview holds the means of valid samples.
#[test]
fn others_accept_our_files() {
    let folder = scratch();
    let raster = large();
    for compression in COMPRESSIONS {
        let mut options = WriteOptions::heights("h").with_compression(compression).with_item("MODEL", "m");
        write(&folder.path().join(format!("{compression:?}.tif")), &raster, &options).unwrap();
        options.force_big = true;
        write(&folder.path().join(format!("{compression:?}Big.tif")), &raster, &options).unwrap();
    }
    let mut image = large();
    image.samples.iter_mut().for_each(|v| *v = (*v + 3200.0) / 10.0 - 6.0);
    write(&folder.path().join("U8.tif"), &image, &WriteOptions::image(SampleType::U8, "i")).unwrap();
    write(&folder.path().join("U16.tif"), &image, &WriteOptions::image(SampleType::U16, "i")).unwrap();
    write(&folder.path().join("Small.tif"), &heights(3, 5), &WriteOptions::heights("s")).unwrap();
    let script = "
import glob
from rio_cogeo.cogeo import cog_validate
names = glob.glob('*.tif')
for name in names:
    valid, errors, warnings = cog_validate(name, strict=True, quiet=True)
    assert valid and not errors and not warnings, (name, errors, warnings)
print(len(names))
";
    if let Some(validated) = rasterio_with(&["rio_cogeo"], script, folder.path()) {
        assert_eq!(validated.trim(), "11");
    }
    let script = "
import glob
for name in glob.glob('*.tif'):
    d = rasterio.open(name)
    if d.width < 512: continue
    assert d.overviews(1) == [2, 4] and d.profile['tiled'] and d.block_shapes == [(512, 512)], (name, d.profile, d.overviews(1))
    assert d.tags(ns='IMAGE_STRUCTURE').get('LAYOUT') in (None, 'COG')
    d.read(1).astype('f4').tofile(name + '.raw')
    for level in (0, 1):
        with rasterio.open(name, overview_level=level) as o:
            assert o.nodata == d.nodata
            o.read(1).astype('f4').tofile(f'{name}.{level}.raw')
";
    if rasterio(script, folder.path()).is_none() {
        return;
    }
    let raw = |name: String| -> Vec<f32> {
        let bytes = std::fs::read(folder.path().join(name)).expect("what the script left");
        bytes.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect()
    };
    let gap = |value: &f32, gap: f32| if value.is_nan() { gap } else { *value };
    let half = halve(&raster.samples, 1300);
    let quarter = halve(&half, 650);
    for compression in COMPRESSIONS {
        for name in [format!("{compression:?}.tif"), format!("{compression:?}Big.tif")] {
            for (file, level) in [("raw", &raster.samples), ("0.raw", &half), ("1.raw", &quarter)] {
                let expected: Vec<f32> = level.iter().map(|v| gap(v, NODATA)).collect();
                assert!(same_bits(&raw(format!("{name}.{file}")), &expected), "{name} {file}");
            }
        }
    }
    let expected: Vec<f32> = image.samples.iter().map(|v| gap(v, 0.0).round()).collect();
    assert!(raw("U16.tif.raw".into()) == expected && raw("U8.tif.raw".into()) == expected);
}

const CHILD_FOLDER: &str = "ELUNAR_TEST_FULL_DISK";

/// The test runner does not start this test directly. The test below starts it in a separate process under a limit on file sizes, and
/// checks what it leaves behind.
#[test]
#[ignore = "run by a_full_disk_leaves_nothing_behind"]
fn child_writing_to_a_full_disk() {
    let folder = std::env::var(CHILD_FOLDER).expect("the parent's folder");
    let options = WriteOptions::heights("t").with_compression(Compression::None);
    let error = write(&Path::new(&folder).join("a.tif"), &large(), &options).unwrap_err();
    println!("ERROR: {error}");
    assert!(matches!(error, Error::Io { .. }), "{error}");
}

/// A disk without room, simulated by a limit on file sizes. Below the blocks' size the spill fails, just above it the final file fails.
#[test]
#[cfg(unix)]
fn a_full_disk_leaves_nothing_behind() {
    let folder = scratch();
    // Nine, four and one blocks, the last just large enough for its level. The spill fits into this size, the file with its head does not.
    let spill_kib = (13 * 512 * 512 + 288 * 336) * 4 / 1024;
    for kib in [64, spill_kib] {
        let command = format!("ulimit -f {kib} && trap '' XFSZ && exec \"$0\" \"$@\"");
        let test = "geotiff::cog_tests::child_writing_to_a_full_disk";
        let out = Command::new("bash")
            .args(["-c", &command])
            .arg(std::env::current_exe().unwrap())
            .args(["--exact", test, "--ignored", "--nocapture"])
            .env(CHILD_FOLDER, folder.path())
            .output()
            .expect("bash");
        let text = String::from_utf8_lossy(&out.stdout);
        println!("{text}");
        assert!(out.status.success() && text.contains("1 passed") && text.contains("a.tif"), "{kib} KiB: {text}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "{kib} KiB");
    }
}
