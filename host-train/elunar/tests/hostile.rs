//! Circumstances that no run asks for: a limit of the size of files, a stop before the first row, weights that overflow, a Sun that is none.

#![cfg(unix)]

mod common;

use common::{command, elunar, made};
use elunar_testing::exit_codes::check_object;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const MODELS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../models");
const SCENE: [&str; 5] = ["predict", "--image", "s/scene_0000_image.tif", "--coarse", "s/scene_0000_coarse.tif"];

fn text(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

/// Returns the names of the files in a folder, sorted, without the scene's.
fn left(folder: &Path) -> Vec<String> {
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.filter(|name| name != "s").collect();
    names.sort();
    names
}

#[test]
fn a_limit_of_file_sizes_is_one_error_line_and_leaves_nothing_that_looks_whole() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    made(at, &["synth", "--out", "s", "--rows", "300", "--cols", "320", "--seed", "5"]);
    let limited = |blocks: usize, words: &[&str]| {
        let limit = format!("ulimit -f {blocks} || exit 99; exec \"$@\"");
        let mut shell = Command::new("sh");
        shell.current_dir(at).args(["-c", &limit, "sh", env!("CARGO_BIN_EXE_elunar")]).args(words);
        shell.output().unwrap()
    };
    let predict = [&SCENE[..], &["--model", "nano", "--threads", "1", "-o", "dtm.tif", "--json"]].concat();
    let synth = ["synth", "--out", "t", "--rows", "256", "--cols", "320"];
    let shade = ["hillshade", "s/scene_0000_truth.tif", "-o", "shade.png"];
    let mut refused = 0;
    for blocks in [0, 1, 2, 64, 600, 800] {
        for words in [&predict[..], &synth, &shade] {
            let out = limited(blocks, words);
            if out.status.code() == Some(99) {
                elunar_testing::skipped("a_limit_of_file_sizes_is_one_error_line", "no ulimit -f here");
                return;
            }
            let what = format!("{blocks} blocks, {words:?}: {:?} {}", out.status, text(&out));
            if out.status.success() {
                continue;
            }
            refused += 1;
            let error = text(&out).lines().last().map(|line| format!("{line}\n")).unwrap_or_default();
            assert_eq!(out.status.code(), Some(75), "{what}");
            assert!(error.starts_with("ERROR: ") && error.contains("too large"), "{what}");
            if words[0] == "predict" {
                let object = String::from_utf8_lossy(&out.stdout);
                check_object(&object, 75, Some(&error)).unwrap_or_else(|wrong| panic!("{what}: {wrong}: {object}"));
            }
            for name in ["dtm.tif", "dtm.tif.sha256", "dtm.tif.lock", "t/manifest.json", "t/owner.lock", "shade.png"] {
                assert!(!at.join(name).exists(), "{what}: {name} is there");
            }
        }
    }
    assert!(refused > 8, "{refused}");
    // What was made of the rows is not lost.
    let _ = (std::fs::remove_dir_all(at.join("t")), std::fs::remove_file(at.join("shade.png")));
    made(at, &predict);
    assert_eq!(left(at), ["dtm.tif", "dtm.tif.sha256", "dtm_hillshade.png"]);
}

#[test]
fn a_stop_before_the_first_row_leaves_no_lock() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    made(at, &["synth", "--out", "s", "--rows", "4000", "--cols", "640"]);
    let predict = [&SCENE[..], &["--model", "ground", "--threads", "1", "-o", "dtm.tif"]].concat();
    let sfs = [&["sfs"], &SCENE[1..], &["--fit-sun", "--threads", "1", "-o", "dtm.tif"]].concat();
    for words in [&predict, &sfs] {
        for wait_ms in [0, 100, 400] {
            let child = command(at, words).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
            let start = Instant::now();
            while !at.join("dtm.tif.lock").exists() {
                assert!(start.elapsed() < Duration::from_secs(60), "no lock");
                std::thread::sleep(Duration::from_millis(1));
            }
            std::thread::sleep(Duration::from_millis(wait_ms));
            assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
            let out = child.wait_with_output().unwrap();
            assert_eq!(out.status.code(), Some(75), "{words:?}, {wait_ms} ms: {:?} {}", out.status, text(&out));
            assert!(text(&out).contains("ERROR: stopped"), "{}", text(&out));
            let _ = std::fs::remove_file(at.join("dtm.tif.part"));
            assert_eq!(left(at), [""; 0], "{words:?}, {wait_ms} ms");
        }
    }
}

#[test]
fn the_shipped_models_are_named_by_one_word() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    made(at, &["synth", "--out", "s", "--rows", "256", "--cols", "320", "--seed", "5"]);
    // A file of that name is no model unless it is named as a file.
    std::fs::write(at.join("nano"), "no model").unwrap();
    let run = |model: &str, output: &str| made(at, &[&SCENE[..], &["--model", model, "-o", output, "--json"]].concat());
    for name in ["nano", "ground"] {
        let file = format!("{MODELS}/{name}.eld");
        let object: serde_json::Value = serde_json::from_str(&run(name, "dtm.tif")).unwrap();
        let said = object["model"].as_str().unwrap();
        assert!(said.starts_with(&format!("int8 network {name}.eld sha256:")), "{said}");
        // The DTM states the same job as one that was made with the file.
        assert!(run(&file, "dtm.tif").contains("\"finished_before\":true"));
        let of_name = made(at, &["inspect", name]);
        let of_file = made(at, &["inspect", &file]);
        assert_eq!(of_name.split_once('\n').unwrap().1, of_file.split_once('\n').unwrap().1);
        let latency = made(at, &["latency", "--model", name, "--tiles", "1", "--json"]);
        let latency: serde_json::Value = serde_json::from_str(&latency).unwrap();
        let ms = |clock: &str| latency[clock].as_f64().unwrap();
        assert!(0.0 < ms("median_ms") && ms("median_ms") < 2.0 * ms("whole_median_ms"), "{latency}");
    }
    let out = elunar(at, &[&SCENE[..], &["--model", "./nano", "-o", "dtm.tif"]].concat());
    assert!(out.status.code() == Some(65) && text(&out).contains("./nano: not supported"), "{}", text(&out));
    let made_of = |more: &[&str]| made(at, &[&["manifest", "s/scene_0000_image.tif", "-o", "m.jsonl"], more].concat());
    made_of(&["--coarse", "s/scene_0000_coarse.tif", "--model", "nano"]);
    let line = std::fs::read_to_string(at.join("m.jsonl")).unwrap();
    assert!(line.contains("\"model\":\"nano\""), "{line}");
    // An object with more in it than the error is one object.
    let out = elunar(at, &["status", "--manifest", "m.jsonl", "--require", "99%", "--json"]);
    let status: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((out.status.code(), &status["items"], &status["error"]["code"]), (Some(75), &1.into(), &75.into()));
    // From another folder, too.
    let out = command(Path::new("/"), &["batch", "--manifest", &at.join("m.jsonl").display().to_string()]).output();
    let out = out.unwrap();
    assert!(out.status.success() && at.join("dtms/scene_0000_image.tif").exists(), "{}", text(&out));
    assert!(made(at, &["plan", "--manifest", "m.jsonl", "--json"]).starts_with('{'));
}

#[test]
fn a_sun_out_of_range_makes_no_training_set() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    made(at, &["synth", "--out", "s", "--rows", "256", "--cols", "320", "--seed", "5"]);
    let files = ["s/scene_0000_image.tif", "s/scene_0000_truth.tif", "s/scene_0000_coarse.tif"];
    let list = |sun: &str| {
        let text = format!("image,dtm,coarse,sun_azimuth_deg,sun_elevation_deg\n{},{sun}\n", files.join(","));
        std::fs::write(at.join("list.csv"), text).unwrap();
    };
    let [image, dtm, coarse] = files;
    let alone = ["prepare", "--image", image, "--dtm", dtm, "--coarse", coarse, "--out", "out"];
    for angle in ["NaN", "-1", "1e300", "inf", "0"] {
        let option = format!("--sun-elevation={angle}");
        list("100,");
        for words in [[&alone[..], &[&option]].concat(), vec!["prepare", "--list", "list.csv", "--out", "out", &option]]
        {
            let out = elunar(at, &words);
            assert!(
                out.status.code() == Some(64) && text(&out).contains("below 90 degrees"),
                "{words:?}: {}",
                text(&out)
            );
        }
        list(&format!("100,{angle}"));
        let out = elunar(at, &["prepare", "--list", "list.csv", "--out", "out"]);
        assert!(out.status.code() == Some(65) && text(&out).contains("below 90 degrees"), "{angle}: {}", text(&out));
        assert!(!at.join("out").exists(), "{angle}");
    }
    let out = elunar(at, &[&alone[..], &["--sun-azimuth", "1e300"]].concat());
    assert!(out.status.code() == Some(64) && text(&out).contains("-360 to 360 degrees"), "{}", text(&out));
    assert!(!at.join("out").exists());
}

#[test]
fn refused_memory_is_an_object_too() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    made(at, &["synth", "--out", "s", "--rows", "256", "--cols", "320", "--seed", "5"]);
    let mut objects = 0;
    for kib in (20_000..90_000).step_by(4_000) {
        let limit = format!("ulimit -v {kib} || exit 99; exec \"$@\"");
        let mut shell = Command::new("sh");
        shell.current_dir(at).args(["-c", &limit, "sh", env!("CARGO_BIN_EXE_elunar")]).args(SCENE);
        let out = shell.args(["--model", "nano", "--threads", "1", "-o", "dtm.tif", "--json"]).output().unwrap();
        let errors = text(&out);
        match out.status.code() {
            Some(99) => return elunar_testing::skipped("refused_memory_is_an_object_too", "no ulimit -v here"),
            Some(71) => {
                let error = errors.lines().find(|line| line.starts_with("ERROR: ")).map(|line| format!("{line}\n"));
                let object = String::from_utf8_lossy(&out.stdout);
                check_object(&object, 71, error.as_deref()).unwrap_or_else(|what| panic!("{what}: {object} {errors}"));
                objects += 1;
            }
            Some(0) => break,
            // The loader or the C library ends the program with its own words.
            _ => {}
        }
    }
    assert!(objects > 0);
}
