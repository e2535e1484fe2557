//! Images and coarse DTMs in different projections: DTMs have the image's keys and the ground where it is; other systems are refused with what
//! to do.

use elunar_raster::geotiff::{SampleType, WriteOptions, read, write};
use elunar_raster::{Crs, GeoRef, Projection, Raster};
use std::path::Path;
use std::process::{Command, Output};

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/nano.eld");
/// The place of all rasters: near enough to the centres of the maps that a metre on them is one on the ground.
const LON_LAT: (f64, f64) = (20.3, 39.8);

const SYSTEMS: [&str; 8] = [
    "+proj=eqc +lat_ts=40 +lon_0=20 +R=1737400",
    "+proj=ortho +lat_0=40 +lon_0=20 +R=1737400",
    "+proj=tmerc +lon_0=20 +k=0.999 +x_0=250000 +R=1737400",
    "+proj=merc +lon_0=180 +lat_ts=40 +R=1737400",
    "+proj=stere +lat_0=41 +lon_0=19 +R=1737400",
    "+proj=sinu +lon_0=20 +R=1737400",
    "+proj=lcc +lat_1=40 +lat_0=40 +lon_0=18 +k_0=0.999 +R=1737400",
    "+proj=lcc +lat_1=30 +lat_2=50 +lat_0=40 +lon_0=22 +R=1737400",
];

/// A hill of 400 m with valleys, by longitude and latitude.
fn height(lon_deg: f64, lat_deg: f64) -> f64 {
    let (x, y) = ((lon_deg - LON_LAT.0) * 23_300.0, (lat_deg - LON_LAT.1) * 30_323.0);
    400.0 * (-(x * x + y * y) / 9e6).exp() + 60.0 * (x / 500.0).sin() * (y / 700.0).cos()
}

fn raster(crs: &Crs, rows: usize, cols: usize, pixel_m: f64, value: impl Fn(f64, f64) -> f64) -> Raster {
    let projection = Projection::of(crs).unwrap();
    let (x, y) = projection.forward(LON_LAT.0, LON_LAT.1);
    let (x, y) = (x - cols as f64 / 2.0 * pixel_m, y + rows as f64 / 2.0 * pixel_m);
    let georef = GeoRef { transform: [x, pixel_m, 0.0, y, 0.0, -pixel_m], crs: crs.clone() };
    let sample = |i: usize| {
        let (x, y) = georef.centre((i / cols) as f64, (i % cols) as f64);
        let (lon_deg, lat_deg) = projection.inverse(x, y);
        value(lon_deg, lat_deg) as f32
    };
    Raster { rows, cols, samples: (0..rows * cols).map(sample).collect(), georef: Some(georef) }
}

fn predict(folder: &Path, image: &str, coarse: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_elunar"));
    command.current_dir(folder).args(["predict", "--threads", "2", "--image", image, "--coarse", coarse]);
    command.args(["--model", MODEL, "-o", "dtm.tif"]).output().unwrap()
}

#[test]
fn dtms_lie_on_the_images_map() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for (i, system) in SYSTEMS.iter().enumerate() {
        let (crs, other) = (Crs::parse(system).unwrap(), Crs::parse(SYSTEMS[(i + 3) % SYSTEMS.len()]).unwrap());
        // Brighter where the ground rises eastwards: the Sun stands in the west.
        let bright = |lon: f64, lat: f64| 500.0 + 8.0 * (height(lon + 4e-4, lat) - height(lon - 4e-4, lat));
        let image = raster(&crs, 280, 330, 20.0, bright);
        write(&path("image.tif"), &image, &WriteOptions::image(SampleType::U16, "image")).unwrap();
        write(&path("coarse.tif"), &raster(&other, 60, 60, 240.0, height), &WriteOptions::heights("coarse")).unwrap();
        let out = predict(folder.path(), "image.tif", "coarse.tif");
        assert!(out.status.success(), "{system}: {}", String::from_utf8_lossy(&out.stderr));
        let dtm = read(path("dtm.tif")).unwrap();
        assert_eq!(dtm.georef, image.georef, "{system}");
        assert_eq!(dtm.valid_count(), 280 * 330, "{system}");
        let truth = raster(&crs, 280, 330, 20.0, height);
        let sum: f64 = dtm.samples.iter().zip(&truth.samples).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let rmse_m = (sum / dtm.samples.len() as f64).sqrt();
        // A coarse DTM that lies a pixel off has 19 to 23 m.
        assert!(rmse_m < 8.0, "{system}: {rmse_m} m");
    }
}

#[test]
fn what_does_not_fit_is_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let moon = Crs::parse(SYSTEMS[0]).unwrap();
    let image = raster(&moon, 280, 330, 20.0, |_, _| 100.0);
    let coarse = raster(&moon, 60, 60, 240.0, height);
    let keys = |pairs: &[[u16; 2]]| {
        let entries = pairs.iter().flat_map(|&[key, value]| [key, 0, 1, value]);
        Crs { directory: [1, 1, 0, pairs.len() as u16].into_iter().chain(entries).collect(), ..Crs::default() }
    };
    let robinson = || {
        let mut crs = moon.clone();
        let at = crs.directory[4..].chunks(4).position(|entry| entry[0] == 3075).unwrap();
        crs.directory[4 + 4 * at + 3] = 23;
        crs
    };
    let degrees = [19.9, 0.01, 0.0, 40.1, 0.0, -0.01];
    let metres = coarse.georef.as_ref().unwrap().transform;
    for (crs, transform, words) in [
        (keys(&[[1024, 2], [2048, 4326]]), degrees, &["EPSG:4326", "ellipsoid", "sphere", "--coarse-srs", "30100"][..]),
        (robinson(), metres, &["Robinson", "gdalwarp -t_srs '+proj=eqc +lat_ts=40"]),
        (Crs::parse("+proj=longlat +R=1737400").unwrap(), metres, &["are they metres?", "--coarse-srs"]),
        (Crs::parse("+proj=eqc +R=1737400").unwrap(), degrees, &["are they degrees?", "--coarse-srs"]),
        (keys(&[[1024, 32767]]), metres, &["neither a projection nor longitude/latitude", "gdal_translate -a_srs"]),
    ] {
        write(&path("image.tif"), &image, &WriteOptions::image(SampleType::U16, "image")).unwrap();
        let placed = Raster { georef: Some(GeoRef { transform, crs }), ..coarse.clone() };
        write(&path("coarse.tif"), &placed, &WriteOptions::heights("coarse")).unwrap();
        let out = predict(folder.path(), "image.tif", "coarse.tif");
        let text = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(65), "{words:?}: {text}");
        assert!(words.iter().all(|word| text.contains(word)) && !text.contains("inf"), "{words:?}: {text}");
        assert_eq!(text.lines().filter(|line| line.starts_with("ERROR:")).count(), 1, "{text}");
    }
}
