//! Folders in which something of others lies where a command would write. The campaign is a command:
//!
//! ```sh
//! cargo test -p host-train --test foreign -- --ignored --nocapture
//! ```
#![cfg(unix)]

use std::collections::BTreeMap;
use std::os::unix::fs::symlink;
use std::path::Path;
use support::Shell;

mod support;

/// A command that fills the folder `out`.
struct Job {
    words: Vec<&'static str>,
    /// Names of what it writes and removes again; those that end with `/` are folders that it removes.
    passing: &'static [&'static str],
    /// Whether the same command is refused in its own finished folder.
    is_once: bool,
}

const LIST: &str = "name = 'two'\n[[scene]]\nname = 'a'\nground = 'g'\nsynth = { seed = 1, options = { rows = 64, cols = 80, sun_azimuth_deg = [90, 90] } }\n\
    [[scene]]\nname = 'b'\nground = 'g'\nsynth = { seed = 1, options = { rows = 64, cols = 80, sun_azimuth_deg = [270, 270] } }\n";

fn jobs() -> Vec<Job> {
    let job = |words: &'static str, passing, is_once| Job { words: words.split(' ').collect(), passing, is_once };
    let scene = "prepare --image s/scene_0000_image.tif --coarse s/scene_0000_coarse.tif --dtm s/scene_0000_truth.tif --shard-tiles 1 --out out";
    let train = "train --start-from small.safetensors --steps 1 --batch 1 --set recipe.crop=[32,32] recipe.crops_per_tile=8 recipe.pool=1 \
        recipe.balanced=false recipe.validation_tiles=1 --profile --out out";
    vec![
        job("synth --scenes 2 --rows 40 --cols 50 --out out", &[], false),
        job(scene, &["unfinished/", "unfinished/plan", "unfinished/scene_0000.json", "train-00099.safetensors"], false),
        job(
            train,
            &[
                "checkpoint.new/",
                "checkpoint.new/state.json",
                "checkpoint.old/",
                "checkpoint.old/weights.safetensors",
                "checkpoint/",
                "curves.png",
            ],
            true,
        ),
        job("suite --suite list.toml --model small.safetensors --threads 1 --out out", &["scenes/scenes.csv"], false),
        job("suite --suite list.toml --scenes-only --out out", &[], false),
        job("faults nano.eld --injections 7 --threads 1 --out out", &[], false),
        job(
            "experiment e.toml --steps 1 --suite list.toml --threads 1 --out out",
            &["e/training/checkpoint.new/"],
            false,
        ),
        job("demo --steps 1 --out out", &["training/checkpoint.new/"], false),
    ]
}

/// Returns a folder with what the jobs read.
fn bench() -> Shell {
    let shell = Shell::with_scene("520", "650");
    let full = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/experiments/full.toml")).unwrap();
    let small = [("validation_tiles = 32", "validation_tiles = 1"), ("batch = 2", "batch = 1")];
    std::fs::write(shell.path("e.toml"), small.iter().fold(full, |text, (from, to)| text.replace(from, to))).unwrap();
    std::fs::write(shell.path("list.toml"), LIST).unwrap();
    shell
}

/// Returns all that lies in a folder, by names: the bytes of files, where links lead, folders with a `/`.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    fn add(at: &Path, name: &str, to: &mut BTreeMap<String, Vec<u8>>) {
        for entry in std::fs::read_dir(at).unwrap().map(Result::unwrap) {
            let name = format!("{name}{}", entry.file_name().to_str().unwrap());
            let kind = entry.file_type().unwrap();
            if kind.is_symlink() {
                let to_what = std::fs::read_link(entry.path()).unwrap();
                to.insert(name + "@", to_what.to_str().unwrap().into());
            } else if kind.is_dir() {
                add(&entry.path(), &format!("{name}/"), to);
                to.insert(name + "/", vec![]);
            } else {
                to.insert(name, std::fs::read(entry.path()).unwrap());
            }
        }
    }
    let mut all = BTreeMap::new();
    add(folder, "", &mut all);
    all
}

fn clear(shell: &Shell) {
    let out = shell.path("out");
    if out.exists() {
        std::fs::remove_dir_all(out).unwrap();
    }
}

/// Runs a job in a new folder, and once more in its own. Returns the names of all files that it writes, after a check that its lists name them.
fn written(shell: &Shell, job: &Job) -> Vec<String> {
    clear(shell);
    let notes = ["notes.txt", "scenes/notes.txt", "training/notes.txt"].map(|name| shell.path("out").join(name));
    for note in &notes {
        std::fs::create_dir_all(note.parent().unwrap()).unwrap();
        std::fs::write(note, "mine").unwrap();
    }
    for round in 0..2 {
        let out = shell.run(&job.words);
        let text = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.success() || (round == 1 && job.is_once), "{:?} {round}: {text}", job.words);
    }
    assert!(notes.iter().all(|note| std::fs::read(note).unwrap() == b"mine"), "{:?}", job.words);
    let found: Vec<String> = contents(&shell.path("out")).into_keys().filter(|name| !name.ends_with('/')).collect();
    let mut listed = vec![];
    for list in found.iter().filter(|name| name.ends_with(".files")) {
        let folder = list.rsplit_once('/').map_or("", |(folder, _)| folder);
        let text = std::fs::read_to_string(shell.path("out").join(list)).unwrap();
        let names = text.lines().skip(1).filter(|name| !name.ends_with('/'));
        listed.extend(names.map(|name| if folder.is_empty() { name.into() } else { format!("{folder}/{name}") }));
        listed.push(list.clone());
    }
    listed.sort();
    let own: Vec<String> = found.into_iter().filter(|name| !name.ends_with("notes.txt")).collect();
    assert_eq!(listed, own, "{:?}", job.words);
    own
}

const KINDS: [&str; 5] = ["file", "folder", "link", "link to nothing", "hard link"];

/// Plants something at a name.
fn plant(shell: &Shell, name: &str, kind: &str) {
    let path = shell.path("out").join(name.trim_end_matches('/'));
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let victim = shell.path("victim");
    match kind {
        "file" => std::fs::write(&path, "precious").unwrap(),
        "folder" => {
            std::fs::create_dir(&path).unwrap();
            std::fs::write(path.join("precious"), "precious").unwrap();
        }
        // A link to a folder, where a folder is written.
        "link" if name.ends_with('/') => symlink(shell.path("victims"), &path).unwrap(),
        "link" => symlink(&victim, &path).unwrap(),
        "link to nothing" => symlink(shell.path("nothing"), &path).unwrap(),
        _ => std::fs::hard_link(&victim, &path).unwrap(),
    }
}

/// Expects that a job is refused beside what was planted, and changes nothing.
fn refused(shell: &Shell, job: &Job, name: &str, kind: &str) {
    clear(shell);
    for folder in ["victims", "out"] {
        let _ = std::fs::create_dir(shell.path(folder));
    }
    std::fs::write(shell.path("victim"), "precious").unwrap();
    plant(shell, name, kind);
    let before = contents(&shell.path("."));
    let out = shell.run(&job.words);
    let text = String::from_utf8(out.stderr).unwrap();
    // Training says first what it would train.
    let errors: Vec<&str> = text.lines().filter(|line| line.starts_with("ERROR: ")).collect();
    let is_one =
        errors.len() == 1 && errors[0].starts_with("ERROR: out") && text.ends_with(&format!("{}\n", errors[0]));
    assert!(is_one && matches!(out.status.code(), Some(64 | 65)), "{:?}, {kind} at {name}: {text}", job.words);
    let after = contents(&shell.path("."));
    let changed: Vec<&String> =
        before.keys().chain(after.keys()).filter(|name| before.get(*name) != after.get(*name)).collect();
    assert!(changed.is_empty(), "{:?}, {kind} at {name}: {changed:?}", job.words);
}

/// Returns the names at which something may be planted: of files, of folders that are removed, and of folders of files.
fn names(job: &Job, written: &[String]) -> Vec<(String, Vec<&'static str>)> {
    let mut all: Vec<(String, Vec<&str>)> = vec![];
    let files = written.iter().map(String::as_str).chain(job.passing.iter().copied());
    for name in files.chain(["owner.lock"]) {
        // A folder has no second name.
        let kinds = KINDS.iter().filter(|kind| !name.ends_with('/') || **kind != "hard link");
        all.push((name.into(), kinds.copied().collect()));
        let parent = name.trim_end_matches('/').rsplit_once('/').map(|(parent, _)| format!("{parent}/"));
        if let Some(parent) = parent.filter(|parent| all.iter().all(|(name, _)| name != parent)) {
            // The folder of others may be used, if nothing in it is replaced.
            all.push((parent, vec!["file", "link", "link to nothing"]));
        }
    }
    all
}

#[test]
fn what_others_have_in_a_folder_is_neither_replaced_nor_removed() {
    let shell = bench();
    let all = jobs();
    let command = |name: &str| all.iter().find(|job| job.words[0] == name).unwrap();
    for (name, every) in [("synth", 1), ("prepare", 2), ("suite", 9), ("train", 9)] {
        let job = command(name);
        let cases = names(job, &written(&shell, job));
        for (index, (name, kinds)) in cases.iter().enumerate().step_by(every) {
            refused(&shell, job, name, kinds[index / every % kinds.len()]);
        }
    }
    for (name, file, kind) in [
        ("faults", "faults.md", "file"),
        ("faults", "injections.csv", "link"),
        ("experiment", "comparison.csv", "file"),
        ("experiment", "e/experiment.json", "link to nothing"),
        ("experiment", "e/training/best.safetensors", "file"),
        ("experiment", "test/results.json", "hard link"),
        ("experiment", "e/", "link"),
        ("experiment", "e/training/", "link"),
        ("experiment", "test/", "link to nothing"),
        ("demo", "image.png", "file"),
        ("demo", "manifest.json", "link"),
        ("demo", "training/", "link"),
        ("demo", "training/best.safetensors", "file"),
        ("demo", "training/checkpoint/", "folder"),
    ] {
        refused(&shell, command(name), file, kind);
    }
}

#[test]
#[ignore = "a campaign: minutes"]
fn every_command_every_name_every_kind() {
    let shell = bench();
    let asked =
        |job: &Job| std::env::var("ELUNAR_JOBS").map_or(true, |all| all.split(',').any(|name| name == job.words[0]));
    for job in jobs().into_iter().filter(asked) {
        let (mut count, cases) = (0, names(&job, &written(&shell, &job)));
        for (name, kinds) in &cases {
            kinds.iter().for_each(|kind| refused(&shell, &job, name, kind));
            count += kinds.len();
        }
        println!("{}: {count} refusals at {} names, nothing changed", job.words.join(" "), cases.len());
    }
}
