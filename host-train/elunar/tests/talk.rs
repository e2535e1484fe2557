//! What the program says besides results: nothing, the usual, details, JSON lines.

mod common;

use common::command as elunar;
use std::path::Path;

/// Runs `predict` on an image that covers the coarse DTM in part, with further words. Returns stdout and stderr.
fn said(folder: &Path, more: &[&str]) -> (String, String) {
    let inputs = ["--image", "s/scene_0000_image.tif", "--coarse", "s/scene_0000_coarse.tif", "--model", "nano"];
    let sun = ["--sun-azimuth", "5", "--no-anchor", "-o", "dtm.tif"];
    let out = elunar(folder, &[&["predict"], &inputs[..], &sun, more].concat()).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(out.status.success(), "{}", text(&out.stderr));
    std::fs::remove_file(folder.join("dtm.tif")).unwrap();
    (text(&out.stdout), text(&out.stderr))
}

#[test]
fn the_user_chooses_how_much_is_said_and_in_which_form() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    assert!(elunar(at, &["synth", "--out", "s", "--rows", "256", "--cols", "320"]).output().unwrap().status.success());
    let (result, usual) = said(at, &[]);
    assert!(usual.starts_with("WARNING: --sun-azimuth is 5 deg") && usual.lines().count() == 1, "{usual}");
    assert_eq!(said(at, &["--quiet"]), (result.clone(), String::new()));
    let (same, verbose) = said(at, &["-v"]);
    assert!(same == result && verbose.contains(usual.trim()), "{verbose}");
    for what in ["model: int8 network nano.eld sha256:", "options: overlap_px=", "job: ", "seconds: survey "] {
        assert!(verbose.lines().any(|line| line.starts_with(what)), "{what}: {verbose}");
    }
    let (same, lines) = said(at, &["--progress", "json"]);
    assert_eq!(same, result);
    let lines: Vec<serde_json::Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(lines.iter().any(|line| line["warning"].as_str().is_some_and(|text| usual.contains(text))));
    let progress: Vec<_> = lines.iter().filter(|line| line["progress"]["unit"] == "tiles").collect();
    let last = &progress.last().unwrap()["progress"];
    assert!(last["done"] == last["all"] && last["all"].as_u64() > Some(0), "{last}");
    let refused = elunar(at, &["inspect", "-q", "-v", "s/scene_0000_image.tif"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(64));
}
