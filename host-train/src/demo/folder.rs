//! The folder of a tour: its files, and the removal of an earlier tour's files.

use elunar_learn::train::curves::CURVES;
use elunar_learn::train::journal::{STEPS, VALIDATIONS};
use elunar_learn::train::run::{BEST, LAST, RECORD, Record};
use elunar_raster::output::Owner;
use elunar_raster::{Error, Result};
use std::path::{Path, PathBuf};

/// File name of the report.
pub(super) const REPORT: &str = "report.html";
/// The report's figures as JSON.
pub(super) const FIGURES: &str = "figures.json";
/// File name of the final float network.
pub(super) const FLOAT_MODEL: &str = "model.safetensors";
/// File name of the int8 network.
pub(super) const INT8_MODEL: &str = "model.eld";
/// Folder of the training run.
pub(super) const RUN: &str = "training";
/// Beginning of the entry in the training record that marks a tour's run.
pub(super) const STARTED_BY: &str = "tour, from ";

/// A folder for the files of a tour, ours until it is dropped.
pub(super) struct Folder {
    path: PathBuf,
    _owner: Owner,
}

impl Folder {
    /// Creates the folder if needed. Removes the files of an earlier tour that would contradict the new ones: its report, its figures and
    /// its training run. Its other files are overwritten later. Foreign files are never changed.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder cannot be written; [`Error::Busy`] if another run writes it; [`Error::Usage`] if its `training` is not a tour's run.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let folder = Self { path: path.into(), _owner: Owner::of_folder(path)? };
        folder.clear_run()?;
        for name in [REPORT, FIGURES] {
            remove(&folder.file(name), false)?;
        }
        Ok(folder)
    }

    /// Returns the path of a file or folder in it.
    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Returns its name for messages.
    pub(super) fn show(&self) -> String {
        self.path.display().to_string()
    }

    fn clear_run(&self) -> Result<()> {
        let run = self.file(RUN);
        if !run.join(RECORD).exists() {
            return Ok(());
        }
        if !Record::read(&run)?.started_from.starts_with(STARTED_BY) {
            let what = "expected the training run of an earlier tour, found another run; choose another --out";
            return Err(Error::usage(format!("{}: {what}", run.display())));
        }
        for name in [BEST, LAST, STEPS, VALIDATIONS, CURVES] {
            remove(&run.join(name), false)?;
        }
        for name in ["checkpoint", "checkpoint.old", "checkpoint.new"] {
            remove(&run.join(name), true)?;
        }
        // The record is removed last: with it, an interrupted tour is still recognised.
        remove(&run.join(RECORD), false)
    }
}

fn remove(path: &Path, folder: bool) -> Result<()> {
    let removed = if folder { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
    match removed {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::Io { path: path.into(), source: e }),
        _ => Ok(()),
    }
}
