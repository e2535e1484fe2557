//! What lies beside an output: a command replaces there what an earlier run wrote for the sake of that output, and nothing else.

use super::target::OutputTarget;
use elunar_base::{Error, Result, read};
use elunar_scene::predict::identity::states_a_job;
use elunar_scene::predict::rows::is_rows;
use elunar_scene::predict::{is_survey, part_path, sum_path};
use std::path::{Path, PathBuf};

/// What is wrong with a file that no earlier run wrote.
pub const FOREIGN: &str =
    "a file of an earlier run or nothing expected, another one found: this run would replace it; move it away";

/// Refuses the rows of a part as an output if a file of others lies in their place.
///
/// # Errors
/// [`Error::Usage`] if one does.
pub fn check_rows(path: &Path) -> Result<()> {
    if path.is_file() && !is_rows(path) { Err(refused(path)) } else { Ok(()) }
}

/// Refuses an output, which itself may be replaced, if a file beside it would be replaced that no earlier run wrote.
///
/// # Errors
/// [`Error::Usage`] with that file.
pub fn check(target: OutputTarget) -> Result<()> {
    let path = target.path();
    // Of a run that was killed while it replaced a file of others, its rows are left.
    let has_begun = part_path(path, None)?.is_file();
    match foreign(target, has_begun || states_a_job(path)).find(|file| file != path) {
        Some(found) => Err(refused(&found)),
        None => Ok(()),
    }
}

fn refused(path: &Path) -> Error {
    Error::usage(format!("{}: {FOREIGN}", path.display()))
}

/// Returns the files of a target that are there and that no earlier run wrote. Without the output itself the SHA-256 beside its place says
/// whose the others are. `is_own` says that all of them are.
pub fn foreign(target: OutputTarget, is_own: bool) -> impl Iterator<Item = PathBuf> {
    let path = target.path().to_path_buf();
    let is_there = |path: &Path| std::fs::symlink_metadata(path).is_ok();
    let is_own = is_own || !is_there(&path) && is_sum_of(&path);
    let all = if is_own { vec![] } else { target.files() };
    all.into_iter().filter(move |file| {
        // Lock and rows are judged by those who write them, and a survey says what it is.
        !file.extension().is_some_and(|end| end == "lock" || end == "part") && is_there(file) && !is_survey(file)
    })
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
