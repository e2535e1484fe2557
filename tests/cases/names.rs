//! Checks that a name stands for one thing: no two public types of the workspace have the same name.

use elunar_tests::repository;
use std::collections::BTreeMap;
use std::process::Command;

/// Names that stand more than once, each with the reason.
const KNOWN: [(&str, &str); 3] =
    [("Args", "one per command"), ("Cli", "one per program"), ("Command", "one per program")];

/// Returns the name of a public type that a line declares.
fn declared(line: &str) -> Option<&str> {
    let rest = line.strip_prefix("pub ")?;
    let rest = ["struct ", "enum ", "trait ", "type ", "union "].iter().find_map(|word| rest.strip_prefix(word))?;
    rest.split(|c: char| !c.is_alphanumeric() && c != '_').next()
}

#[test]
fn public_types_have_names_of_their_own() {
    let root = repository();
    let listed = Command::new("git").args(["ls-files", "*.rs"]).current_dir(&root).output().unwrap();
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for path in String::from_utf8(listed.stdout)
        .unwrap()
        .lines()
        .filter(|path| path.contains("src/") && !path.starts_with("tests/"))
    {
        let Ok(text) = std::fs::read_to_string(root.join(path)) else { continue };
        for name in text.lines().filter_map(declared) {
            places.entry(name.to_string()).or_default().push(path.to_string());
        }
    }
    assert!(places.len() > 300, "only {} public types found", places.len());
    places.retain(|name, places| places.len() > 1 && !KNOWN.iter().any(|known| known.0 == name));
    assert!(places.is_empty(), "public types of the same name: {places:#?}");
}
