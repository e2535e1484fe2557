//! Output paths: checked and taken before the work starts.

pub mod beside;
mod places;
mod target;
pub mod uses;

use elunar_base::output::{Owner, check_target};
use elunar_base::{Error, Result};
use std::path::{Path, PathBuf};
pub use target::OutputTarget;
use uses::Uses;

/// Takes `output`, a file to write, before the work starts: neither it nor a file that is written for its sake is one of `inputs`, its folder
/// can be written, nothing but a regular file is replaced, and no other run writes it. It is ours until the result is dropped.
///
/// # Errors
/// [`Error::Usage`], [`Error::Busy`] or [`Error::Io`] with the reason.
pub fn take(output: &Path, inputs: &[&Path]) -> Result<Owner> {
    keep_apart(&[OutputTarget::File(output)], inputs)?;
    Owner::of_file(output)
}

/// Takes several outputs, as [`take`] does. None may be another.
///
/// # Errors
/// As [`take`].
pub fn take_all<'a>(outputs: impl IntoIterator<Item = &'a PathBuf>, inputs: &[&Path]) -> Result<Vec<Owner>> {
    let outputs: Vec<&PathBuf> = outputs.into_iter().collect();
    keep_apart(&outputs.iter().map(|path| OutputTarget::File(path)).collect::<Vec<_>>(), inputs)?;
    outputs.into_iter().map(|output| Owner::of_file(output)).collect()
}

/// Takes a DTM to write, as [`take`] does, with all that lies beside it, and further outputs.
///
/// # Errors
/// As [`take`]; [`Error::Usage`] if the DTM's name is not that of a TIFF.
pub fn take_dtm(output: &Path, further: &[OutputTarget], inputs: &[&Path]) -> Result<(Owner, Vec<Owner>)> {
    check_dtm(output, further, inputs)?;
    let owner = Owner::of_file(output)?;
    Ok((owner, further.iter().map(|target| Owner::of_file(target.path())).collect::<Result<_>>()?))
}

/// Checks the name of a DTM to write, and all that lies beside it and its further outputs.
///
/// # Errors
/// [`Error::Usage`] if its name is not that of a TIFF, a file would replace an input, what lies there must not be replaced, or a file beside it
/// is another's.
pub fn check_dtm(output: &Path, further: &[OutputTarget], inputs: &[&Path]) -> Result<()> {
    extension(output, &["tif", "tiff"])?;
    let targets = [&[OutputTarget::Dtm(output)], further].concat();
    keep_apart(&targets, inputs)?;
    targets.iter().flat_map(|target| target.files()).try_for_each(|file| check_target(&file))?;
    targets.into_iter().try_for_each(beside::check)
}

/// Refuses outputs of which a file is an input, the image that an input's label describes, or a file of another output.
fn keep_apart(targets: &[OutputTarget], inputs: &[&Path]) -> Result<()> {
    let mut uses = Uses::default();
    targets.iter().for_each(|target| uses.write(&target.files(), ()));
    refuse_clash(uses, inputs)
}

/// Refuses files to write into a folder of which one is an input, as [`take`] does for files that are named.
///
/// # Errors
/// [`Error::Usage`] with the file.
pub fn check_files(files: &[PathBuf], inputs: &[&Path]) -> Result<()> {
    let mut uses = Uses::default();
    uses.write(files, ());
    refuse_clash(uses, inputs)
}

fn refuse_clash(mut uses: Uses<()>, inputs: &[&Path]) -> Result<()> {
    inputs.iter().for_each(|input| uses.read(input, ()));
    let refused = |path: &Path| {
        let what = "would be written; an output must not overwrite an input or another output";
        Err(Error::usage(format!("{}: {what}", path.display())))
    };
    uses.clash().map_or(Ok(()), |clash| refused(&clash.path))
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
