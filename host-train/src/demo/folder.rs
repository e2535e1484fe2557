//! The folder of a tour: which files are its own, and what of an earlier tour has to go before a new one.

use elunar_learn::train::curves::CURVES;
use elunar_learn::train::journal::{STEPS, VALIDATIONS};
use elunar_learn::train::run::{BEST, LAST, RECORD, Record};
use elunar_raster::{Error, Result};
use std::path::{Path, PathBuf};

/// The report.
pub(super) const REPORT: &str = "report.html";
/// The report's figures, for programs.
pub(super) const FIGURES: &str = "figures.json";
/// The float network the tour ends with.
pub(super) const FLOAT_MODEL: &str = "model.safetensors";
/// The int8 network made of it.
pub(super) const INT8_MODEL: &str = "model.eld";
/// Folder of the training run.
pub(super) const RUN: &str = "training";
/// How the record of a tour's training run says what it is.
pub(super) const STARTED_BY: &str = "tour, from ";

/// A folder that a tour may write into.
pub(super) struct Folder {
    path: PathBuf,
}

impl Folder {
    /// Makes the folder if need be and takes away what an earlier tour would leave contradictory: its report, its figures and its
    /// training run. Everything else is overwritten when its turn comes; foreign files are never touched.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder cannot be written; [`Error::Usage`] if its `training` is somebody else's run.
    pub(super) fn open(path: &Path) -> Result<Self> {
        std::fs::create_dir_all(path).map_err(Error::io(path))?;
        tempfile::NamedTempFile::new_in(path).map_err(Error::io(path))?;
        let folder = Self { path: path.into() };
        folder.clear_run()?;
        for name in [REPORT, FIGURES] {
            remove(&folder.file(name), false)?;
        }
        Ok(folder)
    }

    /// A file or folder in it.
    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Its name for messages.
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
        // Last: while it is there, a tour that was stopped in between is recognised.
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
