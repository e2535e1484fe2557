//! Helpers for tests of several crates: outside programs to compare with ([`oracle`]), reference data, damaged files, exit codes. This crate is only a
//! development dependency, and depends on no other crate of this project.

pub mod exit_codes;
mod mutate;
pub mod oracle;
pub mod server;

pub use mutate::mutate;
pub use oracle::rasterio;

use std::io::Write;
use std::path::{Path, PathBuf};

/// Reports on stderr that the check `what` is skipped, and why. It does not use `eprintln!`, because the test runner hides such text of
/// passing tests.
pub fn skipped(what: &str, why: &str) {
    // A closed stderr must not fail a test.
    let _ = writeln!(std::io::stderr(), "SKIPPED: {what}: {why}");
}

/// Returns the folder of reference data outside the repository: `$ELUNAR_SHARED`, otherwise `../shared` beside the repository. `None` if
/// there is none; the skip is then reported. The data are optional, also with [`oracle::REQUIRE`].
pub fn shared_folder() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let folder = std::env::var_os("ELUNAR_SHARED").map_or_else(beside, PathBuf::from);
    if folder.join("data").is_dir() {
        return Some(folder);
    }
    skipped(&oracle::current_test(), &format!("no reference data in {} (set ELUNAR_SHARED)", folder.display()));
    None
}
