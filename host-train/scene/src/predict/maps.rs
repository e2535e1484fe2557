//! The maps of a prediction in memory, for callers that write no files.

use super::errors::{Origins, origins_of, with_coarse};
use super::job::{Finished, layers};
use super::tile::TileResult;
use elunar_base::{Error, Result};

/// Maps on the image's grid, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct Maps {
    /// Heights, metres; NaN where image or coarse DTM is invalid.
    pub heights_m: Vec<f32>,
    /// Expected errors, if they were wanted.
    pub errors: Option<ErrorMaps>,
    cols: usize,
    finished: Finished,
}

/// The errors that heights and slopes are expected to have, as the file of expected errors holds them.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorMaps {
    /// Standard deviation of the heights, metres; NaN where there is no height.
    pub heights_m: Vec<f32>,
    /// Standard deviation of the slopes along either axis, metres per metre; NaN where there is no height.
    pub slopes: Vec<f32>,
    /// Codes of [`elunar_core::photoclinometry::Origin`].
    pub origins: Vec<u8>,
}

impl Maps {
    /// Makes empty maps of a scene with `shape` (rows, columns). With `expected_errors` rows
    /// must have them ([`super::PredictOptions::layers`]); [`Self::add_coarse`] completes them.
    ///
    /// # Errors
    /// [`Error::Io`] if the system refuses the memory.
    pub fn new((rows, cols): (usize, usize), expected_errors: bool) -> Result<Self> {
        let errors = || -> Result<ErrorMaps> {
            let (heights_m, slopes, origins) = (room(rows * cols)?, room(rows * cols)?, room(rows * cols)?);
            Ok(ErrorMaps { heights_m, slopes, origins })
        };
        let errors = expected_errors.then(errors).transpose()?;
        Ok(Self { heights_m: room(rows * cols)?, errors, cols, finished: Finished::default() })
    }

    /// Adds finished rows, from top to bottom.
    pub fn add(&mut self, rows: &[f32]) {
        let Some(errors) = &mut self.errors else {
            self.finished.see(rows);
            return self.heights_m.extend_from_slice(rows);
        };
        for row in rows.chunks_exact(TileResult::LAYERS * self.cols) {
            let (heights_m, [of_heights, slopes, explained, dark]) = layers(row, self.cols);
            self.finished.see(heights_m);
            self.heights_m.extend_from_slice(heights_m);
            errors.heights_m.extend_from_slice(of_heights);
            errors.slopes.extend_from_slice(slopes);
            errors.origins.extend(origins_of(explained, dark).iter().map(|origin| *origin as u8));
        }
    }

    /// Adds the standard deviation of the coarse DTM's own heights, metres, to that of all heights.
    pub fn add_coarse(&mut self, coarse_sigma_m: f32) {
        if let Some(errors) = &mut self.errors {
            errors.heights_m.iter_mut().for_each(|sd_m| *sd_m = with_coarse(*sd_m, coarse_sigma_m));
        }
    }

    /// Returns what was found in the rows.
    #[must_use]
    pub fn finished(&self) -> Finished {
        let origins = self.errors.as_ref().map(|errors| {
            let mut counts = Origins::default();
            errors.origins.iter().for_each(|&code| counts[usize::from(code)] += 1);
            counts
        });
        Finished { origins, ..self.finished }
    }
}

/// Returns an empty vector with room for so many items.
fn room<T>(items: usize) -> Result<Vec<T>> {
    let mut made = vec![];
    elunar_base::memory::may_fail(|| made.try_reserve_exact(items))
        .map_err(|e| Error::io("maps in memory")(e.into()))?;
    Ok(made)
}
