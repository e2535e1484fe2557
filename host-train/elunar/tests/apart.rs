//! Manifests of which an item would write what another one reads. The campaign is a command:
//!
//! ```sh
//! cargo test -p elunar --test apart -- --ignored --nocapture
//! ```

#![cfg(unix)]

mod common;

use common::command;
use std::os::unix::fs::symlink;
use std::path::Path;

/// Files that are written for `d/b.tif`, and for its expected errors, `d/e.tif`.
const WRITTEN: [&str; 11] = [
    "b.tif",
    "b.tif.lock",
    "b.tif.part",
    "b.tif.sha256",
    "b.tif.survey",
    "b.tif.survey.lock",
    "b_hillshade.png",
    "e.tif",
    "e.tif.lock",
    "e.tif.part",
    "e.tif.sha256",
];
/// What reads a file: a field of an item, or a label that the field names.
const READERS: [&str; 5] = ["image", "coarse", "model", "image label", "coarse label"];
/// How the file to read and the file to write are one.
const WAYS: [&str; 6] = ["name", "spelling", "link to it", "link at it", "hard link", "link to its folder"];
const LABEL: &str = "PDS_VERSION_ID = PDS3\r\n^IMAGE = \"NAME\"\r\nOBJECT = IMAGE\r\nLINES = 2\r\nLINE_SAMPLES = 4\r\n\
    SAMPLE_TYPE = UNSIGNED_INTEGER\r\nSAMPLE_BITS = 8\r\nEND_OBJECT = IMAGE\r\nEND\r\n";
const PRECIOUS: &[u8] = b"precious";

/// Makes a folder of which `written` is read, and returns the path of who reads it.
fn plant(at: &Path, written: &str, reader: &str, way: &str) -> String {
    for folder in ["d", "in"] {
        std::fs::create_dir(at.join(folder)).unwrap();
    }
    for file in ["i.tif", "j.tif", "c.tif", "m.eld"] {
        std::fs::write(at.join(file), "x").unwrap();
    }
    symlink("d", at.join("ln")).unwrap();
    let (there, elsewhere) = (at.join("d").join(written), at.join("in/victim"));
    std::fs::write(if way == "link at it" { &elsewhere } else { &there }, PRECIOUS).unwrap();
    let is_label = reader.ends_with("label");
    let (folder, name) = match way {
        "name" => ("d", written),
        "spelling" => ("no/.././d/../d", written),
        "link to its folder" => ("ln", written),
        _ => ("in", "victim"),
    };
    match way {
        "link to it" => symlink(&there, &elsewhere).unwrap(),
        "link at it" => symlink(&elsewhere, &there).unwrap(),
        "hard link" => std::fs::hard_link(&there, &elsewhere).unwrap(),
        _ => {}
    }
    if !is_label {
        return format!("{folder}/{name}");
    }
    // A label is a file beside its image.
    let label = if folder == "in" { "in/l.lbl" } else { "d/l.lbl" };
    std::fs::write(at.join(label), LABEL.replace("NAME", name)).unwrap();
    // The folder that the spelling passes is not there, so that a label is not either.
    if folder == "ln" { "ln/l.lbl".into() } else { label.into() }
}

/// Returns the manifest of two items. The first one reads `read`, the second one writes `d/b.tif` and `d/e.tif`.
fn manifest(reader: &str, read: &str, swapped: bool) -> String {
    let field = reader.split(' ').next().unwrap();
    let mut first =
        serde_json::json!({"id": "a", "image": "i.tif", "coarse": "c.tif", "model": "m.eld", "output": "o/a.tif"});
    first[field] = read.into();
    let second = serde_json::json!({"id": "b", "image": "j.tif", "coarse": "c.tif", "model": "m.eld", "output": "d/b.tif",
        "options": {"uncertainty": "d/e.tif"}});
    if swapped { format!("{second}\n{first}\n") } else { format!("{first}\n{second}\n") }
}

fn files(at: &Path) -> Vec<(std::path::PathBuf, Vec<u8>)> {
    let mut all: Vec<_> = ["", "d", "in"]
        .iter()
        .flat_map(|folder| std::fs::read_dir(at.join(folder)).unwrap().map(|entry| entry.unwrap().path()))
        .map(|path| (path.clone(), std::fs::read(&path).unwrap_or_default()))
        .collect();
    all.sort();
    all
}

/// Expects that every command refuses the manifest, names both lines, and changes nothing.
fn refused(written: &str, reader: &str, way: &str, swapped: bool) {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let read = plant(at, written, reader, way);
    std::fs::write(at.join("m.jsonl"), manifest(reader, &read, swapped)).unwrap();
    let before = files(at);
    let lines = if swapped { ["line 1, ", "line 2, "] } else { ["line 2, ", "line 1, "] };
    let case = format!("{written}, {reader}, {way}");
    for words in [
        &["manifest", "--check", "m.jsonl"][..],
        &["batch", "--manifest", "m.jsonl"],
        // The chunk of neither.
        &["batch", "--manifest", "m.jsonl", "--chunk", "3/3"],
        &["status", "--manifest", "m.jsonl", "--done", "list.txt"],
    ] {
        let out = command(at, words).output().unwrap();
        let text = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.code() == Some(65) && text.lines().count() == 1, "{case}: {words:?}: {text}");
        let (writer, by) = text.split_once(" would be written, which ").unwrap_or_else(|| panic!("{case}: {text}"));
        assert!(writer.contains(lines[0]) && by.contains(lines[1]), "{case}: {text}");
        assert_eq!(files(at), before, "{case}: {words:?}");
    }
}

#[test]
fn no_item_writes_what_another_one_reads() {
    for (index, written) in WRITTEN.iter().enumerate() {
        refused(written, READERS[index % READERS.len()], WAYS[index % WAYS.len()], index % 2 == 0);
    }
    refused("b.tif", "image label", "hard link", false);
    refused("b.tif", "coarse", "link at it", true);
}

#[test]
#[ignore = "a campaign: minutes"]
fn every_file_every_reader_every_way() {
    let mut cases = 0;
    for written in WRITTEN {
        for reader in READERS {
            for way in WAYS {
                for swapped in [false, true] {
                    refused(written, reader, way, swapped);
                    cases += 1;
                }
            }
        }
    }
    println!("{cases} manifests, all refused, nothing changed");
}

#[test]
fn items_that_are_apart_are_accepted() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    plant(at, "b.tif", "image", "name");
    for read in ["i.tif", "d/b.tiff", "d/B.tif", "b.tif", "d/c.tif"] {
        std::fs::write(at.join("m.jsonl"), manifest("image", read, false)).unwrap();
        let out = command(at, &["manifest", "--check", "m.jsonl"]).output().unwrap();
        assert!(out.status.success(), "{read}: {}", String::from_utf8_lossy(&out.stderr));
    }
}

#[test]
fn a_manifest_that_would_lose_a_file_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    // One sample of a .npy array: whatever their names, these are rasters, and `manifest` states their SHA-256.
    let header = format!("{:<118}", "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1), }");
    let raster = [b"\x93NUMPY\x01\0\x76\0", header.as_bytes(), &1.0_f32.to_le_bytes()].concat();
    for file in ["i.tif", "j.tif", "c.tif", "m.eld"] {
        std::fs::write(at.join(file), &raster).unwrap();
    }
    let table = |rows: &str| std::fs::write(at.join("t.csv"), format!("id,image,coarse,model,output\n{rows}")).unwrap();
    let words = |output| ["manifest", "--table", "t.csv", "-o", output];
    let refused = |output, code, expected: &str| {
        let out = command(at, &words(output)).output().unwrap();
        let text = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.code() == Some(code) && text.contains(expected), "{output}: {text}");
        for file in ["i.tif", "j.tif", "c.tif", "m.eld"] {
            assert_eq!(std::fs::read(at.join(file)).unwrap(), raster, "{output}: {file}");
        }
    };
    table("a,i.tif,c.tif,m.eld,o/a.tif\nb,j.tif,c.tif,m.eld,c.tif\n");
    std::fs::write(at.join("m.jsonl"), "an older one").unwrap();
    refused("m.jsonl", 65, "line 2, field output");
    assert_eq!(std::fs::read(at.join("m.jsonl")).unwrap(), b"an older one");
    // The manifest itself replaces no image, and no DTM.
    table("a,i.tif,c.tif,m.eld,o/a.tif\n");
    refused("i.tif", 64, "--output: i.tif would be written, which is read by line 1, field image");
    std::fs::create_dir(at.join("o")).unwrap();
    refused("o/a.tif", 64, "--output: o/a.tif would be written, which is also written by line 1, field output");
}

#[test]
fn status_replaces_neither_manifest_nor_log() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(at.join("m.jsonl"), manifest("image", "i.tif", false)).unwrap();
    std::fs::write(at.join("log"), "").unwrap();
    for output in ["m.jsonl", "log", "i.tif", "d/b.tif.part"] {
        for option in ["--done", "--resubmit", "--html"] {
            if option == "--resubmit" && output.contains('/') {
                continue;
            }
            let out = command(at, &["status", "--manifest", "m.jsonl", "log", option, output]).output().unwrap();
            let text = String::from_utf8_lossy(&out.stderr);
            assert!(
                matches!(out.status.code(), Some(64 | 65)) && text.contains(" would be written, which is "),
                "{output}: {text}"
            );
        }
    }
    let text = std::fs::read_to_string(at.join("m.jsonl")).unwrap();
    assert_eq!(text, manifest("image", "i.tif", false));
}

/// The inputs of a trial, where they are there.
#[test]
fn the_manifests_of_the_trial_are_refused() {
    let Some(shared) =
        elunar_testing::shared_folder().map(|folder| folder.join("files/user/lost")).filter(|at| at.is_dir())
    else {
        elunar_testing::skipped("the_manifests_of_the_trial_are_refused", "no folder of shared files");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for entry in std::fs::read_dir(shared).unwrap().map(Result::unwrap) {
        std::fs::copy(entry.path(), at.join(entry.file_name())).unwrap();
    }
    std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/../models/nano.eld"), at.join("nano.eld")).unwrap();
    for manifest in ["m.jsonl", "m2.jsonl"] {
        for words in [["manifest", "--check", manifest], ["batch", "--manifest", manifest]] {
            let out = command(at, &words).output().unwrap();
            let text = String::from_utf8_lossy(&out.stderr);
            assert!(out.status.code() == Some(65) && text.contains("line 2, field output"), "{words:?}: {text}");
        }
    }
    assert!(!at.join("d").exists());
}
