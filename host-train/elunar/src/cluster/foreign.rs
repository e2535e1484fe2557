//! What lies where a batch would write: it replaces what an earlier run wrote, and nothing else.

use super::item::Item;
use crate::cli::output::Target;
use elunar_raster::{Error, Result, read};
use elunar_scene::predict::identity::states_a_job;
use elunar_scene::predict::{part_path, sum_path};
use std::path::{Path, PathBuf};

/// Checks that at the files of every item nothing lies, or what an earlier run wrote: a DTM that states its job, or the beginning of one, of which
/// rows or the SHA-256 lie there.
///
/// # Errors
/// [`Error::Broken`] with line, field and file; [`Error::Usage`] if `part_dir` is no folder.
pub fn check(manifest: &Path, items: &[&(usize, Item)], folder: &Path, part_dir: Option<&Path>) -> Result<()> {
    for (line, item) in items {
        let dtm = folder.join(&item.output);
        if !dtm.parent().is_some_and(Path::is_dir) {
            continue;
        }
        let has_begun = part_path(&dtm, part_dir)?.is_file() || part_path(&dtm, None)?.is_file();
        let errors = item.uncertainty().map(|path| folder.join(path));
        let targets = [(Some(&dtm), "output"), (errors.as_ref(), "options.uncertainty")];
        for (path, field) in targets.into_iter().filter_map(|(path, field)| Some((path?, field))) {
            let target = if field == "output" { Target::Dtm(path) } else { Target::Errors(path) };
            if let Some(found) = foreign(target, has_begun) {
                let what = "a file of an earlier run or nothing expected, another one found: this run would replace it; move it away";
                let text = format!("line {line}, field {field}: {}: {what}", found.display());
                return Err(Error::broken(manifest, text));
            }
        }
    }
    Ok(())
}

/// Returns a file of a target that no earlier run wrote.
fn foreign(target: Target, has_begun: bool) -> Option<PathBuf> {
    let path = target.path();
    let is_there = |path: &Path| std::fs::symlink_metadata(path).is_ok();
    let is_own = if is_there(path) { states_a_job(path) } else { has_begun || is_sum_of(path) };
    let beside = |file: &PathBuf| {
        // Lock and rows are judged by those who write them.
        !file.extension().is_some_and(|end| end == "lock" || end == "part") && is_there(file)
    };
    if is_own { None } else { target.files().into_iter().find(beside) }
}

/// Returns whether the SHA-256 of a file lies beside its place.
fn is_sum_of(path: &Path) -> bool {
    // Not as a text, which may come from a pipe: that would wait for a writer.
    let text =
        read::bytes(&sum_path(path), 1 << 12).ok().and_then(|bytes| String::from_utf8(bytes).ok()).unwrap_or_default();
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    text.strip_suffix('\n')
        .and_then(|line| line.split_once("  "))
        .is_some_and(|(sum, of)| sum.len() == 64 && of == name)
}
