//! The run's two CSV files, with one line per step and one per validation. On resume they are cut to the checkpoint's step.

use super::validate::ValidationResult;
use elunar_base::output::open_growing;
use elunar_base::{Error, Result, read};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// File name of the training steps.
pub const STEPS: &str = "steps.csv";
/// File name of the validations.
pub const VALIDATIONS: &str = "validation.csv";

/// One training step's figures.
#[derive(Debug, Clone, Copy)]
pub struct StepRecord {
    /// Step, counted from 1.
    pub step: usize,
    /// Learning rate.
    pub learning_rate: f64,
    /// Weighted loss.
    pub loss: f64,
    /// Elevation term.
    pub elevation: f64,
    /// Gradient term.
    pub gradient: f64,
    /// Normal term.
    pub normal: f64,
}

/// A CSV file that only grows, except on resume.
struct Csv {
    path: PathBuf,
    file: File,
}

impl Csv {
    /// Keeps the header and the rows up to `step`. The first column is the step.
    fn open(path: PathBuf, header: &str, step: usize) -> Result<Self> {
        let old = read::text(&path, read::MOST_BYTES).unwrap_or_default();
        let mut text = format!("{header}\n");
        for row in old.lines().skip(1) {
            match row.split(',').next().and_then(|s| s.parse::<usize>().ok()) {
                Some(n) if n <= step => text.extend([row, "\n"]),
                _ => {}
            }
        }
        elunar_base::atomic_write(&path, text.as_bytes())?;
        let file = open_growing(&path)?;
        Ok(Self { path, file })
    }

    fn row(&mut self, row: &str) -> Result<()> {
        writeln!(self.file, "{row}").map_err(Error::io(&self.path))
    }
}

/// `steps.csv` and `validation.csv` of a run.
pub struct TrainingJournal {
    steps: Csv,
    validations: Csv,
}

impl TrainingJournal {
    /// Opens the files of `run` and drops rows after `step` (0 for a new run).
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn open(run: &Path, step: usize) -> Result<Self> {
        Ok(Self {
            steps: Csv::open(run.join(STEPS), "step,learning_rate,loss,elevation,gradient,normal", step)?,
            validations: Csv::open(
                run.join(VALIDATIONS),
                "step,rmse,rel,a1,rmse_m,mae_m,slope_mae_deg,coarse_rmse_m,coarse_mae_m,coarse_slope_mae_deg",
                step,
            )?,
        })
    }

    /// Adds a training step.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn step(&mut self, r: &StepRecord) -> Result<()> {
        let StepRecord { step, learning_rate, loss, elevation, gradient, normal } = r;
        self.steps.row(&format!("{step},{learning_rate:.6e},{loss:.6},{elevation:.6},{gradient:.6},{normal:.6}"))
    }

    /// Adds a validation.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn validation(&mut self, step: usize, v: &ValidationResult) -> Result<()> {
        let (n, c) = (v.network, v.coarse);
        self.validations.row(&format!(
            "{step},{:.5},{:.5},{:.5},{:.4},{:.4},{:.4},{:.4},{:.4},{:.4}",
            v.rmse, v.rel, v.a1, n.rmse_m, n.mae_m, n.slope_mae_deg, c.rmse_m, c.mae_m, c.slope_mae_deg
        ))
    }
}
