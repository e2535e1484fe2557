//! What the tests in `cases/` share: where things lie, and how close is close enough.

pub mod tolerance;

use std::io::Write;
use std::path::{Path, PathBuf};

/// Says on stderr that a check does not run, and why. Not by `eprintln!`: its text is kept from whoever runs passing tests.
pub fn skipped(why: &str) {
    // A closed stderr is no reason to fail a test.
    let _ = writeln!(std::io::stderr(), "SKIPPED: {why}");
}

/// The repository's root folder.
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("tests/ lies in the repository").to_path_buf()
}

/// Reference data that is not part of the repository: the folder `$ELUNAR_SHARED`, else `../shared` beside the repository.
/// `None`, with a word on stderr, when there is no such folder: the caller then skips what needs it.
pub fn shared() -> Option<PathBuf> {
    let folder = std::env::var_os("ELUNAR_SHARED").map_or_else(|| repository().join("../shared"), PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    skipped(&format!("checks against shared reference data: no folder {}", folder.display()));
    None
}

/// Golden cases of the network: the repository's own (at least one), then the shared ones, if any.
///
/// # Panics
/// If the repository's own case is missing.
pub fn golden_networks() -> Vec<PathBuf> {
    let own = repository().join("tests/golden/mini/case.safetensors");
    assert!(own.is_file(), "expected {}", own.display());
    let mut found = vec![own];
    if let Some(folder) = shared().map(|s| s.join("oracle/golden")) {
        let files = std::fs::read_dir(&folder).into_iter().flatten().flatten().map(|e| e.path());
        found.extend(files.filter(|p| p.extension().is_some_and(|e| e == "safetensors")));
        if found.len() == 1 {
            skipped(&format!("shared golden cases: none in {}", folder.display()));
        }
    }
    found
}
