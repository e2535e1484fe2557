//! Whole preparations of synthetic scenes.

use super::list::SceneFiles;
use super::manifest::{MANIFEST, Reason};
use super::*;
use crate::prepared::PreparedSource;
use crate::source::{DataSpec, TileSource};
use elunar_base::progress::Bar;
use elunar_base::{Error, atomic_write};
use elunar_core::sun::Body;
use elunar_raster::Raster;
use elunar_raster::geotiff::{self, SampleType, WriteOptions};
use elunar_synth::{Moon, SynthOptions, SynthScene};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn scene(index: u64, rows: usize, cols: usize) -> SynthScene {
    Moon::new(21, SynthOptions::default()).unwrap().scene(index, rows, cols).unwrap()
}

/// Writes a scene as a separate site. `spoil` changes its maps first.
fn files(folder: &Path, scene: &SynthScene, spoil: impl Fn(&mut Raster, &mut Raster)) -> SceneFiles {
    let (mut image, mut truth) = (scene.image_raster(), scene.truth_raster());
    spoil(&mut image, &mut truth);
    let path = |what: &str| folder.join(format!("{}_{what}.tif", scene.index));
    geotiff::write(&path("image"), &image, &WriteOptions::image(SampleType::U16, "image")).unwrap();
    geotiff::write(&path("truth"), &truth, &WriteOptions::heights("truth")).unwrap();
    geotiff::write(&path("coarse"), &scene.coarse_raster(), &WriteOptions::heights("coarse")).unwrap();
    SceneFiles {
        image: path("image"),
        dtm: path("truth"),
        coarse: path("coarse"),
        site: format!("site {}", scene.index),
        sun_azimuth_deg: Some(scene.sun_azimuth_deg),
        sun_elevation_deg: Some(scene.sun_elevation_deg),
    }
}

fn prepared(
    scenes: &[SceneFiles],
    out: &Path,
    parameters: &PrepareOptions,
) -> elunar_base::Result<TrainingSetManifest> {
    run(scenes, out, parameters, &Bar::hidden())
}

fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let files = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    files.filter(|p| p.is_file()).map(|p| (p.file_name().unwrap().into(), std::fs::read(&p).unwrap())).collect()
}

#[test]
fn a_set_is_made_read_and_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let scenes: Vec<SceneFiles> = (0..4).map(|k| files(folder.path(), &scene(k, 520, 650), |_, _| {})).collect();
    let parameters = PrepareOptions { shard_tiles: 3, shares: [0.5, 0.25, 0.25], ..PrepareOptions::default() };
    let out = folder.path().join("tiles");
    let made = prepared(&scenes, &out, &parameters).unwrap();
    assert_eq!((made.tiles, made.scenes.len()), (16, 4));
    assert_eq!(made.kept + made.dropped.values().sum::<usize>(), 16);
    assert!(made.kept >= 12, "{made:?}");
    assert_eq!(TrainingSetManifest::find(&out).unwrap().as_ref(), Some(&made));
    assert!(!out.join("unfinished").exists());
    for name in ["contact_sheet.png", "relief.png", "relief_difference.png"] {
        assert!(image::open(out.join(name)).unwrap().width() > 400, "{name}");
    }
    // Sites stay whole, and every tile is in a split.
    let sites: Vec<&String> = made.splits.values().flat_map(|s| &s.sites).collect();
    let mut distinct = sites.clone();
    distinct.sort();
    distinct.dedup();
    assert_eq!((sites.len(), distinct.len()), (4, 4));
    let mut tiles = 0;
    for (split, record) in &made.splits {
        let source = PreparedSource::open(&out, *split).unwrap();
        assert_eq!((source.count().unwrap(), record.shards.len()), (record.tiles, record.tiles.div_ceil(3)));
        tiles += source.count().unwrap();
    }
    assert_eq!(tiles, made.kept);
    // A tile holds the rasters' samples.
    let source = PreparedSource::open(&out, Split::Train).unwrap();
    let images: Vec<Raster> = scenes.iter().map(|s| geotiff::read(&s.image).unwrap()).collect();
    for index in 0..source.count().unwrap() as u64 {
        let tile = source.tile(index).unwrap();
        let found = images.iter().any(|image| {
            (0..4).any(|k| {
                let first = (k / 2 * 256 + 100) * image.cols + k % 2 * 320 + 7;
                image.samples[first..first + 300] == tile.image[100 * 320 + 7..100 * 320 + 307]
            })
        });
        assert!(found, "tile {index}");
        assert_eq!(tile.pixel_m, 2.0);
        assert!(
            (tile.coarse_px - 29.6).abs() < 0.1 && tile.sun.azimuth_deg.is_some() && tile.sun.elevation_deg.is_some()
        );
    }
    // Every pass has all tiles, in a different order. Training recognises the folder by its content.
    let DataSpec::Prepared { split: Split::Train, .. } = DataSpec::parse(Some(out.clone()), 0, Split::Train).unwrap()
    else {
        panic!("a prepared folder")
    };
    let pass = |p: u64| -> Vec<u32> {
        (0..source.count().unwrap() as u64)
            .map(|i| source.tile(p * source.count().unwrap() as u64 + i).unwrap().truth_m[0].to_bits())
            .collect()
    };
    let (mut first, mut second) = (pass(0), pass(1));
    assert_ne!(first, second);
    first.sort_unstable();
    second.sort_unstable();
    assert_eq!(first, second);
    // A second run gives the same bytes.
    let again = folder.path().join("again");
    prepared(&scenes, &again, &parameters).unwrap();
    assert_eq!(contents(&out), contents(&again));
}

#[test]
fn a_finished_set_is_verified_and_never_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let scenes = vec![files(folder.path(), &scene(0, 520, 650), |_, _| {})];
    let parameters = PrepareOptions { shard_tiles: 1, shares: [1.0, 0.0, 0.0], ..PrepareOptions::default() };
    let out = folder.path().join("out");
    let made = prepared(&scenes, &out, &parameters).unwrap();
    let bytes = contents(&out);
    // A run that was killed after its manifest.
    std::fs::create_dir(out.join("unfinished")).unwrap();
    std::fs::write(out.join("unfinished/plan"), "any").unwrap();
    let list = std::fs::read_to_string(out.join("prepare.files")).unwrap();
    std::fs::write(out.join("prepare.files"), format!("{list}unfinished/\nunfinished/plan\n")).unwrap();
    assert_eq!(prepared(&scenes, &out, &parameters).unwrap(), made);
    assert_eq!(contents(&out), bytes);
    // The same content under another name counts as the same.
    let moved = folder.path().join("moved.tif");
    std::fs::copy(&scenes[0].image, &moved).unwrap();
    let renamed = vec![SceneFiles { image: moved, ..scenes[0].clone() }];
    assert_eq!(prepared(&renamed, &out, &parameters).unwrap(), made);
    let refused = |scenes: &[SceneFiles], parameters: &PrepareOptions, what: &str| {
        let error = prepared(scenes, &out, parameters).unwrap_err();
        assert!(matches!(error, Error::Input(_) | Error::Broken { .. }), "{error}");
        assert!(error.to_string().contains(what), "{error}");
    };
    refused(&scenes, &PrepareOptions { seed: 1, ..parameters.clone() }, "a finished set with other options found");
    refused(&[scenes.clone(), scenes.clone()].concat(), &parameters, "of 1 scenes instead of 2");
    let turned = vec![SceneFiles { sun_azimuth_deg: Some(12.0), ..scenes[0].clone() }];
    refused(&turned, &parameters, "with another site or Sun of");
    for deg in [f64::NAN, -1.0, 1e300, 89.9999999] {
        let sun = vec![SceneFiles { sun_elevation_deg: Some(deg), ..scenes[0].clone() }];
        let error = prepared(&sun, &folder.path().join("no"), &parameters).unwrap_err();
        assert!(matches!(error, Error::Usage(_)) && error.to_string().contains("below 90 degrees expected"), "{error}");
        assert!(!folder.path().join("no").exists());
    }
    let swapped = vec![SceneFiles { image: scenes[0].dtm.clone(), ..scenes[0].clone() }];
    refused(&swapped, &parameters, "of another ");
    assert_eq!(contents(&out), bytes);
    let shard = out.join("train-00000.safetensors");
    let mut cut = std::fs::read(&shard).unwrap();
    cut.pop();
    std::fs::write(&shard, cut).unwrap();
    refused(&scenes, &parameters, "the bytes that manifest.json names expected");
    std::fs::write(out.join(MANIFEST), "{}").unwrap();
    refused(&scenes, &parameters, "a finished set of another program found");
}

#[test]
fn an_unfinished_set_is_finished_and_another_plan_starts_afresh() {
    let folder = tempfile::tempdir().unwrap();
    let scenes: Vec<SceneFiles> = (0..2).map(|k| files(folder.path(), &scene(k, 520, 650), |_, _| {})).collect();
    let parameters = PrepareOptions { shard_tiles: 1, shares: [0.5, 0.0, 0.5], ..PrepareOptions::default() };
    let whole = folder.path().join("whole");
    let made = prepared(&scenes, &whole, &parameters).unwrap();
    assert!(made.divided_by.contains("blocks of the map"), "{}", made.divided_by);
    let out = folder.path().join("out");
    prepared(&scenes, &out, &parameters).unwrap();
    // The state after a kill: notes, some shards, no manifest.
    let again = || std::fs::remove_file(out.join(MANIFEST)).unwrap();
    again();
    std::fs::remove_file(out.join("train-00000.safetensors")).unwrap();
    assert_eq!(prepared(&scenes, &out, &parameters).unwrap(), made);
    assert_eq!(contents(&out), contents(&whole));
    again();
    let other = prepared(&scenes, &out, &PrepareOptions { shares: [1.0, 0.0, 0.0], ..parameters.clone() }).unwrap();
    assert_eq!(other.splits[&Split::Train].tiles, other.kept);
    assert!(!out.join("test-00000.safetensors").exists(), "shards of the other plan are gone");
}

#[test]
fn what_cannot_teach_is_dropped_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let (rows, cols) = (512, 960);
    // There are six tiles; 0 to 3 are spoilt.
    let spoilt = scene(3, rows, cols);
    let spoil = |image: &mut Raster, truth: &mut Raster| {
        let fill = |tile: usize, of: &mut dyn FnMut(&mut f32, usize, usize), map: &mut Raster| {
            for r in 0..256 {
                for c in 0..320 {
                    of(&mut map.samples[(tile / 3 * 256 + r) * cols + tile % 3 * 320 + c], r, c);
                }
            }
        };
        fill(
            0,
            &mut |v, r, c| {
                if (r, c) == (9, 9) {
                    *v = f32::NAN
                }
            },
            image,
        );
        fill(1, &mut |v, _, _| *v = 500.0, image);
        fill(
            2,
            &mut |v, r, _| {
                if r < 20 {
                    *v = 60_000.0
                }
            },
            image,
        );
        fill(3, &mut |v, _, _| *v = -1900.0, truth);
    };
    let scenes = [files(folder.path(), &spoilt, spoil)];
    let made = prepared(&scenes, &folder.path().join("out"), &PrepareOptions::default()).unwrap();
    let expected = [(Reason::Nulls, 1), (Reason::ConstantImage, 1), (Reason::SaturatedImage, 1), (Reason::NoRelief, 1)];
    assert_eq!(made.dropped, expected.into_iter().collect(), "{made:?}");
    assert_eq!((made.kept, made.scenes[0].kept), (2, 2));
}

#[test]
fn displaced_dtms_are_measured_and_dropped() {
    let folder = tempfile::tempdir().unwrap();
    let (down, right) = (3.4, -2.7);
    let displace = |_: &mut Raster, truth: &mut Raster| {
        let t = &mut truth.georef.as_mut().unwrap().transform;
        t[0] += right * t[1];
        t[3] += down * t[5];
    };
    let good = files(folder.path(), &scene(0, 540, 690), |_, _| {});
    let off = files(folder.path(), &scene(1, 540, 690), displace);
    // The Sun is estimated, not given.
    let off = SceneFiles { sun_azimuth_deg: None, sun_elevation_deg: None, ..off };
    let made = prepared(&[good, off], &folder.path().join("out"), &PrepareOptions::default()).unwrap();
    let [good, off] = [&made.scenes[0], &made.scenes[1]];
    assert!(good.kept > 0 && !good.dropped.contains_key(&Reason::Offset), "{good:?}");
    let [rows_px, cols_px] = off.offset_px.unwrap();
    assert!((rows_px - down).abs() < 0.1 && (cols_px - right).abs() < 0.1, "{rows_px} {cols_px}");
    assert!(off.dropped[&Reason::Offset] + off.dropped.get(&Reason::Nulls).unwrap_or(&0) == 4, "{off:?}");
}

/// The coarse DTM is in degrees, the image in metres. The tiles nearly equal those of a coarse DTM in metres.
#[test]
fn systems_may_differ() {
    use elunar_raster::align::{Interpolation, Named, onto};
    use elunar_raster::{Crs, GeoRef};
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(6, 256, 640);
    let plain = files(folder.path(), &scene, |_, _| {});
    let coarse = scene.coarse_raster();
    let [x0, step, _, y0, _, _] = coarse.georef.as_ref().unwrap().transform;
    let degrees = 1.0 / Body::Moon.radius_m().to_radians();
    // A fourth of the pixel, so that the second interpolation adds little error.
    let fine = 0.25 * step * degrees;
    let transform = [x0 * degrees, fine, 0.0, y0 * degrees, 0.0, -fine];
    let georef = Some(GeoRef { transform, crs: Crs::parse("IAU_2015:30100").unwrap() });
    let (rows, cols) = (4 * coarse.rows, 4 * coarse.cols);
    let target = Raster { rows, cols, samples: vec![0.0; rows * cols], georef };
    let turned = onto(Named::new("coarse", &coarse), Named::new("degrees", &target), Interpolation::Bicubic).unwrap();
    let path = folder.path().join("degrees.tif");
    geotiff::write(&path, &turned, &WriteOptions::heights("coarse")).unwrap();
    let made = [("a", plain.clone()), ("b", SceneFiles { coarse: path, ..plain })].map(|(out, files)| {
        let out = folder.path().join(out);
        prepared(&[files], &out, &PrepareOptions { shares: [1.0, 0.0, 0.0], ..PrepareOptions::default() }).unwrap();
        PreparedSource::open(&out, Split::Train).unwrap()
    });
    assert_eq!((made[0].count(), made[1].count()), (Some(2), Some(2)));
    for index in 0..2 {
        let [a, b] = [0, 1].map(|k| made[k].tile(index).unwrap());
        let largest = a.coarse_m.iter().zip(&b.coarse_m).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let relief = elunar_raster::Raster { rows: 256, cols: 320, samples: a.coarse_m, georef: None }.range().unwrap();
        assert!(largest < 0.02 * (relief.1 - relief.0), "{largest} m of {relief:?}");
        assert!((b.coarse_px - a.coarse_px / 4.0).abs() < 0.05 && a.image == b.image && a.truth_m == b.truth_m);
    }
}

#[test]
fn kilometres_are_suspected_and_can_be_stated() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(4, 256, 320);
    let plain = files(folder.path(), &scene, |_, _| {});
    let mut coarse = scene.coarse_raster();
    coarse.samples.iter_mut().for_each(|z| *z /= 1000.0);
    let path = folder.path().join("km.tif");
    let mut options = WriteOptions::heights("coarse");
    options.unit = None;
    geotiff::write(&path, &coarse, &options).unwrap();
    let kilometres = SceneFiles { coarse: path, ..plain.clone() };
    let out = folder.path().join("out");
    let refused =
        prepared(std::slice::from_ref(&kilometres), &out, &PrepareOptions::default()).unwrap_err().to_string();
    assert!(refused.contains("km.tif") && refused.contains("--coarse-unit km"), "{refused}");
    let stated = PrepareOptions { coarse_unit: Some("km".into()), ..PrepareOptions::default() };
    let made = prepared(&[kilometres], &out, &stated).unwrap();
    let expected = prepared(&[plain], &folder.path().join("plain"), &PrepareOptions::default()).unwrap();
    assert!((made.three_sigma.mean_m - expected.three_sigma.mean_m).abs() < 0.01);
}

#[test]
fn useless_input_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let level = files(folder.path(), &scene(0, 256, 320), |_, truth| truth.samples.fill(5.0));
    let refused = |scenes: &[SceneFiles], parameters: &PrepareOptions| {
        prepared(scenes, &folder.path().join("out"), parameters).unwrap_err().to_string()
    };
    assert!(refused(std::slice::from_ref(&level), &PrepareOptions::default()).contains("none of 1 found (NoRelief 1)"));
    let small = files(folder.path(), &scene(1, 100, 320), |_, _| {});
    assert!(refused(&[small], &PrepareOptions::default()).contains("none of 0 found"));
    let missing = SceneFiles { dtm: "no.tif".into(), ..level.clone() };
    assert!(refused(&[missing], &PrepareOptions::default()).contains("no.tif"));
    let swapped = SceneFiles { coarse: level.image.clone(), image: level.coarse.clone(), ..level.clone() };
    assert!(refused(&[swapped], &PrepareOptions::default()).contains("pixels no smaller"));
    for parameters in [
        PrepareOptions { shares: [0.5, 0.1, 0.1], ..PrepareOptions::default() },
        PrepareOptions { search_px: 0, ..PrepareOptions::default() },
        PrepareOptions { max_offset_px: 9.0, ..PrepareOptions::default() },
        PrepareOptions { shard_tiles: 0, ..PrepareOptions::default() },
        PrepareOptions { interpolation: "nearest".into(), ..PrepareOptions::default() },
        PrepareOptions { coarse_unit: Some("feet".into()), ..PrepareOptions::default() },
    ] {
        assert!(refused(std::slice::from_ref(&level), &parameters).contains("expected"), "{parameters:?}");
    }
    // A folder with a manifest of another program is not a prepared folder.
    let other = folder.path().join("other");
    std::fs::create_dir(&other).unwrap();
    atomic_write(&other.join(MANIFEST), b"{\"seed\": 1}").unwrap();
    assert_eq!(TrainingSetManifest::find(&other).unwrap(), None);
    assert!(PreparedSource::open(&other, Split::Train).err().unwrap().to_string().contains("manifest"));
    atomic_write(&other.join(MANIFEST), format!("{{\"format\": \"{}\"}}", manifest::FORMAT).as_bytes()).unwrap();
    assert!(TrainingSetManifest::find(&other).unwrap_err().to_string().contains("broken"));
}

/// Data from a source other than the project's generator.
#[test]
fn an_independent_scene_is_prepared() {
    let Some(shared) = elunar_testing::shared_folder() else { return };
    let path = |what: &str| shared.join(format!("data/independent_synthetic/mixed_{what}.tif"));
    let scene = SceneFiles {
        image: path("image"),
        dtm: path("truth"),
        coarse: path("coarse"),
        site: "mixed".into(),
        sun_azimuth_deg: None,
        sun_elevation_deg: None,
    };
    let folder = tempfile::tempdir().unwrap();
    let made = prepared(&[scene], &folder.path().join("out"), &PrepareOptions::default()).unwrap();
    eprintln!("{:?}", made.scenes[0]);
    assert_eq!((made.tiles, made.kept), (4, 4));
    let [rows_px, cols_px] = made.scenes[0].offset_px.unwrap();
    assert!(rows_px.hypot(cols_px) < 0.3, "image and truth share a grid: {rows_px} {cols_px}");
}
