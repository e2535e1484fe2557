//! Every kind of file is recognised.

use super::describe;
use elunar_core::sun::Body;
use elunar_raster::{Crs, GeoRef, Raster, geotiff};
use std::path::Path;

fn described(path: &Path) -> String {
    describe(path, |aside| panic!("{aside}")).unwrap()
}

fn refused(path: &Path) -> (String, String) {
    let mut aside = String::new();
    let error = describe(path, |text| aside = text).unwrap_err().to_string();
    assert!(!error.contains('\n'), "{error}");
    (error, aside)
}

#[test]
fn rasters_are_described() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    let georef = GeoRef {
        transform: [0.0, 2.0, 0.0, 10.0, 0.0, -2.5],
        crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 180.0),
    };
    let samples = (0..40).map(|i| if i < 10 { f32::NAN } else { i as f32 }).collect();
    let raster = Raster { rows: 4, cols: 10, samples, georef: Some(georef) };
    geotiff::write(&path, &raster, &geotiff::WriteOptions::heights("heights")).unwrap();
    let text = described(&path);
    for part in [
        "raster of 4 x 10 pixels",
        "equirectangular",
        "pixel: 2.500000 x 2.000000 m",
        "10 to 39, 75.00 % valid, in all samples",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(text.contains("corners: (0.000000, 10.000000) to (20.000000, 0.000000)"), "{text}");
}

#[test]
fn the_unit_is_said_as_the_file_says_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    let raster = Raster { rows: 1, cols: 2, samples: vec![1.0, 2.0], georef: None };
    for (unit, line) in [
        ("", "unit: not stated\n"),
        ("m", "unit: m\n"),
        ("US survey foot", "unit: m; the file says \"US survey foot\"\n"),
        ("unknown", "unit: not stated; the file says \"unknown\"\n"),
        ("degree", "unit: degree, no known length: refused as heights\n"),
    ] {
        let mut options = geotiff::WriteOptions::heights("t");
        options.unit = Some(unit.to_string()).filter(|unit| !unit.is_empty());
        geotiff::write(&path, &raster, &options).unwrap();
        let text = described(&path);
        assert!(text.contains(line), "{text}");
    }
    let label = "PDS_VERSION_ID = PDS3\n^IMAGE = 301 <BYTES>\nNOTE =\nOBJECT = IMAGE\nLINES = 1\nLINE_SAMPLES = 2\nSAMPLE_TYPE = MSB_INTEGER\nSAMPLE_BITS = 8\nEND_OBJECT\nEND\n";
    std::fs::write(&path, format!("{label:<300}\x01\x02")).unwrap();
    let text = described(&path);
    assert!(text.contains("warning: keywords without a value, read as empty: NOTE (line 3)\n"), "{text}");
}

#[test]
fn a_place_that_cannot_be_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    let georef = GeoRef { transform: [3e5, 2.0, 0.0, 6e5, 0.0, -2.0], crs: Crs::geographic(1_737_400.0) };
    let raster = Raster { rows: 4, cols: 10, samples: vec![1.0; 40], georef: Some(georef) };
    geotiff::write(&path, &raster, &geotiff::WriteOptions::heights("heights")).unwrap();
    let text = described(&path);
    assert!(text.contains("are they metres?") && text.contains("centre: off the map\n"), "{text}");
}

#[test]
fn the_sun_of_an_image_is_described() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    let raster = Raster { rows: 2, cols: 2, samples: vec![1.0, 2.0, 3.0, 4.0], georef: None };
    let options = geotiff::WriteOptions::image(geotiff::SampleType::U8, "image");
    geotiff::write(&path, &raster, &options).unwrap();
    assert!(!described(&path).contains("sun:"));
    geotiff::write(&path, &raster, &options.with_sun(Some(312.5), Some(31.0))).unwrap();
    assert!(described(&path).contains("sun: azimuth 312.500 deg, elevation 31.000 deg\n"));
}

#[test]
fn networks_are_described() {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
    assert!(described(&models.join("nano.eld")).starts_with("int8 model for tiles of 256 x 320"));
    assert!(described(&models.join("nano.safetensors")).starts_with("float weights: "));
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/mini/case.safetensors");
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("no_extension");
    std::fs::copy(golden, &copy).unwrap();
    assert!(described(&copy).starts_with("golden case"));
    let cut = folder.path().join("cut.eld");
    std::fs::write(&cut, b"\x89EL").unwrap();
    assert!(refused(&cut).0.contains("cut.eld: broken file"));
}

#[test]
fn labels_and_tables_are_described() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let table = "PDS_VERSION_ID = PDS3\nPRODUCT_ID = \"A\n B\"\n^TABLE = (\"A.TAB\", 2 <BYTES>)\nOBJECT = TABLE\nROWS = 1\nEND_OBJECT\nEND";
    let text = described(&write("t.lbl", table));
    assert!(
        text.contains("label of 4 keywords\nPRODUCT_ID: A B\n^TABLE = (A.TAB, 2 <BYTES>)\nTABLE with 1 keywords"),
        "{text}"
    );
    let (error, aside) = refused(&write("i.lbl", &table.replace("TABLE", "IMAGE").replace("A.TAB", "A.IMG")));
    assert!(error.contains("SAMPLE_BITS of the IMAGE expected, found none"), "{error}");
    assert!(aside.contains("PDS3 label"), "{aside}");
    let points = described(&write("p.csv", "lon,lat,radius_km,time\n1,2,1737.5,0\n3,-4,1737.25,9000\n"));
    assert!(points.contains("2 points in 2 tracks") && points.contains("height: -150.000 to 100.000 m"), "{points}");
    let (error, _) = refused(&write("x.txt", "hello\n"));
    assert!(error.contains("begins with \"hello\\n\"") && error.contains("nor is it a model"), "{error}");
    let (error, _) = refused(&write("b.lbl", "PDS_VERSION_ID = PDS3\nA =\n"));
    assert!(error.contains("line 2"), "{error}");
}
