//! Products that are written are read here and by GDAL: samples, place and what is said of them.

use super::{Product, holds, note, samples_path, write};
use crate::gdal_tests::agrees;
use crate::source::{InMemory, open, read_all};
use crate::{Crs, GeoRef, Raster};
use std::path::Path;

const PRODUCT: Product =
    Product { title: "A & B <c>\u{7}", comment: "from \"d\" & 'e'", note: "MADE_BY 12", time: None };

/// Maps, and their pixel in map units.
const MAPS: [(&str, f64); 9] = [
    ("+proj=eqc +lat_ts=20 +lat_0=5 +lon_0=180 +x_0=1000 +y_0=-500 +R=1737400", 5.0),
    ("+proj=longlat +R=1737400", 0.001),
    ("+proj=stere +lat_0=-90 +lon_0=30 +k_0=0.994 +R=1737400", 5.0),
    ("+proj=stere +lat_0=90 +lat_ts=70 +lon_0=30 +R=3396190 +units=km", 0.1),
    ("+proj=ortho +lat_0=10 +lon_0=10 +R=3396190", 5.0),
    ("+proj=tmerc +lat_0=10 +lon_0=10 +k=0.9996 +R=1737400", 5.0),
    ("+proj=merc +lon_0=10 +k_0=0.9 +R=1737400", 5.0),
    ("+proj=sinu +lon_0=10 +R=1737400", 5.0),
    ("+proj=lcc +lat_1=20 +lat_2=60 +lat_0=40 +lon_0=10 +R=1737400", 5.0),
];

fn raster(srs: &str, pixel: f64, rows: usize) -> Raster {
    let transform = [-20.0 * pixel, pixel, 0.0, 30.0 * pixel, 0.0, -pixel];
    let mut samples: Vec<f32> = (0..rows * 40).map(|i| i as f32 * 0.3 - 77.0).collect();
    samples[41] = f32::NAN;
    Raster { rows, cols: 40, samples, georef: Some(GeoRef { transform, crs: Crs::parse(srs).unwrap() }) }
}

fn written(path: &Path, raster: Raster, product: &Product) -> elunar_base::Result<()> {
    write(path, &InMemory::new(raster, Some("m".into()), "test"), product)
}

#[test]
fn products_are_read_here_and_by_gdal() {
    let folder = tempfile::tempdir().unwrap();
    let mut names = vec![];
    for (i, (srs, pixel)) in MAPS.into_iter().enumerate() {
        let name = format!("{i}.xml");
        let (path, rows) = (folder.path().join(&name), if i == 0 { 600 } else { 30 });
        let wanted = raster(srs, pixel, rows);
        let time = (i == 0).then(|| "2009-08-30T12:00:00".parse().unwrap());
        written(&path, wanted.clone(), &Product { time, ..PRODUCT }).unwrap();
        let source = open(&path).unwrap();
        let info = source.info();
        assert_eq!((info.unit.as_deref(), info.sun.time), (Some("m"), time), "{srs}");
        assert!(info.place(&name).is_ok() && info.warnings.is_empty(), "{srs}: {:?}", info.warnings);
        let read = read_all(&*source).unwrap();
        let same = |(a, b): (&f32, &f32)| a == b || a.is_nan() && b.is_nan();
        assert!(read.samples.iter().zip(&wanted.samples).all(same) && read.samples.len() == rows * 40, "{srs}");
        // The same places, whatever the unit and the false origin were.
        let place = |georef: &GeoRef, row, col| {
            let (x, y) = georef.centre(row, col);
            crate::Projection::of(&georef.crs).unwrap().inverse(x, y)
        };
        for (row, col) in [(0.0, 0.0), (29.0, 39.0), (7.0, 21.0)] {
            let [a, b] = [&wanted, &read].map(|raster| place(raster.georef.as_ref().unwrap(), row, col));
            let lon_deg = (a.0 - b.0 + 180.0).rem_euclid(360.0) - 180.0;
            assert!(lon_deg.abs() < 1e-9 && (a.1 - b.1).abs() < 1e-9, "{srs}: {a:?} {b:?}");
        }
        names.push(name);
    }
    assert_eq!(std::fs::read(folder.path().join("1.img")).unwrap().len(), 30 * 40 * 4);
    agrees(folder.path(), &names, |_| 1.0);
}

#[test]
fn a_label_says_whose_samples_it_has() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("A b-c.xml");
    written(&path, raster(MAPS[0].0, 5.0, 30), &PRODUCT).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    for words in [
        "<logical_identifier>urn:nasa:pds:elunardtm:data:a_b-c</logical_identifier>",
        "<title>A &amp; B &lt;c&gt; </title>",
        "<lid_reference>urn:nasa:pds:context:target:satellite.moon</lid_reference>",
        "<file_name>A b-c.img</file_name>",
        "<file_size unit=\"byte\">4800</file_size>",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    assert_eq!(note(&path).as_deref(), Some("MADE_BY 12"));
    assert!(holds(&path, "MADE_BY 12") && !holds(&path, "MADE_BY 13"));
    let samples = samples_path(&path);
    let mut bytes = std::fs::read(&samples).unwrap();
    bytes[9] ^= 1;
    std::fs::write(&samples, bytes).unwrap();
    assert!(!holds(&path, "MADE_BY 12"), "changed samples");
    std::fs::write(&path, "<a/>").unwrap();
    assert!(note(&path).is_none() && note(&samples).is_none());
}

#[test]
fn what_no_label_says_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.xml");
    let turned = |transform| {
        let mut raster = raster(MAPS[0].0, 5.0, 30);
        raster.georef.as_mut().unwrap().transform = transform;
        raster
    };
    let nowhere = Raster { georef: None, ..raster(MAPS[0].0, 5.0, 30) };
    for (raster, what) in [
        (raster("+proj=stere +lat_0=40 +lon_0=30 +R=1737400", 5.0, 30), "PDS4's dictionary of cartography expected"),
        (raster("+proj=lcc +lat_1=40 +lat_0=40 +k_0=0.9 +R=1737400", 5.0, 30), "found Lambert"),
        (raster("+proj=eqc +R=2439400", 5.0, 30), "a map of the Moon or of Mars expected"),
        (turned([0.0, 5.0, 0.1, 0.0, 0.1, -5.0]), "north up expected"),
        (turned([0.0, 5.0, 0.0, 0.0, 0.1, -5.0]), "north up expected"),
        (turned([0.0, -5.0, 0.0, 0.0, 0.0, -5.0]), "north up expected"),
        (turned([0.0, 5.0, 0.0, 0.0, 0.0, 5.0]), "north up expected"),
        (nowhere, "a raster with a geotransform expected"),
    ] {
        let error = written(&path, raster, &PRODUCT).expect_err(what).to_string();
        assert!(error.contains("a.xml") && error.contains(what) && !error.contains('\n'), "{what}: {error}");
        assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none(), "{what}: a file remains");
    }
}

#[test]
fn bounds_across_the_meridian_of_180_degrees_count_from_0() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.xml");
    // Above the north pole, where the map's middle is at 180 degrees.
    let mut raster = raster("+proj=stere +lat_0=90 +R=1737400", 5.0, 30);
    raster.georef.as_mut().unwrap().transform = [-100.0, 5.0, 0.0, 1000.0, 0.0, -5.0];
    written(&path, raster, &PRODUCT).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let bound = |side: &str| -> f64 {
        let at = text.split(&format!("{side}_bounding_coordinate unit=\"deg\">")).nth(1).unwrap();
        at.split('<').next().unwrap().parse().unwrap()
    };
    let half = (100.0_f64 / 850.0).atan().to_degrees();
    assert!((bound("west") - (180.0 - half)).abs() < 1e-9 && (bound("east") - (180.0 + half)).abs() < 1e-9, "{text}");
}
