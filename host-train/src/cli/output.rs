//! What commands that write a file do first, and how they say how far they are.

use crate::{Error, Result};
use indicatif::{ProgressBar, ProgressStyle};
use std::path::Path;

/// Fails before the work rather than after it: if `output` is one of `inputs`, or its folder cannot be written.
pub(super) fn check(output: &Path, inputs: &[&Path]) -> Result<()> {
    let same = |input: &Path| {
        input.canonicalize().is_ok_and(|input| output.canonicalize().is_ok_and(|output| input == output))
    };
    if let Some(input) = inputs.iter().find(|input| same(input)) {
        return Err(Error::usage(format!("{}: the output must not overwrite an input", input.display())));
    }
    if output.is_dir() {
        return Err(Error::usage(format!("{}: a file to write expected, a folder found", output.display())));
    }
    let folder = output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::NamedTempFile::new_in(folder).map_err(Error::io(output)).map(drop)
}

/// Which of the extensions (lower case) the output's name has.
pub(super) fn extension<'a>(output: &Path, known: &[&'a str]) -> Result<&'a str> {
    let found = output.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    known.iter().copied().find(|k| *k == found).ok_or_else(|| {
        Error::usage(format!("{}: a name ending in .{} expected", output.display(), known.join(" or .")))
    })
}

/// A bar on stderr with rate and time left; silent where stderr is no terminal.
pub(super) fn progress(all: usize, unit: &str) -> ProgressBar {
    let style = format!("{{bar:40}} {{pos}}/{{len}} {unit}, {{per_sec}}, {{eta}} left");
    let style = ProgressStyle::with_template(&style).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(all as u64).with_style(style)
}
