//! An output, with the files beside it.

use elunar_raster::pds4::samples_path;
use elunar_scene::predict::{hillshade_path, sum_path, survey_path};
use std::path::{Path, PathBuf};

/// An output that a command writes, and with it all files that it writes for its sake.
#[derive(Debug, Clone, Copy)]
pub enum OutputTarget<'a> {
    /// A file alone.
    File(&'a Path),
    /// A DTM of `predict` or `sfs`.
    Dtm(&'a Path),
    /// The expected errors of a DTM.
    Errors(&'a Path),
    /// A PDS4 label, whose samples lie beside it.
    Label(&'a Path),
}

impl<'a> OutputTarget<'a> {
    /// Returns the output.
    #[must_use]
    pub fn path(self) -> &'a Path {
        let (Self::File(path) | Self::Dtm(path) | Self::Errors(path) | Self::Label(path)) = self;
        path
    }

    /// Returns all files that are written for the output: it, its lock, rows of an unfinished run, and what it has besides.
    #[must_use]
    pub fn files(self) -> Vec<PathBuf> {
        let output = self.path();
        let beside = |end: &str| {
            let mut name = output.file_name().unwrap_or_default().to_os_string();
            name.push(end);
            output.with_file_name(name)
        };
        let mut all = vec![output.into(), beside(".lock"), beside(".part")];
        match self {
            Self::File(_) => {}
            Self::Errors(_) => all.push(sum_path(output)),
            Self::Label(_) => all.push(samples_path(output)),
            Self::Dtm(_) => {
                all.extend([sum_path(output), survey_path(output), beside(".survey.lock"), hillshade_path(output)]);
            }
        }
        all
    }
}
