//! Manifests, batches and their status on one machine. Engines: `./ci.sh cluster`.

#![cfg(unix)]

mod common;

use common::{command, made};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/nano.eld");

/// Returns the exit code, standard output and standard error.
fn ended(folder: &Path, words: &[&str]) -> (Option<i32>, String, String) {
    let Output { status, stdout, stderr } = command(folder, words).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    (status.code(), text(stdout), text(stderr))
}

/// Some scenes and a manifest of them, `m.jsonl`, for DTMs in `out`.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new(scenes: usize, rows: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (count, rows) = (scenes.to_string(), rows.to_string());
        made(
            folder.path(),
            &["synth", "--out", "s", "--scenes", &count, "--rows", &rows, "--cols", "320", "--seed", "5"],
        );
        let line = |i: usize| format!("s{i},s/scene_{i:04}_image.tif,s/scene_{i:04}_coarse.tif\n");
        let table: String = (0..scenes).map(line).collect();
        std::fs::write(folder.path().join("t.csv"), format!("id,image,coarse\n{table}")).unwrap();
        let bench = Self { folder };
        bench.made(&["manifest", "--table", "t.csv", "--model", MODEL, "--output-dir", "out", "-o", "m.jsonl"]);
        bench
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn made(&self, words: &[&str]) -> String {
        made(self.folder.path(), words)
    }

    fn batch(&self, more: &[&str]) -> (Option<i32>, Vec<serde_json::Value>, String) {
        let (code, stdout, stderr) = ended(self.folder.path(), &[&["batch", "--manifest", "m.jsonl"], more].concat());
        let lines = stdout.lines().map(|line| serde_json::from_str(line).unwrap());
        (code, lines.collect(), stderr)
    }

    fn dtm(&self, id: &str) -> Option<Vec<u8>> {
        std::fs::read(self.at(&format!("out/{id}.tif"))).ok()
    }

    fn manifest(&self) -> String {
        std::fs::read_to_string(self.at("m.jsonl")).unwrap()
    }
}

#[test]
fn a_wrong_line_is_named_before_anything_starts() {
    let bench = Bench::new(2, 256);
    let good = bench.manifest();
    let wrong = good.replace("\"id\":\"s1\"", "\"id\":\"s1\",\"sun_azimuth\":999");
    std::fs::write(bench.at("m.jsonl"), wrong).unwrap();
    let (code, lines, text) = bench.batch(&[]);
    assert!(code == Some(65) && lines.is_empty(), "{code:?} {lines:?}");
    assert!(text.contains("m.jsonl: broken file: line 2, field sun_azimuth: a number from -360 to 360"), "{text}");
    assert!(!bench.at("out").exists(), "something was started");
    for words in [
        &["status", "--manifest", "m.jsonl"][..],
        &["plan", "--manifest", "m.jsonl"],
        &["manifest", "--check", "m.jsonl"],
    ] {
        let (code, _, text) = ended(bench.folder.path(), words);
        assert!(code == Some(65) && text.contains("line 2, field sun_azimuth"), "{words:?}: {text}");
    }
}

#[test]
fn a_broken_image_costs_its_item_alone_and_finished_work_is_left() {
    let bench = Bench::new(4, 256);
    let cut = std::fs::read(bench.at("s/scene_0001_image.tif")).unwrap();
    std::fs::write(bench.at("s/scene_0001_image.tif"), &cut[..cut.len() / 2]).unwrap();
    std::fs::remove_file(bench.at("s/scene_0002_image.tif")).unwrap();
    let (code, lines, text) = bench.batch(&["--jobs", "2"]);
    assert_eq!(code, Some(65), "{text}");
    let of = |id: &str| lines.iter().find(|line| line["id"] == id).unwrap_or_else(|| panic!("{lines:?}"));
    for (id, verdict, exit) in [("s0", "done", 0), ("s1", "failed", 65), ("s2", "failed", 65), ("s3", "done", 0)] {
        assert_eq!((&of(id)["verdict"], &of(id)["code"]), (&verdict.into(), &exit.into()), "{lines:?}");
        assert_eq!(bench.dtm(id).is_some(), exit == 0, "{id}");
    }
    assert!(of("s1")["error"].as_str().unwrap().contains("scene_0001_image.tif"));
    std::fs::write(bench.at("log"), lines.iter().map(|line| format!("{line}\n")).collect::<String>()).unwrap();
    let found =
        bench.made(&["status", "--manifest", "m.jsonl", "log", "--json", "--html", "s.html", "--done", "l.txt"]);
    let found: serde_json::Value = serde_json::from_str(&found).unwrap();
    assert_eq!(
        (&found["done"], &found["failed"], &found["failures"]["bad input"]["items"]),
        (&2.into(), &2.into(), &2.into())
    );
    let page = std::fs::read_to_string(bench.at("s.html")).unwrap();
    assert!(page.contains("failed for good"));
    let list = std::fs::read_to_string(bench.at("l.txt")).unwrap();
    assert!(list.lines().count() == 2 && list.contains("out/s0.tif"), "{list}");
    for (share, code) in [("50%", 0), ("51%", 65)] {
        let (found, _, text) =
            ended(bench.folder.path(), &["status", "--manifest", "m.jsonl", "log", "--require", share]);
        assert_eq!(found, Some(code), "{share}: {text}");
    }
    // The images come back: only they are made.
    std::fs::write(bench.at("s/scene_0001_image.tif"), cut).unwrap();
    let before = bench.dtm("s0");
    let (code, lines, _) = bench.batch(&["--chunk", "2/2"]);
    assert_eq!((code, lines.len()), (Some(0), 2));
    assert_eq!(lines[1]["verdict"], "done_before");
    assert!(bench.dtm("s0") == before && bench.dtm("s1").is_some());
}

#[test]
fn a_batch_replaces_dtms_of_earlier_runs_and_nothing_else() {
    let bench = Bench::new(2, 256);
    std::fs::create_dir(bench.at("out")).unwrap();
    let refused = |name: &str, line: &str| {
        let (code, lines, text) = bench.batch(&[]);
        assert!(code == Some(65) && lines.is_empty(), "{name}: {code:?} {lines:?}");
        assert!(text.lines().count() == 1 && text.contains(line) && text.contains(&format!("out/{name}: ")), "{text}");
        assert!(bench.dtm("s0").is_none_or(|found| found == b"precious"), "something was started");
    };
    for (name, line) in [
        ("s0.tif", "line 1, field output"),
        ("s0.tif.sha256", "line 1, field output"),
        ("s1_hillshade.png", "line 2, field output"),
    ] {
        std::fs::write(bench.at(&format!("out/{name}")), "precious").unwrap();
        refused(name, line);
        std::fs::remove_file(bench.at(&format!("out/{name}"))).unwrap();
    }
    // A download with its sum is no DTM of this program.
    std::fs::write(bench.at("out/s0.tif"), "precious").unwrap();
    std::fs::write(bench.at("out/s0.tif.sha256"), format!("{}  s0.tif\n", "0".repeat(64))).unwrap();
    refused("s0.tif", "line 1, field output");
    std::fs::remove_dir_all(bench.at("out")).unwrap();
    assert_eq!(bench.batch(&[]).0, Some(0));
    // What a run leaves that is killed at its end; and another job.
    let whole = bench.dtm("s0");
    std::fs::remove_file(bench.at("out/s0.tif")).unwrap();
    assert_eq!(bench.batch(&[]).0, Some(0));
    assert!(bench.dtm("s0") == whole);
    let other = bench.manifest().replace("\"id\":\"s0\"", "\"id\":\"s0\",\"options\":{\"no_anchor\":true}");
    std::fs::write(bench.at("m.jsonl"), other).unwrap();
    assert_eq!(bench.batch(&[]).0, Some(0));
    assert!(bench.dtm("s0") != whole);
}

#[test]
fn a_batch_that_is_stopped_or_killed_goes_on() {
    let bench = Bench::new(3, 2400);
    bench.batch(&["--jobs", "2"]);
    let whole: Vec<_> = ["s0", "s1", "s2"].iter().map(|id| bench.dtm(id).unwrap()).collect();
    // Begins a batch, and ends it with a signal when its first DTM has rows.
    let ended_by = |signal: &str| {
        std::fs::remove_dir_all(bench.at("out")).unwrap();
        let mut child = command(bench.folder.path(), &["batch", "--manifest", "m.jsonl"]);
        let child = child.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let start = Instant::now();
        while std::fs::metadata(bench.at("out/s0.tif.part")).map_or(0, |found| found.len()) <= 48 {
            assert!(start.elapsed() < Duration::from_secs(120), "no rows");
            std::thread::sleep(Duration::from_millis(2));
        }
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        child.wait_with_output().unwrap()
    };
    for signal in ["-TERM", "-KILL"] {
        let mut out = ended_by(signal);
        if signal == "-TERM" {
            // On a busy machine a DTM may be finished before the signal comes: once more then.
            let mut more = 0..9;
            while bench.dtm("s0").is_some() && more.next().is_some() {
                out = ended_by(signal);
            }
            let text = String::from_utf8_lossy(&out.stderr);
            assert!(out.status.code() == Some(75) && text.contains("3 may succeed later"), "{text}");
            assert!(bench.dtm("s0").is_none() && bench.dtm("s2").is_none());
        }
        // The orphan of a killed batch still owns its output: it is waited for.
        let (code, lines, text) = bench.batch(&["--wait", "120"]);
        assert_eq!(code, Some(0), "{signal}: {lines:?} {text}");
        for (id, whole) in ["s0", "s1", "s2"].iter().zip(&whole) {
            assert!(bench.dtm(id).as_ref() == Some(whole), "{signal}: {id}");
        }
    }
}

#[test]
fn two_batches_of_one_chunk_share_it() {
    let bench = Bench::new(4, 512);
    let begin = || {
        command(bench.folder.path(), &["batch", "--manifest", "m.jsonl", "--wait", "60"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
    };
    let both = [begin().unwrap(), begin().unwrap()];
    let mut done = 0;
    for child in both {
        let out = child.wait_with_output().unwrap();
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        done += String::from_utf8_lossy(&out.stdout).matches("\"verdict\":\"done\"").count();
    }
    assert_eq!(done, 4, "an item was made twice, or not at all");
}

#[test]
fn a_manifest_that_states_another_size_is_made_again() {
    let bench = Bench::new(1, 256);
    assert!(bench.manifest().contains("\"coarse_sha256\":\""));
    let mut coarse = std::fs::read(bench.at("s/scene_0000_coarse.tif")).unwrap();
    coarse.push(0);
    std::fs::write(bench.at("s/scene_0000_coarse.tif"), coarse).unwrap();
    let (code, lines, _) = bench.batch(&[]);
    let error = lines[0]["error"].as_str().unwrap();
    assert!(code == Some(65) && error.contains("make the manifest again"), "{error}");
}

#[test]
fn a_plan_states_what_a_run_takes() {
    let bench = Bench::new(2, 256);
    let text = bench.made(&["plan", "--manifest", "m.jsonl", "--cores", "2", "--json"]);
    let found: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert!(found["costs"]["tile_s"].as_f64().unwrap() > 0.0 && found["plan"]["items"] == 2, "{found}");
}
