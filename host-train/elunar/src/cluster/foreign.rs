//! What lies where a batch would write: it replaces what an earlier run wrote, and nothing else.

use super::item::BatchItem;
use crate::outputs::OutputTarget;
use crate::outputs::beside::{FOREIGN, foreign};
use elunar_base::{Error, Result};
use elunar_scene::predict::identity::states_a_job;
use elunar_scene::predict::part_path;
use std::path::Path;

/// Checks that at the files of every item nothing lies, or what an earlier run wrote: a DTM that states its job, or the beginning of one, of which
/// rows or the SHA-256 lie there.
///
/// # Errors
/// [`Error::Broken`] with line, field and file; [`Error::Usage`] if `part_dir` is no folder.
pub fn check(manifest: &Path, items: &[&(usize, BatchItem)], folder: &Path, part_dir: Option<&Path>) -> Result<()> {
    for (line, item) in items {
        let dtm = folder.join(&item.output);
        if !dtm.parent().is_some_and(Path::is_dir) {
            continue;
        }
        let has_begun = part_path(&dtm, part_dir)?.is_file() || part_path(&dtm, None)?.is_file();
        let errors = item.uncertainty().map(|path| folder.join(path));
        let targets = [(Some(&dtm), "output"), (errors.as_ref(), "options.uncertainty")];
        for (path, field) in targets.into_iter().filter_map(|(path, field)| Some((path?, field))) {
            let target = if field == "output" { OutputTarget::Dtm(path) } else { OutputTarget::Errors(path) };
            let is_own = if path.symlink_metadata().is_ok() { states_a_job(path) } else { has_begun };
            if let Some(found) = foreign(target, is_own).next() {
                let text = format!("line {line}, field {field}: {}: {FOREIGN}", found.display());
                return Err(Error::broken(manifest, text));
            }
        }
    }
    Ok(())
}
