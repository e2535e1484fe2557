//! Folders within a command's folder that have an owner and a list of their own.

use elunar_base::{Error, Result};
use std::path::Path;

/// Checks that nothing lies at `path`, or a folder: what is written into it is written there, and not where a link leads.
///
/// # Errors
/// [`Error::Usage`] if something else lies there, a link to a folder, too.
pub(crate) fn check_inner(path: &Path) -> Result<()> {
    let Ok(found) = std::fs::symlink_metadata(path) else { return Ok(()) };
    if found.is_dir() {
        return Ok(());
    }
    let kind = if found.is_symlink() { "link" } else { "file" };
    Err(Error::usage(format!("{}: a folder or nothing expected, a {kind} found", path.display())))
}
