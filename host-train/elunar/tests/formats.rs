//! The same scene in every format that is read makes the same heights. GDAL writes the files; a text is put into a cube's label for its time.

mod common;

use common::{elunar, made, scene};
use elunar_raster::geotiff::read;
use elunar_testing::oracle;
use std::path::Path;
use std::process::Output;

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/nano.eld");

/// Runs a program of GDAL in a folder; `None` if it is absent.
fn gdal(folder: &Path, words: &[&str]) -> Option<()> {
    let mut command = oracle::gdal(words[0])?;
    let out = command.args(&words[1..]).arg("-q").current_dir(folder).output().unwrap();
    assert!(out.status.success(), "{words:?}: {}", String::from_utf8_lossy(&out.stderr));
    Some(())
}

fn said(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

#[test]
fn every_format_makes_the_same_heights() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    scene(at);
    let predicted = |image: &str, coarse: &str| {
        let dtm = format!("dtm of {image}.tif");
        let words = ["predict", "--threads", "2", "--image", image, "--coarse", coarse, "--model", MODEL, "-o", &dtm];
        let out = elunar(at, &words);
        assert!(out.status.success(), "{image} {coarse}: {}", said(&out));
        (read(at.join(&dtm)).unwrap().samples, said(&out))
    };
    let (expected, _) = predicted("image.tif", "coarse.tif");
    for (image, coarse, options) in [
        (
            "image.cub",
            "coarse.cub",
            &["-of", "ISIS3", "-co", "TILED=YES", "-co", "BLOCKXSIZE=64", "-co", "BLOCKYSIZE=32"][..],
        ),
        ("image.xml", "coarse.xml", &["-of", "PDS4"]),
        ("image.vrt", "coarse.vrt", &["-of", "VRT"]),
        // A format that is not read here: GDAL converts it.
        ("image.dat", "coarse.dat", &["-of", "ENVI"]),
    ] {
        for (from, to) in [("image.tif", image), ("coarse.tif", coarse)] {
            if gdal(at, &[&["gdal_translate", from, to], options].concat()).is_none() {
                return;
            }
        }
        let (found, said) = predicted(image, coarse);
        assert!(found == expected, "{image}: other heights");
        assert_eq!(said.contains("converted by gdal_translate"), image.ends_with(".dat"), "{image}: {said}");
        let described = made(at, &["inspect", image]);
        assert!(described.contains("raster of 250 x 300 pixels"), "{described}");
    }
}

#[test]
fn the_time_of_a_cube_and_of_a_label_places_the_sun() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    scene(at);
    let angles = |image: &str, more: &[&str]| {
        let dtm = format!("{}{image}.tif", more.len());
        let words =
            ["predict", "--threads", "2", "--image", image, "--coarse", "coarse.tif", "--model", MODEL, "-o", &dtm];
        let out = elunar(at, &[&words[..], &["--json"], more].concat());
        assert!(out.status.success(), "{image}: {}", said(&out));
        let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        found["light"].clone()
    };
    let time = "2009-09-02T12:00:00";
    let expected = angles("image.tif", &["--time", time]);
    assert_ne!(expected, angles("image.tif", &[]), "{expected}");
    if gdal(at, &["gdal_translate", "image.tif", "image.cub", "-of", "ISIS3"]).is_none()
        || gdal(at, &["gdal_translate", "image.tif", "image.xml", "-of", "PDS4"]).is_none()
    {
        return;
    }
    // In place of the padding behind the label, which ends with `End_Object`.
    let mut cube = std::fs::read(at.join("image.cub")).unwrap();
    let mapping = cube.windows(15).position(|part| part == b"Group = Mapping").unwrap();
    let text = format!("Group = Instrument StartTime = {time} End_Group ");
    cube.splice(mapping..mapping, text.bytes());
    let label_bytes = 65536;
    cube.drain(label_bytes..label_bytes + text.len());
    std::fs::write(at.join("image.cub"), cube).unwrap();
    assert_eq!(angles("image.cub", &[]), expected);
    let label = std::fs::read_to_string(at.join("image.xml")).unwrap();
    let absent = "<start_date_time xsi:nil=\"true\" nilReason=\"inapplicable\" />";
    assert!(label.contains(absent), "{label}");
    let label = label.replace(absent, &format!("<start_date_time>{time}Z</start_date_time>"));
    std::fs::write(at.join("image.xml"), label).unwrap();
    assert_eq!(angles("image.xml", &[]), expected);
}
