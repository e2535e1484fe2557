//! Output paths: checked and taken before the work starts.

use elunar_raster::content::files_of_raster;
use elunar_raster::output::{Owner, check_target};
use elunar_raster::{Error, Result, folder_of};
use elunar_scene::predict::{hillshade_path, sum_path, survey_path};
use std::path::{Path, PathBuf};

/// Takes `output`, a file to write, before the work starts: neither it nor a file that is written for its sake is one of `inputs`, its folder
/// can be written, nothing but a regular file is replaced, and no other run writes it. It is ours until the result is dropped.
///
/// # Errors
/// [`Error::Usage`], [`Error::Busy`] or [`Error::Io`] with the reason.
pub fn take(output: &Path, inputs: &[&Path]) -> Result<Owner> {
    keep_apart(&files(output), inputs)?;
    Owner::of_file(output)
}

/// Takes several outputs, as [`take`] does. None may be another.
///
/// # Errors
/// As [`take`].
pub fn take_all<'a>(outputs: impl IntoIterator<Item = &'a PathBuf>, inputs: &[&Path]) -> Result<Vec<Owner>> {
    let mut others: Vec<PathBuf> = inputs.iter().map(PathBuf::from).collect();
    let one = |output: &'a PathBuf| {
        let owner = take(output, &others.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
        others.extend(files(output));
        Ok(owner)
    };
    outputs.into_iter().map(one).collect()
}

/// Takes a DTM to write, as [`take`] does, with all that lies beside it, and further outputs.
///
/// # Errors
/// As [`take`]; [`Error::Usage`] if the DTM's name is not that of a TIFF.
pub fn take_dtm<'a>(
    output: &Path,
    further: impl IntoIterator<Item = &'a PathBuf>,
    inputs: &[&Path],
) -> Result<(Owner, Vec<Owner>)> {
    let beside = check_dtm(output, inputs)?;
    let owner = Owner::of_file(output)?;
    let others: Vec<&Path> = inputs.iter().copied().chain(beside.iter().map(PathBuf::as_path)).collect();
    Ok((owner, take_all(further, &others)?))
}

/// Checks the name of a DTM to write, and all that lies beside it. Returns the files that are written for it.
///
/// # Errors
/// [`Error::Usage`] if its name is not that of a TIFF, a file would replace an input, or what lies there must not be replaced.
pub fn check_dtm(output: &Path, inputs: &[&Path]) -> Result<Vec<PathBuf>> {
    extension(output, &["tif", "tiff"])?;
    let written = [files(output), vec![sum_path(output), survey_path(output), hillshade_path(output)]].concat();
    keep_apart(&written, inputs)?;
    written.iter().try_for_each(|file| check_target(file))?;
    Ok(written)
}

/// Returns the files that a command writes for an output: it, its lock, and rows of an unfinished run.
fn files(output: &Path) -> Vec<PathBuf> {
    let name = output.file_name().unwrap_or_default();
    let beside = |end: &str| {
        let mut name = name.to_os_string();
        name.push(end);
        output.with_file_name(name)
    };
    vec![output.into(), beside(".lock"), beside(".part")]
}

/// Refuses files to write of which one is an input, or the image that an input's label describes.
fn keep_apart(written: &[PathBuf], inputs: &[&Path]) -> Result<()> {
    let written: Vec<(&PathBuf, PathBuf)> = written.iter().map(|path| (path, place(path))).collect();
    for input in inputs {
        // What is no raster is one file. A pipe would wait for its writer.
        let files = if input.is_file() { files_of_raster(input).ok() } else { None };
        for read in files.unwrap_or_else(|| vec![input.into()]) {
            if let Some((path, _)) = written.iter().find(|(_, written)| *written == place(&read)) {
                let what = "would be written; an output must not overwrite an input or another output";
                return Err(Error::usage(format!("{}: {what}", path.display())));
            }
        }
    }
    Ok(())
}

/// Returns where a path leads, also if nothing is there yet.
fn place(path: &Path) -> PathBuf {
    let in_folder = || Ok(folder_of(path).canonicalize()?.join(path.file_name().unwrap_or_default()));
    path.canonicalize().or_else(|_: std::io::Error| in_folder()).unwrap_or_else(|_: std::io::Error| path.into())
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
