//! The folder of a tour: its files, and the removal of an earlier tour's files.

use super::InitialWeights;
use crate::inner::check_inner;
use elunar::outputs::check_files;
use elunar_base::output::{Owner, check_names};
use elunar_base::{Error, Result};
use elunar_learn::train::run::{self, RECORD, RunRecord};
use elunar_synth::{MANIFEST, scene_files};
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
/// Picture of the image.
pub(super) const IMAGE: &str = "image.png";
/// Hillshade of the interpolated coarse DTM.
pub(super) const COARSE_SHADE: &str = "coarse_hillshade.png";
/// Hillshade of the truth.
pub(super) const TRUTH_SHADE: &str = "truth_hillshade.png";
/// Image and hillshades side by side.
pub(super) const OVERVIEW: &str = "overview.png";
/// Names of the candidates, in the order of the table.
pub(super) const NAMES: [&str; 4] = ["coarse DTM", "untrained", "float", "int8"];
/// Beginning of the entry in the training record that marks a tour's run.
pub(super) const STARTED_BY: &str = "tour, from ";

/// A folder for the files of a tour, ours until it is dropped.
pub(super) struct Folder {
    path: PathBuf,
    owner: Owner,
}

impl Folder {
    /// Creates the folder if needed. Removes the files of an earlier tour that would contradict the new ones: its report, its figures and
    /// its training run. Its other files are overwritten later. Foreign files are never changed.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder cannot be written; [`Error::Busy`] if another run writes it; [`Error::Usage`] if its `training` is not a
    /// tour's run, something lies in the place of a file that no earlier tour wrote, or the weights to start from would be overwritten.
    pub(super) fn open(path: &Path, start: &InitialWeights) -> Result<Self> {
        if let InitialWeights::Weights(weights) = start {
            check_files(&files().map(|name| path.join(name)).collect::<Vec<_>>(), &[weights])?;
        }
        let folder = Self { path: path.into(), owner: Owner::of_folder(path, "tour", files())? };
        folder.clear_run()?;
        [REPORT, FIGURES].iter().try_for_each(|name| folder.owner.remove(name))?;
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
        check_inner(&run)?;
        if !run.join(RECORD).exists() {
            return check_names(&run, run::COMMAND, run::files());
        }
        if !RunRecord::read(&run)?.started_from.starts_with(STARTED_BY) {
            let what = "expected the training run of an earlier tour, found another run; choose another --out";
            return Err(Error::usage(format!("{}: {what}", run.display())));
        }
        run::discard(&run)
    }
}

/// Returns the names of all files of a tour but those of its training run.
fn files() -> impl Iterator<Item = String> {
    let fixed = [REPORT, FIGURES, FLOAT_MODEL, INT8_MODEL, MANIFEST, IMAGE, COARSE_SHADE, TRUTH_SHADE, OVERVIEW];
    let made = NAMES.iter().flat_map(|name| [error_file(name), dtm_file(name), shade_file(name)]);
    fixed.map(String::from).into_iter().chain(scene_files(0)).chain(made)
}

/// Returns the name of an error map: `coarse`, `untrained`, `float` or `int8`.
pub(super) fn error_file(name: &str) -> String {
    format!("error_{}.png", name.split(' ').next().unwrap_or(name))
}

/// Returns the name of a DTM's file.
pub(super) fn dtm_file(name: &str) -> String {
    format!("dtm_{name}.tif")
}

/// Returns the name of its hillshade.
pub(super) fn shade_file(name: &str) -> String {
    format!("dtm_{name}_hillshade.png")
}
