//! Checks that files do not use each other in circles: a reader can then take one after the other. A file may use its folder's `mod.rs`, which
//! uses the file.

use elunar_tests::repository;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The folders of sources.
const CRATES: [&str; 13] = [
    "core/src",
    "host-train/base/src",
    "host-train/data/src",
    "host-train/elunar/src",
    "host-train/evaluate/src",
    "host-train/learn/src",
    "host-train/net/src",
    "host-train/picture/src",
    "host-train/raster/src",
    "host-train/scene/src",
    "host-train/src",
    "host-train/synth/src",
    "onboard/capi/src",
];

/// The circles that stand, each by the folder of sources and two of its files.
/// The work on slots is one state machine with a file for each kind of work.
const KNOWN: [[&str; 3]; 3] = [
    ["core/src", "nn/slots/boot", "nn/slots/work"],
    ["host-train/raster/src", "binary", "source"],
    ["host-train/scene/src", "predict/run", "predict/scene"],
];

/// A file as its modules' names joined by `/`; a folder's `mod.rs` has the folder's name, `lib.rs` has none.
type Files = BTreeMap<String, String>;

/// Reads the files of a folder of sources, without tests.
fn files(root: &Path, folder: &Path, found: &mut Files) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.strip_prefix(root).unwrap().with_extension("").to_string_lossy().replace('\\', "/");
        if name.split('/').any(|part| part == "tests") {
            continue;
        }
        if path.is_dir() {
            files(root, &path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default().to_string();
            let name = match name.as_str() {
                "lib" | "main" => String::new(),
                name => name.strip_suffix("/mod").unwrap_or(name).to_string(),
            };
            found.entry(name).or_default().push_str(&code);
        }
    }
}

/// Returns the paths of a `use` with braces, one each.
fn expanded(text: &str) -> Vec<String> {
    let Some(open) = text.rfind('{') else { return vec![text.to_string()] };
    let Some(close) = text[open..].find('}').map(|at| open + at) else { return vec![] };
    let each = text[open + 1..close].split(',').map(|inner| [&text[..open], inner, &text[close + 1..]].concat());
    each.flat_map(|path| expanded(&path)).collect()
}

/// Returns the paths below `crate` that a file names in its `use` items.
fn paths(file: &str, code: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for item in code.split("use ").skip(1).filter_map(|rest| rest.split(';').next()) {
        let item: String = item.chars().filter(|c| !c.is_whitespace()).collect();
        for path in expanded(&item) {
            let mut place: Vec<String> = file.split('/').filter(|part| !part.is_empty()).map(String::from).collect();
            let mut parts = path.split("::").peekable();
            match parts.peek() {
                Some(&"crate") => place.clear(),
                Some(&"super" | &"self") => {}
                _ => continue,
            }
            for part in parts {
                match part {
                    "crate" | "self" => {}
                    "super" => drop(place.pop()),
                    name => place.push(name.into()),
                }
            }
            found.push(place);
        }
    }
    found
}

/// Returns which files each file uses, but for the folders that it is in.
fn uses(files: &Files) -> BTreeMap<&str, BTreeSet<&str>> {
    let of = |(name, code): (&String, &String)| {
        let known = |path: Vec<String>| {
            let longest = (1..=path.len()).rev().find_map(|n| files.get_key_value(&path[..n].join("/")));
            longest.map(|(used, _)| used.as_str())
        };
        paths(name, code)
            .into_iter()
            .filter_map(known)
            .filter(|used| *used != name && !name.starts_with(&format!("{used}/")))
            .collect::<BTreeSet<&str>>()
    };
    files.iter().map(|file| (file.0.as_str(), of(file))).collect()
}

/// Returns what is used by a file, and by what it uses.
fn reached<'a>(file: &'a str, uses: &BTreeMap<&'a str, BTreeSet<&'a str>>) -> BTreeSet<&'a str> {
    let (mut found, mut next) = (BTreeSet::new(), vec![file]);
    while let Some(used) = next.pop().and_then(|file| uses.get(file)) {
        next.extend(used.iter().filter(|file| found.insert(**file)));
    }
    found
}

/// Returns the circles, each as its files.
fn circles(files: &Files) -> BTreeSet<BTreeSet<&str>> {
    let uses = uses(files);
    let reach: BTreeMap<&str, BTreeSet<&str>> = uses.keys().map(|file| (*file, reached(file, &uses))).collect();
    let circle = |file: &&str| reach[file].iter().copied().filter(|other| reach[other].contains(file)).collect();
    reach.keys().map(circle).filter(|circle: &BTreeSet<&str>| !circle.is_empty()).collect()
}

#[test]
fn files_do_not_use_each_other_in_circles() {
    let mut count = 0;
    for folder in CRATES {
        let (root, mut found) = (repository().join(folder), Files::new());
        files(&root, &root, &mut found);
        count += found.len();
        for circle in circles(&found) {
            let known = |[of, a, b]: &[&str; 3]| *of == folder && circle.contains(a) && circle.contains(b);
            assert!(KNOWN.iter().any(known), "{folder}: a circle of {circle:?}");
        }
    }
    assert!(count > 300, "only {count} files were read");
}

#[test]
fn a_circle_is_noticed() {
    let mut made = Files::new();
    let mut add = |name: &str, code: &str| drop(made.insert(name.into(), code.into()));
    add("", "mod a; pub use a::A;");
    add("a", "use crate::{b::{B, c::C}, other};\n");
    add("b", "use super::X;");
    add("b/c", "use super::super::a::A;\nuse super::B;");
    add("b/d", "use std::a;\nuse elunar_core::b;");
    assert_eq!(circles(&made), BTreeSet::from([BTreeSet::from(["a", "b/c"])]));
    made.insert("b/c".into(), "use super::B;".into());
    assert!(circles(&made).is_empty());
}
