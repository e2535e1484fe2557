//! One image in parts, and work that is recognised by its contents.

mod common;

use common::{elunar, made};
use std::path::PathBuf;

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/nano.eld");

/// A scene in a folder.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new(rows: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        made(folder.path(), &["synth", "--out", "s", "--rows", rows, "--cols", "330", "--seed", "5"]);
        Self { folder }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Returns the words of a command with the scene's inputs.
    fn words<'a>(&self, first: &[&'a str], output: &'a str, more: &[&'a str]) -> Vec<&'a str> {
        let inputs = ["--image", "s/scene_0000_image.tif", "--coarse", "s/scene_0000_coarse.tif", "--model", MODEL];
        [first, &inputs, &["-o", output], more].concat()
    }

    fn predict(&self, output: &str, more: &[&str]) -> String {
        made(self.folder.path(), &self.words(&["predict"], output, more))
    }

    fn changed(&self, name: &str) -> std::time::SystemTime {
        std::fs::metadata(self.at(name)).unwrap().modified().unwrap()
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.at(name)).unwrap()
    }
}

#[test]
fn any_number_of_parts_has_the_bytes_of_the_whole() {
    let bench = Bench::new("900");
    for uncertainty in [&[][..], &["--uncertainty", "errors.tif"]] {
        let _ = std::fs::create_dir(bench.at("whole"));
        bench.predict("whole/dtm.tif", &[]);
        let whole = (bench.bytes("whole/dtm.tif"), bench.bytes("whole/dtm_hillshade.png"));
        for n in [1, 2, 5, 9] {
            for k in (1..=n).rev() {
                let part = format!("{k}/{n}");
                bench.predict("dtm.tif", &[&["--part", &part], uncertainty].concat());
            }
            let count = n.to_string();
            made(bench.folder.path(), &bench.words(&["join", "--parts", &count], "dtm.tif", uncertainty));
            let found = (bench.bytes("dtm.tif"), bench.bytes("dtm_hillshade.png"));
            if uncertainty.is_empty() {
                assert!(found == whole, "{n} parts");
            } else {
                let of_parts = bench.bytes("errors.tif");
                for name in ["dtm.tif", "errors.tif"] {
                    std::fs::remove_file(bench.at(name)).unwrap();
                }
                bench.predict("dtm.tif", uncertainty);
                assert!(bench.bytes("dtm.tif") == found.0 && bench.bytes("errors.tif") == of_parts, "{n} parts");
            }
            let left: Vec<PathBuf> = std::fs::read_dir(bench.folder.path())
                .unwrap()
                .map(|entry| entry.unwrap().path())
                .filter(|path| ["rows", "part", "survey"].iter().any(|what| path.to_string_lossy().contains(what)))
                .collect();
            assert!(left.is_empty(), "{left:?}");
            std::fs::remove_file(bench.at("dtm.tif")).unwrap();
        }
    }
}

#[test]
fn a_missing_or_foreign_part_is_named_and_no_dtm_is_made() {
    let bench = Bench::new("600");
    let join = bench.words(&["join", "--parts", "2"], "dtm.tif", &[]);
    bench.predict("dtm.tif", &["--part", "1/2"]);
    let out = elunar(bench.folder.path(), &join);
    let text = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.code() == Some(65) && text.contains("dtm.tif.2-of-2.rows"), "{text}");
    bench.predict("dtm.tif", &["--part", "2/2", "--no-anchor"]);
    let out = elunar(bench.folder.path(), &join);
    let text = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.code() == Some(65) && text.contains("another job"), "{text}");
    // Parts of one job share a survey; those of another make theirs.
    bench.predict("dtm.tif", &["--part", "2/3"]);
    let (survey, made_at) = (bench.bytes("dtm.tif.survey"), bench.changed("dtm.tif.survey"));
    bench.predict("dtm.tif", &["--part", "3/3"]);
    assert!(bench.bytes("dtm.tif.survey") == survey && bench.changed("dtm.tif.survey") == made_at);
    bench.predict("dtm.tif", &["--part", "3/3", "--no-anchor"]);
    assert!(bench.bytes("dtm.tif.survey") != survey);
    // A finished part is not made again, a foreign one is.
    assert!(bench.predict("dtm.tif", &["--part", "1/2"]).contains("finished before"));
    assert!(!bench.predict("dtm.tif", &["--part", "2/2"]).contains("finished before"));
    // A part that was cut is no part.
    let whole = bench.bytes("dtm.tif.2-of-2.rows");
    std::fs::write(bench.at("dtm.tif.2-of-2.rows"), &whole[..whole.len() - 100]).unwrap();
    let out = elunar(bench.folder.path(), &join);
    let text = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.code() == Some(65) && text.contains("broken file"), "{text}");
    assert!(!bench.at("dtm.tif").exists());
    assert!(!bench.predict("dtm.tif", &["--part", "2/2"]).contains("finished before"));
    made(bench.folder.path(), &join);
    assert!(bench.at("dtm.tif").exists());
}

#[test]
fn finished_work_is_recognised_by_its_contents_alone() {
    let bench = Bench::new("300");
    let first = bench.predict("dtm.tif", &[]);
    assert!(!first.contains("finished before"), "{first}");
    let dtm = bench.bytes("dtm.tif");
    let sum = String::from_utf8(bench.bytes("dtm.tif.sha256")).unwrap();
    assert!(sum.ends_with("  dtm.tif\n") && sum.len() == 64 + 10, "{sum}");
    let again = |more: &[&str]| !bench.predict("dtm.tif", more).contains("finished before");
    assert!(!again(&[]), "nothing has changed");
    assert!(!again(&["--threads", "1"]), "threads change nothing");
    // Another path and another time of the same content.
    std::fs::rename(bench.at("s"), bench.at("t")).unwrap();
    std::fs::create_dir(bench.at("s")).unwrap();
    for name in ["scene_0000_image.tif", "scene_0000_coarse.tif"] {
        std::fs::copy(bench.at("t").join(name), bench.at("s").join(name)).unwrap();
    }
    assert!(!again(&[]), "the same bytes");
    assert!(again(&["--no-anchor"]), "another option");
    assert!(again(&[]), "the DTM is that of another option");
    assert!(bench.bytes("dtm.tif") == dtm);
    // A DTM that was damaged on disk.
    let mut damaged = dtm.clone();
    *damaged.last_mut().unwrap() ^= 1;
    std::fs::write(bench.at("dtm.tif"), damaged).unwrap();
    assert!(again(&[]) && bench.bytes("dtm.tif") == dtm, "damage");
    std::fs::remove_file(bench.at("dtm.tif.sha256")).unwrap();
    assert!(again(&[]), "without a sum nothing is known");
    // Another image of the same name.
    let mut image = bench.bytes("s/scene_0000_image.tif");
    image.push(0);
    std::fs::write(bench.at("s/scene_0000_image.tif"), image).unwrap();
    assert!(again(&[]), "another image");
}

#[test]
fn unfinished_rows_may_lie_in_another_folder() {
    let bench = Bench::new("300");
    std::fs::create_dir(bench.at("scratch")).unwrap();
    bench.predict("dtm.tif", &["--part-dir", "scratch"]);
    let whole = bench.bytes("dtm.tif");
    assert_eq!(std::fs::read_dir(bench.at("scratch")).unwrap().count(), 0, "rows were left");
    bench.predict("other.tif", &[]);
    assert!(bench.bytes("other.tif") == whole);
    let out = elunar(bench.folder.path(), &bench.words(&["predict"], "d.tif", &["--part-dir", "nowhere"]));
    let text = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.code() == Some(64) && text.contains("--part-dir nowhere"), "{text}");
}
