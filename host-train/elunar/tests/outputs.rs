//! Outputs as users meet them: who owns one, what is never replaced, and what an error looks like.

#![cfg(unix)]

mod common;

use common::command as elunar;
use std::os::unix::fs::{FileTypeExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const MODELS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../models");
/// The exit code that asks to try again.
const TRY_AGAIN: i32 = 75;
/// The exit code of an option that cannot be met.
const USAGE: i32 = 64;

/// Returns the text of a run's one error line.
fn error(out: &Output, code: i32) -> String {
    let text = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(code), "{text}");
    assert!(text.lines().count() == 1 && text.starts_with("ERROR: "), "{text}");
    text
}

fn refused(folder: &Path, words: &[&str]) -> String {
    error(&elunar(folder, words).output().unwrap(), USAGE)
}

/// A scene in a folder, and the words of `predict` that make `dtm.tif` of it.
struct Bench {
    folder: tempfile::TempDir,
    model: String,
}

impl Bench {
    fn new(rows: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let rows = rows.to_string();
        let made =
            elunar(folder.path(), &["synth", "--out", "s", "--rows", &rows, "--cols", "320", "--seed", "5"]).output();
        assert!(made.unwrap().status.success());
        Self { folder, model: PathBuf::from(MODELS).join("nano.eld").display().to_string() }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn predict<'a>(&'a self, more: &[&'a str]) -> Vec<&'a str> {
        let (image, coarse) = ("s/scene_0000_image.tif", "s/scene_0000_coarse.tif");
        let words = ["predict", "--image", image, "--coarse", coarse, "--model", &self.model, "--threads", "1"];
        [&words[..], &["-o", "dtm.tif"], more].concat()
    }

    fn run(&self, words: &[&str]) -> Output {
        elunar(self.folder.path(), words).output().unwrap()
    }

    /// Starts a prediction and waits until it has finished rows.
    fn begin(&self, more: &[&str]) -> std::process::Child {
        let mut child = elunar(self.folder.path(), &self.predict(more));
        let child = child.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let (start, part) = (Instant::now(), self.at("dtm.tif.part"));
        while std::fs::metadata(&part).map_or(0, |found| found.len()) <= 48 {
            assert!(start.elapsed() < Duration::from_secs(120), "no rows");
            std::thread::sleep(Duration::from_millis(2));
        }
        child
    }
}

#[test]
fn two_predictions_of_one_output_never_mix() {
    // Long enough for two other commands, on a busy machine, too.
    let bench = Bench::new(3000);
    let mut first = bench.begin(&[]);
    let second = bench.run(&bench.predict(&["--no-anchor"]));
    let text = error(&second, TRY_AGAIN);
    assert!(
        text.contains("dtm.tif: another run writes it: process ") && text.contains(&first.id().to_string()),
        "{text}"
    );
    // Other commands ask for the same right, and another name of the file is the same file.
    std::fs::create_dir(bench.at("sub")).unwrap();
    let shade = bench.run(&["hillshade", "s/scene_0000_truth.tif", "-o", "sub/../dtm.tif"]);
    error(&shade, TRY_AGAIN);
    assert!(first.wait().unwrap().success());
    let found = std::fs::read(bench.at("dtm.tif")).unwrap();
    std::fs::remove_file(bench.at("dtm.tif")).unwrap();
    assert!(bench.run(&bench.predict(&[])).status.success());
    assert!(std::fs::read(bench.at("dtm.tif")).unwrap() == found, "the survivor is not what one run alone makes");
    for left in ["dtm.tif.lock", "dtm.tif.part"] {
        assert!(!bench.at(left).exists(), "{left} was left");
    }
}

#[test]
fn the_lock_of_a_killed_run_is_no_obstacle() {
    let bench = Bench::new(1200);
    let mut killed = bench.begin(&[]);
    killed.kill().unwrap();
    killed.wait().unwrap();
    let lock = std::fs::read_to_string(bench.at("dtm.tif.lock")).unwrap();
    assert!(lock.contains(&format!("\npid {}\n", killed.id())), "{lock}");
    let out = bench.run(&bench.predict(&[]));
    let text = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success() && text.contains("going on after row"), "{text}");
    assert!(!bench.at("dtm.tif.lock").exists());
}

#[test]
fn a_lock_of_another_machine_counts() {
    let bench = Bench::new(256);
    let record = "elunar owner 1\nhost elsewhere\nboot b\nnamespace pid:[1]\npid 7\nprocess-start 9\nsince 1\n";
    std::fs::write(bench.at("dtm.tif.lock"), record).unwrap();
    let text = error(&bench.run(&bench.predict(&[])), TRY_AGAIN);
    assert!(
        text.contains("process 7 on elsewhere") && text.contains("if that run is gone, remove dtm.tif.lock"),
        "{text}"
    );
    assert!(!bench.at("dtm.tif").exists());
}

#[test]
fn nothing_but_a_regular_file_is_replaced() {
    let bench = Bench::new(256);
    let at = bench.folder.path();
    assert!(Command::new("mkfifo").arg(bench.at("fifo.tif")).status().unwrap().success());
    std::fs::create_dir(bench.at("folder.tif")).unwrap();
    std::fs::write(bench.at("victim"), "precious").unwrap();
    symlink(bench.at("victim"), bench.at("link.tif")).unwrap();
    symlink("/dev/null", bench.at("device.tif")).unwrap();
    let truth = "s/scene_0000_truth.tif";
    let kinds = [
        ("fifo.tif", "FIFO"),
        ("folder.tif", "folder"),
        ("link.tif", "link"),
        ("device.tif", "link"),
        ("/dev/null", "device"),
    ];
    for (output, kind) in kinds {
        let commands: [&[&str]; 5] = [
            &["hillshade", truth, "-o", output],
            &["mosaic", truth, "-o", output],
            &["render", truth, "--sun-azimuth", "10", "--sun-elevation", "30", "-o", output],
            &["diff", truth, truth, "-o", output],
            &bench.predict(&[])[..9],
        ];
        for (index, words) in commands.iter().enumerate() {
            // Commands that decide by the name's ending refuse a device for its name.
            if output == "/dev/null" && index != 3 {
                continue;
            }
            let words = if index == 4 { [words, &["-o", output][..]].concat() } else { words.to_vec() };
            let text = refused(at, &words);
            let expected = format!("{output}: a regular file or nothing expected, a {kind} found");
            assert!(text.contains(&expected), "{words:?}: {text}");
        }
    }
    // As an image, a FIFO would wait for a writer.
    for (input, kind) in [("fifo.tif", "FIFO"), ("folder.tif", "folder"), ("/dev/null", "device")] {
        let text = error(&elunar(at, &["hillshade", input, "-o", "new.tif"]).output().unwrap(), 65);
        assert!(text.contains(&format!("{input}: a file expected, found a {kind}")), "{text}");
    }
    let nano = PathBuf::from(MODELS).join("nano.safetensors").display().to_string();
    let text = refused(at, &["export", "--weights", &nano, "-o", "/dev/null"]);
    assert!(text.contains("a device found"), "{text}");
    symlink(bench.at("victim"), bench.at("dtm_hillshade.png")).unwrap();
    let text = refused(at, &bench.predict(&[]));
    assert!(text.contains("dtm_hillshade.png: a regular file or nothing expected, a link found"), "{text}");
    assert!(std::fs::symlink_metadata(bench.at("fifo.tif")).unwrap().file_type().is_fifo());
    assert_eq!(std::fs::read(bench.at("victim")).unwrap(), b"precious");
}

#[test]
fn a_link_planted_at_the_part_file_is_not_followed() {
    let bench = Bench::new(256);
    std::fs::write(bench.at("victim"), "precious").unwrap();
    for hard in [false, true] {
        let planted = if hard { std::fs::hard_link } else { symlink::<PathBuf, PathBuf> };
        planted(bench.at("victim"), bench.at("dtm.tif.part")).unwrap();
        let text = refused(bench.folder.path(), &bench.predict(&[]));
        assert!(text.contains("dtm.tif.part: a "), "{text}");
        assert_eq!(std::fs::read(bench.at("victim")).unwrap(), b"precious");
        std::fs::remove_file(bench.at("dtm.tif.part")).unwrap();
    }
    assert!(bench.run(&bench.predict(&[])).status.success());
}

#[test]
fn inputs_are_never_written_under_any_name_of_an_output() {
    let bench = Bench::new(256);
    let at = bench.folder.path();
    let coarse = std::fs::read(bench.at("s/scene_0000_coarse.tif")).unwrap();
    let unharmed = |name: &str, words: &[&str]| {
        let text = refused(at, words);
        assert!(text.contains("an output must not overwrite an input"), "{name}: {text}");
        assert_eq!(std::fs::read(bench.at(name)).unwrap(), coarse, "{name}");
        assert!(!bench.at("dtm.tif").exists());
        std::fs::remove_file(bench.at(name)).unwrap();
    };
    let beside = ["dtm.tif.part", "dtm.tif.sha256", "dtm.tif.survey", "dtm.tif.lock", "dtm_hillshade.png"];
    for name in beside {
        std::fs::write(bench.at(name), &coarse).unwrap();
        // Another spelling of the same place.
        let spelled = format!("s/../{name}");
        let words = with_coarse(&bench, &spelled);
        let part = [&words[..], &["--part", "1/2"]].concat();
        let text = refused(at, &part);
        assert!(text.contains("an output must not overwrite an input"), "{name}: {text}");
        unharmed(name, &words);
    }
    // The image of a label, the table of a manifest.
    let label = "PDS_VERSION_ID = PDS3\r\n^IMAGE = \"dtm.tif\"\r\nOBJECT = IMAGE\r\nLINES = 2\r\nLINE_SAMPLES = 2\r\n\
        SAMPLE_TYPE = UNSIGNED_INTEGER\r\nSAMPLE_BITS = 8\r\nEND_OBJECT = IMAGE\r\nEND\r\n";
    std::fs::write(bench.at("label.lbl"), label).unwrap();
    std::fs::write(bench.at("dtm.tif"), [1, 2, 3, 4]).unwrap();
    let text = refused(at, &with_coarse(&bench, "label.lbl"));
    assert!(text.contains("an output must not overwrite an input"), "{text}");
    assert_eq!(std::fs::read(bench.at("dtm.tif")).unwrap(), [1, 2, 3, 4]);
    std::fs::write(bench.at("t.csv"), "image,coarse\n").unwrap();
    let words = ["manifest", "--table", "t.csv", "--model", "m.eld", "--output-dir", "d", "-o", "t.csv"];
    assert!(refused(at, &words).contains("must not overwrite"));
    assert_eq!(std::fs::read(bench.at("t.csv")).unwrap(), b"image,coarse\n");
}

/// Returns the words of a prediction with another coarse DTM.
fn with_coarse<'a>(bench: &'a Bench, coarse: &'a str) -> Vec<&'a str> {
    bench.predict(&[]).into_iter().map(|word| if word.ends_with("coarse.tif") { coarse } else { word }).collect()
}

#[test]
fn what_lies_beside_an_output_is_checked_before_the_work() {
    let bench = Bench::new(256);
    let at = bench.folder.path();
    std::fs::write(bench.at("dtm.tif.part"), "half a download").unwrap();
    let text = refused(at, &bench.predict(&[]));
    assert!(text.contains("dtm.tif.part: rows of an unfinished run expected, another file found"), "{text}");
    assert_eq!(std::fs::read(bench.at("dtm.tif.part")).unwrap(), b"half a download");
    std::fs::remove_file(bench.at("dtm.tif.part")).unwrap();
    assert!(Command::new("mkfifo").arg(bench.at("dtm.tif.sha256")).status().unwrap().success());
    let text = refused(at, &bench.predict(&[]));
    assert!(text.contains("dtm.tif.sha256: a regular file or nothing expected, a FIFO found"), "{text}");
    assert!(!bench.at("dtm.tif.part").exists());
    std::fs::remove_file(bench.at("dtm.tif.sha256")).unwrap();
    for (further, expected) in [
        (&["--uncertainty", "dtm.tif.part"][..], "a name ending in .tif or .tiff expected"),
        (&["--uncertainty", "s/../dtm.tif"], "must not overwrite an input or another output"),
        (&["--uncertainty", "no/e.tif"], "no/e.tif: the folder no expected, none found"),
    ] {
        let text = refused(at, &bench.predict(further));
        assert!(text.contains(expected), "{text}");
    }
    let left = std::fs::read_dir(at).unwrap().count();
    assert_eq!(left, 1, "only the scene");
}

/// What others have beside an output stays, and what a run wrote for its sake is replaced.
#[test]
fn beside_an_output_only_the_files_of_earlier_runs_are_replaced() {
    let bench = Bench::new(256);
    let at = bench.folder.path();
    let sfs = ["sfs", "--image", "s/scene_0000_image.tif", "--coarse", "s/scene_0000_coarse.tif", "-o", "dtm.tif"];
    let part = bench.predict(&["--part", "1/2"]);
    let errors = bench.predict(&["--uncertainty", "e.tif"]);
    for name in ["dtm_hillshade.png", "dtm.tif.sha256", "dtm.tif.survey", "e.tif.sha256", "dtm.tif.1-of-2.rows"] {
        std::fs::write(bench.at(name), "precious").unwrap();
        let whole = bench.predict(&[]);
        let words = match name {
            "e.tif.sha256" => vec![&errors[..]],
            "dtm.tif.1-of-2.rows" => vec![&part[..]],
            _ => vec![&whole[..], &part, &sfs],
        };
        for words in words {
            let text = refused(at, words);
            let expected = format!("{name}: a file of an earlier run or nothing expected, another one found");
            assert!(text.contains(&expected), "{words:?}: {text}");
        }
        // Beside a DTM of others, too, which may be replaced.
        if name != "dtm.tif.1-of-2.rows" {
            std::fs::copy(bench.at("s/scene_0000_truth.tif"), bench.at("dtm.tif")).unwrap();
            refused(at, if name == "e.tif.sha256" { &errors } else { &sfs });
            std::fs::remove_file(bench.at("dtm.tif")).unwrap();
        }
        assert_eq!(std::fs::read(bench.at(name)).unwrap(), b"precious");
        std::fs::remove_file(bench.at(name)).unwrap();
        assert_eq!(std::fs::read_dir(at).unwrap().count(), 1, "only the scene");
    }
    std::fs::copy(bench.at("s/scene_0000_truth.tif"), bench.at("dtm.tif")).unwrap();
    assert!(bench.run(&bench.predict(&[])).status.success(), "the output itself is replaced");
    assert!(bench.run(&bench.predict(&["--no-anchor"])).status.success(), "and so is what a run wrote");
    std::fs::remove_file(bench.at("dtm.tif")).unwrap();
    assert!(bench.run(&bench.predict(&[])).status.success(), "its SHA-256 says whose the hillshade is");
    std::fs::remove_file(bench.at("dtm.tif")).unwrap();
    assert!(bench.run(&part).status.success() && bench.run(&part).status.success(), "a survey and rows");
}

#[test]
fn files_that_are_too_large_are_refused_unread() {
    let bench = Bench::new(256);
    for name in ["m.eld", "m.safetensors"] {
        std::fs::File::create(bench.at(name)).unwrap().set_len(20 << 30).unwrap();
        for words in [&["inspect", name][..], &["latency", "--model", name]] {
            let out = bench.run(words);
            let text = error(&out, 65);
            assert!(text.contains(name), "{text}");
            assert!(name.ends_with("safetensors") || text.contains("at most 4294967296 bytes expected"), "{text}");
        }
    }
}

#[test]
fn a_full_standard_output_is_one_error_line() {
    if !Path::new("/dev/full").exists() {
        elunar_testing::skipped("a_full_standard_output_is_one_error_line", "no /dev/full here");
        return;
    }
    let bench = Bench::new(256);
    let truth = "s/scene_0000_truth.tif";
    let commands: [&[&str]; 5] = [
        &["--version"],
        &["help"],
        &["diff", truth, truth],
        &["evaluate", "--dtm", truth, "--truth", truth],
        &["hillshade", truth, "-o", "shade.tif"],
    ];
    for words in commands {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let out = elunar(bench.folder.path(), words).stdout(full).output().unwrap();
        let text = error(&out, TRY_AGAIN);
        assert!(text.contains("standard output: No space left on device"), "{text}");
    }
    assert!(!bench.at("shade.tif.lock").exists());
}

#[test]
fn refused_memory_is_one_error_line() {
    let bench = Bench::new(256);
    // From hardly enough to load the program up to enough for everything.
    let (mut refusals, mut successes) = (0, 0);
    for kib in (29_000..59_000).step_by(2_000).chain([2_000_000]) {
        let limit = format!("ulimit -v {kib} || exit 99; exec \"$@\"");
        let mut shell = Command::new("sh");
        shell.current_dir(bench.folder.path()).args(["-c", &limit, "sh", env!("CARGO_BIN_EXE_elunar")]);
        let out = shell.args(bench.predict(&[])).output().unwrap();
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        match out.status.code() {
            Some(99) => {
                elunar_testing::skipped("refused_memory_is_one_error_line", &format!("no ulimit -v here ({text})"));
                return;
            }
            Some(0) => successes += 1,
            // The loader's own message, before the program begins.
            Some(127) if text.contains("cannot allocate memory") || text.contains("failed to map segment") => {}
            // The end of Rust's runtime, before `main` begins.
            None if text.contains("failed to allocate an alternative stack") => {}
            // The C library's own end, when a thread begins without memory.
            None if text.contains("Fatal glibc error") => {}
            code => {
                assert!(code == Some(71), "{kib} KiB: {code:?} {:?}: {text}", out.status);
                // The C library may say its own words while the program ends.
                let others = ["dtm.tif.part: going on", "Fatal glibc error"];
                let errors = text.lines().filter(|line| !others.iter().any(|other| line.starts_with(other))).count();
                assert!(errors == 1 && text.contains("ERROR: ") && !text.contains("panicked"), "{kib} KiB: {text}");
                refusals += 1;
            }
        }
    }
    assert!(refusals > 3 && successes > 0, "{refusals} refusals, {successes} successes");
}
