//! Inputs on the net: the heights of the files of this machine, in few bytes, and a provenance that says what was read.

mod common;

use common::{elunar, scene};
use elunar_core::sun::Body;
use elunar_raster::geotiff::{WriteOptions, read, read_item, write};
use elunar_raster::{Crs, GeoRef, Raster};
use elunar_testing::server::{FileAnswer, FileServer};
use std::path::Path;

/// Predicts `dtm.tif` with what it says on stderr and stdout; `more` are further words.
fn predict(folder: &Path, image: &str, coarse: &str, dtm: &str, more: &[&str]) -> String {
    let words = ["predict", "--threads", "2", "--image", image, "--coarse", coarse, "--model", "nano", "-o", dtm];
    let out = elunar(folder, &[&words[..], more].concat());
    let text = String::from_utf8_lossy(&[out.stdout, out.stderr].concat()).into_owned();
    assert!(out.status.success(), "{image} {coarse}: {text}");
    text
}

/// Writes a coarse DTM of 2,500 x 2,500 pixels about the image, of noise, so that it is not compressed.
fn large(at: &Path) {
    let side = 2500;
    let transform = [9000.0 - 40_000.0, 40.0, 0.0, 604_000.0 + 40_000.0, 0.0, -40.0];
    let georef = Some(GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 20.0, 10.0) });
    let noise = |i: usize| (i.wrapping_mul(2_654_435_761) >> 8 & 0xFFFF) as f32 * 1e-3 + (i % side) as f32 * 0.1;
    let raster = Raster { rows: side, cols: side, samples: (0..side * side).map(noise).collect(), georef };
    write(&at.join("large.tif"), &raster, &WriteOptions::heights("large")).unwrap();
}

fn bits(path: &Path) -> Vec<u32> {
    read(path).unwrap().samples.iter().map(|v| v.to_bits()).collect()
}

#[test]
fn files_on_the_net_make_the_same_heights() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    scene(at);
    let bytes = |name: &str| std::fs::read(at.join(name)).unwrap();
    let (image, coarse) = (FileServer::start(bytes("image.tif"), |_, _| {}), bytes("coarse.tif"));
    let length = coarse.len();
    let of_coarse = FileServer::start(coarse.clone(), |_, _| {});
    let (from, below) = (image.url("image.tif"), of_coarse.url("coarse.tif?v=1"));
    predict(at, "image.tif", "coarse.tif", "local.tif", &[]);
    predict(at, &from, &below, "net.tif", &["--stac", "item.json"]);
    assert!(bits(&at.join("net.tif")) == bits(&at.join("local.tif")), "other heights");
    let item = |name: &str| read_item(&at.join("net.tif"), name).unwrap();
    let stands = format!("{below}, {length} bytes, ETag \"one\" (no hash of the bytes)");
    assert_eq!((item("COARSE_DTM_ADDRESS"), item("COARSE_DTM_SHA256")), (Some(stands.clone()), None));
    let stac: serde_json::Value = serde_json::from_slice(&bytes("item.json")).unwrap();
    let description = stac["properties"]["description"].as_str().unwrap();
    assert!(description.contains(&format!("and the coarse DTM {stands}, by ")), "{description}");
    // The same job, and another version of the file.
    assert!(predict(at, &from, &below, "net.tif", &["--stac", "item.json"]).contains("finished before"));
    drop(of_coarse);
    let of_coarse = FileServer::start(coarse, |_, answer| answer.set("ETag", Some("\"two\"")));
    let below = of_coarse.url("coarse.tif");
    assert!(!predict(at, &from, &below, "net.tif", &[]).contains("finished before"));
}

#[test]
fn a_file_that_changes_ends_the_run_and_a_missing_one_is_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    scene(at);
    large(at);
    let content = std::fs::read(at.join("large.tif")).unwrap();
    let code = |manners: fn(usize, &mut FileAnswer)| {
        let server = FileServer::start(content.clone(), manners);
        let coarse = server.url("large.tif");
        let words = ["predict", "--image", "image.tif", "--coarse", &coarse, "--model", "nano", "-o", "dtm.tif"];
        let out = elunar(at, &words);
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(text.lines().filter(|line| line.starts_with(&format!("ERROR: {coarse}: "))).count() == 1, "{text}");
        (out.status.code(), text)
    };
    let (found, text) =
        code(|number, answer| answer.set("ETag", Some(if number == 0 { "\"one\"" } else { "\"two\"" })));
    assert!(found == Some(75) && text.contains("changed while it was read"), "{text}");
    let (found, text) = code(|_, answer| answer.status = "404 No".into());
    assert!(found == Some(65) && text.contains("the server answers 404"), "{text}");
    let (found, text) = code(|_, answer| answer.status = "200 OK".into());
    assert!(found == Some(65) && text.contains("this fetches it: curl -L -o large.tif http"), "{text}");
}

/// Of a large coarse DTM the tiles that the image meets are read, and no others.
#[test]
fn of_a_large_coarse_dtm_a_part_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    scene(at);
    large(at);
    let content = std::fs::read(at.join("large.tif")).unwrap();
    let size = content.len();
    let server = FileServer::start(content, |_, _| {});
    predict(at, "image.tif", &server.url("large.tif"), "net.tif", &[]);
    let (read, asked) = (server.bytes(), server.asked().len());
    println!("{read} bytes of {size} in {asked} questions");
    assert!(size > 9_000_000 && read < 1_500_000 && asked < 12, "{read} bytes of {size} in {asked} questions");
    predict(at, "image.tif", "large.tif", "local.tif", &[]);
    assert!(bits(&at.join("net.tif")) == bits(&at.join("local.tif")), "other heights");
}
