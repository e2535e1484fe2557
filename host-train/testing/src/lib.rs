//! What tests of several crates share: outside programs to compare with ([`oracle`]), reference data, damaged files. A development
//! dependency only; it depends on no crate of ours.

mod mutate;
pub mod oracle;

pub use mutate::mutate;
pub use oracle::rasterio;

use std::io::Write;
use std::path::{Path, PathBuf};

/// Says on stderr that the check `what` does not run, and why. Not by `eprintln!`: the test runner keeps its text of tests that pass.
pub fn skipped(what: &str, why: &str) {
    // A closed stderr is no reason to fail a test.
    let _ = writeln!(std::io::stderr(), "SKIPPED: {what}: {why}");
}

/// The folder of reference data that are not part of the repository: `$ELUNAR_SHARED`, else `../shared` beside the repository. `None` if there
/// is none; the skip is then reported. The data need not be there: [`oracle::REQUIRE`] does not ask for them.
pub fn shared_folder() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let folder = std::env::var_os("ELUNAR_SHARED").map_or_else(beside, PathBuf::from);
    if folder.join("data").is_dir() {
        return Some(folder);
    }
    skipped(&oracle::current_test(), &format!("no reference data in {} (set ELUNAR_SHARED)", folder.display()));
    None
}
