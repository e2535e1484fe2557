//! Output paths: checked and taken before the work starts.

use elunar_raster::output::{Owner, check_target};
use elunar_raster::{Error, Result};
use elunar_scene::predict::hillshade_path;
use std::path::{Path, PathBuf};

/// Takes `output`, a file to write, before the work starts: it is none of `inputs`, its folder can be written, nothing but a regular file is
/// replaced, and no other run writes it. It is ours until the result is dropped.
///
/// # Errors
/// [`Error::Usage`], [`Error::Busy`] or [`Error::Io`] with the reason.
pub fn take(output: &Path, inputs: &[&Path]) -> Result<Owner> {
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
    Owner::of_file(output)
}

/// Takes several outputs, as [`take`] does. None may be another.
///
/// # Errors
/// As [`take`].
pub fn take_all<'a>(outputs: impl IntoIterator<Item = &'a PathBuf>, inputs: &[&'a Path]) -> Result<Vec<Owner>> {
    let mut others = inputs.to_vec();
    let one = |output: &'a PathBuf| {
        let owner = take(output, &others)?;
        others.push(output);
        Ok(owner)
    };
    outputs.into_iter().map(one).collect()
}

/// Takes a DTM to write, as [`take`] does, with the hillshade beside it.
///
/// # Errors
/// As [`take`].
pub fn take_dtm(output: &Path, inputs: &[&Path]) -> Result<Owner> {
    check_target(&hillshade_path(output))?;
    take(output, inputs)
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
