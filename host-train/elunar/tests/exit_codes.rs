//! The exit codes of every command: 64 for the command line, 65 for a bad input, 75 for an output that another run owns, 75 and 143 for a
//! signal, 141 for a closed pipe.

#![cfg(unix)]

mod common;

use common::command as elunar;
use elunar_testing::exit_codes::{Called, check};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/nano.eld");

/// Every command with inputs that are absent, and the lock of its output, if that is taken first.
const COMMANDS: [(&[&str], Option<&str>); 21] = [
    (&["manifest", "no.tif", "--coarse", "no2.tif", "--model", MODEL, "-o", "out.jsonl"], Some("out.jsonl.lock")),
    (&["batch", "--manifest", "no.jsonl"], None),
    (&["status", "--manifest", "no.jsonl"], None),
    (&["plan", "--manifest", "no.jsonl"], None),
    (
        &["join", "--parts", "2", "--image", "no.tif", "--coarse", "no2.tif", "--model", MODEL, "-o", "out.tif"],
        Some("out.tif.lock"),
    ),
    (&["predict", "--image", "no.tif", "--coarse", "no2.tif", "--model", MODEL, "-o", "out.tif"], Some("out.tif.lock")),
    (&["latency", "--model", "no.eld"], None),
    (&["synth", "--out", "out"], Some("out/owner.lock")),
    (&["prepare", "--list", "no.csv", "--out", "out"], None), // the list is read first
    (&["export", "--weights", "no.safetensors", "--calibrate", "synth", "-o", "out.eld"], Some("out.eld.lock")),
    (
        &[
            "sfs",
            "--image",
            "no.tif",
            "--coarse",
            "no2.tif",
            "--sun-azimuth",
            "1",
            "--sun-elevation",
            "30",
            "-o",
            "out.tif",
        ],
        Some("out.tif.lock"),
    ),
    (&["evaluate", "--dtm", "no.tif", "--truth", "no2.tif", "--error-map", "out.png"], Some("out.png.lock")),
    (&["hillshade", "no.tif", "-o", "out.tif"], Some("out.tif.lock")),
    (&["render", "no.tif", "--sun-azimuth", "10", "--sun-elevation", "30", "-o", "out.tif"], Some("out.tif.lock")),
    (&["diff", "no.tif", "no2.tif", "-o", "out.tif"], Some("out.tif.lock")),
    (&["mosaic", "no.tif", "no2.tif", "-o", "out.tif"], Some("out.tif.lock")),
    (&["lola", "--dtm", "no.tif", "--tracks", "no.csv"], None),
    (&["inspect", "no.tif"], None),
    (&["completions", "bash"], None),
    (&["man", "no"], None),
    (&["sun", "2009-08-30"], None),
];

#[test]
fn every_command_ends_with_the_documented_code() {
    // `synth`, `sun` and `completions` have no input, `man` an output alone, whose folder is absent.
    let code = |words: &[&str]| match words[0] {
        "synth" | "sun" | "completions" => None,
        "man" => Some(64),
        _ => Some(65),
    };
    let commands = COMMANDS.map(|(words, lock)| Called { words, code: code(words), lock });
    check(Path::new(env!("CARGO_BIN_EXE_elunar")), &commands, &[]);
}

#[test]
fn a_closed_pipe_is_141_without_a_message() {
    let folder = tempfile::tempdir().unwrap();
    assert!(
        elunar(folder.path(), &["synth", "--out", "s", "--rows", "256", "--cols", "320"])
            .output()
            .unwrap()
            .status
            .success()
    );
    // What a run wrote for itself is removed before its last words.
    let inputs = ["--image", "s/scene_0000_image.tif", "--coarse", "s/scene_0000_coarse.tif", "--model", MODEL];
    let predict = [&["predict", "-o", "dtm.tif"], &inputs[..]].concat();
    let part = [&["predict", "-o", "p.tif", "--part", "1/1"], &inputs[..]].concat();
    assert!(elunar(folder.path(), &part).output().unwrap().status.success());
    let join = [&["join", "-o", "p.tif", "--parts", "1"], &inputs[..]].concat();
    for words in [
        &predict[..],
        &join,
        &["inspect", "s/scene_0000_image.tif"][..],
        &["diff", "s/scene_0000_truth.tif", "s/scene_0000_truth.tif"],
    ] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let out = elunar(folder.path(), words).stdout(writer).output().unwrap();
        assert_eq!((out.status.code(), out.stderr.len()), (Some(141), 0), "{words:?}");
    }
    let mut left: Vec<String> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    left.sort();
    let of = |name: &str| [".tif", ".tif.sha256", "_hillshade.png"].map(|end| format!("{name}{end}"));
    assert_eq!(left, [&of("dtm")[..], &of("p"), &["s".into()]].concat());
}

#[test]
fn one_signal_stops_at_a_safe_point_and_two_end_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    assert!(elunar(at, &["synth", "--out", "s", "--rows", "4000", "--cols", "320"]).output().unwrap().status.success());
    let predict =
        ["predict", "--image", "s/scene_0000_image.tif", "--coarse", "s/scene_0000_coarse.tif", "--model", MODEL];
    let begin = || {
        let mut child = elunar(at, &[&predict[..], &["--threads", "1", "-o", "dtm.tif"]].concat());
        let child = child.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let start = Instant::now();
        while std::fs::metadata(at.join("dtm.tif.part")).map_or(0, |found| found.len()) <= 48 {
            assert!(start.elapsed() < Duration::from_secs(120), "no rows");
            std::thread::sleep(Duration::from_millis(2));
        }
        child
    };
    let kill = |signal: &str, child: &std::process::Child| {
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    };
    for signal in ["-INT", "-TERM"] {
        let child = begin();
        kill(signal, &child);
        let out = child.wait_with_output().unwrap();
        let text = String::from_utf8_lossy(&out.stderr);
        assert!(
            out.status.code() == Some(75) && text.contains("the same command goes on from there"),
            "{signal}: {text}"
        );
        std::fs::remove_file(at.join("dtm.tif.part")).unwrap();
    }
    // The second signal must come before the tile is done: the program is halted in between.
    for (signal, code) in [("-INT", 130), ("-TERM", 143)] {
        let child = begin();
        kill(signal, &child);
        std::thread::sleep(Duration::from_millis(3));
        kill(signal, &child);
        let found = child.wait_with_output().unwrap().status.code();
        // A tile may have ended in between.
        assert!(found == Some(code) || found == Some(75), "{signal}: {found:?}");
        let _ = std::fs::remove_file(at.join("dtm.tif.part"));
    }
    assert!(!at.join("dtm.tif").exists());
}
