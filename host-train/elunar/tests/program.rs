//! The program as users run it, on files, without a training framework.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const MODELS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../models");

fn elunar(folder: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_elunar")).current_dir(folder).args(words).output().unwrap()
}

/// Returns the output of a command that must succeed.
fn made(folder: &Path, words: &[&str]) -> String {
    let out = elunar(folder, words);
    assert!(out.status.success(), "{words:?}: {}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8_lossy(&out.stdout).into_owned()
}

/// Returns the one-line error of a command that must fail.
fn refused(folder: &Path, words: &[&str]) -> String {
    let out = elunar(folder, words);
    let text = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(1), "{words:?}: {text}");
    assert_eq!(text.lines().count(), 1, "{text}");
    text
}

fn model(name: &str) -> String {
    PathBuf::from(MODELS).join(name).display().to_string()
}

#[test]
fn an_image_and_a_coarse_dtm_become_a_dtm_with_smaller_slope_errors() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    made(at, &["synth", "--out", "s", "--rows", "256", "--cols", "320", "--seed", "5"]);
    let [image, coarse, truth] = ["image", "coarse", "truth"].map(|kind| format!("s/scene_0000_{kind}.tif"));
    let nano = model("nano.eld");
    let predict = ["predict", "--image", &image, "--coarse", &coarse, "--model", &nano, "-o", "dtm.tif"];
    assert!(made(at, &predict).contains("256 x 320 pixels"));
    assert!(at.join("dtm_hillshade.png").exists() && !at.join("dtm.tif.part").exists());
    let text = made(at, &["evaluate", "--dtm", "dtm.tif", "--truth", &truth, "--coarse", &coarse, "--json"]);
    let scores: serde_json::Value = serde_json::from_str(&text).unwrap();
    let slope = |candidate: usize| scores["candidates"][candidate]["slope_mae_deg"].as_f64().unwrap();
    assert!(slope(0) < 0.8 * slope(1), "{text}");
    assert!(made(at, &["inspect", &nano]).starts_with(&nano));
}

#[test]
fn float_weights_are_exported_but_not_run() {
    let folder = tempfile::tempdir().unwrap();
    let nano = model("nano.safetensors");
    let text = refused(folder.path(), &["predict", "--image", "i", "--coarse", "c", "--model", &nano, "-o", "d.tif"]);
    assert!(text.contains("expected a model (.eld)") && text.contains("host-train"), "{text}");
    let text =
        refused(folder.path(), &["predict", "--image", "i", "--coarse", "c", "--model", "x.onnx", "-o", "d.tif"]);
    assert!(text.contains("x.onnx") && text.contains(".eld"), "{text}");
}

#[test]
fn without_a_command_it_says_what_there_is() {
    let out = elunar(Path::new("."), &[]);
    let text = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.code() == Some(2) && text.contains("predict") && text.contains("evaluate"), "{text}");
    assert!(!text.contains("train a network"), "{text}");
}

#[test]
fn a_sun_out_of_range_is_one_error_before_any_file_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let nano = model("nano.eld");
    let predict = ["predict", "--image", "i", "--coarse", "c", "--model", &nano, "-o", "d.tif"];
    let sfs = ["sfs", "--image", "i", "--coarse", "c", "-o", "d.tif"];
    for angle in ["90", "0", "-3", "NaN", "inf", "-inf"] {
        let elevation = format!("--sun-elevation={angle}");
        for words in [[&predict[..], &[&elevation]].concat(), [&sfs[..], &["--sun-azimuth", "10", &elevation]].concat()]
        {
            let text = refused(folder.path(), &words);
            assert_eq!(
                text.trim_end(),
                format!("ERROR: --sun-elevation: a number above 0 and below 90 degrees expected, found {angle}")
            );
        }
    }
    for angle in ["400", "NaN", "inf"] {
        let azimuth = format!("--sun-azimuth={angle}");
        for words in [[&predict[..], &[&azimuth]].concat(), [&sfs[..], &["--sun-elevation", "30", &azimuth]].concat()] {
            let text = refused(folder.path(), &words);
            assert!(text.contains("--sun-azimuth: a number from -360 to 360 degrees expected"), "{text}");
        }
    }
}
