//! What the tests in `cases/` share: where things lie, and how close is close enough.

pub mod tolerance;

use elunar_testing::{shared_folder, skipped};
use std::path::{Path, PathBuf};

/// The repository's root folder.
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("tests/ lies in the repository").to_path_buf()
}

/// Golden cases of the network: the repository's own (at least one), then the shared ones, if any.
///
/// # Panics
/// If the repository's own case is missing.
pub fn golden_networks() -> Vec<PathBuf> {
    let own = repository().join("tests/golden/mini/case.safetensors");
    assert!(own.is_file(), "expected {}", own.display());
    let mut found = vec![own];
    if let Some(folder) = shared_folder().map(|s| s.join("oracle/golden")) {
        let files = std::fs::read_dir(&folder).into_iter().flatten().flatten().map(|e| e.path());
        found.extend(files.filter(|p| p.extension().is_some_and(|e| e == "safetensors")));
        if found.len() == 1 {
            skipped("shared golden cases", &format!("none in {}", folder.display()));
        }
    }
    found
}
