//! Shared by the tests in `cases/`: paths and tolerances.

pub mod tolerance;

use elunar_testing::{shared_folder, skipped};
use std::path::{Path, PathBuf};

/// Returns the repository's root folder.
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("tests/ lies in the repository").to_path_buf()
}

/// Returns the golden cases of the network: the repository's own (the paper's network first, then its ablations), then the shared ones, if
/// any.
///
/// # Panics
/// If one of the repository's own cases is missing.
pub fn golden_networks() -> Vec<PathBuf> {
    let own = ["mini", "ablations"].map(|case| repository().join(format!("tests/golden/{case}/case.safetensors")));
    own.iter().for_each(|path| assert!(path.is_file(), "expected {}", path.display()));
    let mut found = own.to_vec();
    if let Some(folder) = shared_folder().map(|s| s.join("oracle/golden")) {
        let files = std::fs::read_dir(&folder).into_iter().flatten().flatten().map(|e| e.path());
        found.extend(files.filter(|p| p.extension().is_some_and(|e| e == "safetensors")));
        if found.len() == own.len() {
            skipped("shared golden cases", &format!("none in {}", folder.display()));
        }
    }
    found
}
