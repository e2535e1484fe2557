//! Checks of output paths before the work starts.

use elunar_raster::{Error, Result, folder_of};
use std::path::Path;

/// Checks that `output` is none of `inputs` and that its folder can be written, before the work starts.
///
/// # Errors
/// [`Error::Usage`] or [`Error::Io`] with the reason.
pub fn check(output: &Path, inputs: &[&Path]) -> Result<()> {
    let same = |input: &Path| {
        input == output
            || input.canonicalize().is_ok_and(|input| output.canonicalize().is_ok_and(|output| input == output))
    };
    if let Some(input) = inputs.iter().find(|input| same(input)) {
        return Err(Error::usage(format!(
            "{}: the output must not overwrite an input or another output",
            input.display()
        )));
    }
    if output.is_dir() {
        return Err(Error::usage(format!("{}: a file to write expected, a folder found", output.display())));
    }
    let folder = folder_of(output);
    tempfile::NamedTempFile::new_in(folder).map_err(Error::io(output)).map(drop)
}

/// Returns which of the extensions (lower case) the output's name has.
///
/// # Errors
/// [`Error::Usage`] if it has none of them.
pub fn extension<'a>(output: &Path, known: &[&'a str]) -> Result<&'a str> {
    let found = output.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    known.iter().copied().find(|k| *k == found).ok_or_else(|| {
        Error::usage(format!("{}: a name ending in .{} expected", output.display(), known.join(" or .")))
    })
}
