//! Log of the solvers, tile by tile: time, steps, costs, and errors if a truth is given.

use super::level::Level;
use super::solver::Step;
use crate::predict::{NamedRaster, Scene};
use elunar_base::{Error, Result};
use elunar_core::grid::GridView;
use elunar_core::metrics::{HeightErrors, SlopeErrors};
use elunar_core::terrain::PixelSize;
use elunar_core::tile::Window;
use elunar_raster::align::{Interpolation, Onto};
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// Collects the logs of all threads.
pub struct SfsJournal {
    truth: Option<Onto>,
    /// Rows and columns of the scene.
    scene: (usize, usize),
    tiles: Mutex<BTreeMap<(usize, usize), TileLog>>,
}

/// Log of one tile.
#[derive(Debug, Clone)]
pub struct TileLog {
    /// First row of the tile in the scene.
    pub row: usize,
    /// First column of the tile in the scene.
    pub col: usize,
    /// Seconds of the thread that solved the tile, without comparisons with the truth.
    pub seconds: f64,
    /// Number of pixels whose brightness counted.
    pub lit_px: usize,
    /// Levels of the pyramid, coarsest first.
    pub levels: Vec<LevelLog>,
}

impl TileLog {
    /// Returns whether every level ran until its cost no longer fell.
    #[must_use]
    pub fn converged(&self) -> bool {
        self.levels.iter().all(|level| level.converged)
    }
}

/// The steps of one level.
#[derive(Debug, Clone)]
pub struct LevelLog {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Whether the level ran until the cost no longer fell.
    pub converged: bool,
    /// The start, then the steps.
    pub steps: Vec<StepLog>,
}

/// One Gauss–Newton step. Costs are means over the level's pixels of squares of brightness relative to its mean.
#[derive(Debug, Clone, Copy)]
pub struct StepLog {
    /// Cost of brightness.
    pub brightness: f64,
    /// Cost of roughness.
    pub smoothness: f64,
    /// Cost of the departure from the coarse DTM.
    pub dem: f64,
    /// Relative brightness per unit reflectance.
    pub exposure: f64,
    /// Number of conjugate gradient iterations.
    pub gradients: usize,
    /// Errors of height (metres) and slope (degrees) against the truth, on the image's grid.
    pub errors: Option<(HeightErrors, SlopeErrors)>,
}

impl StepLog {
    pub(super) fn new(step: &Step, level: &Level, errors: Option<(HeightErrors, SlopeErrors)>) -> Self {
        let per_px = 1.0 / (level.rows * level.cols) as f64;
        let Step { cost, gradients } = *step;
        Self {
            brightness: cost.brightness * per_px,
            smoothness: cost.smoothness * per_px,
            dem: cost.dem * per_px,
            exposure: cost.exposure,
            gradients,
            errors,
        }
    }

    /// Returns the sum of all terms of the cost.
    #[must_use]
    pub fn cost(&self) -> f64 {
        self.brightness + self.smoothness + self.dem
    }
}

impl SfsJournal {
    /// Makes an empty journal for a scene. With a truth, every step is scored (bilinearly, on the image's grid). The time for this is not
    /// counted as the tile's time.
    ///
    /// # Errors
    /// As [`Onto::new`], for the truth.
    pub fn new(scene: &Scene, image: &NamedRaster, truth: Option<NamedRaster>) -> Result<Self> {
        let onto = |truth: NamedRaster| {
            Onto::new(truth.source, &truth.name, image.source.info(), &image.name, Interpolation::Bilinear)
        };
        let truth = truth.map(onto).transpose()?;
        Ok(Self { truth, scene: (scene.rows, scene.cols), tiles: Mutex::default() })
    }

    /// Returns the logs so far, in reading order.
    #[must_use]
    pub fn tiles(&self) -> Vec<TileLog> {
        self.tiles.lock().unwrap_or_else(PoisonError::into_inner).values().cloned().collect()
    }

    pub(super) fn add(&self, log: TileLog) {
        self.tiles.lock().unwrap_or_else(PoisonError::into_inner).insert((log.row, log.col), log);
    }

    /// Returns the true heights of a tile, metres, NaN beyond the scene; `None` without a truth.
    pub(super) fn truth(&self, window: Window) -> Result<Option<Vec<f32>>> {
        let Some(truth) = &self.truth else { return Ok(None) };
        let rows = window.rows.min(self.scene.0.saturating_sub(window.row));
        let cols = window.cols.min(self.scene.1.saturating_sub(window.col));
        let inside = truth.read(Window { rows, cols, ..window })?;
        let mut out = vec![f32::NAN; window.rows * window.cols];
        for (line, from) in out.chunks_exact_mut(window.cols).zip(inside.chunks_exact(cols)) {
            line[..cols].copy_from_slice(from);
        }
        Ok(Some(out))
    }
}

/// Returns the errors of a tile's heights.
///
/// # Errors
/// If sizes differ.
pub(super) fn errors(
    truth_m: &[f32],
    heights_m: &[f32],
    cols: usize,
    pixel: PixelSize,
) -> Result<(HeightErrors, SlopeErrors)> {
    let misfit = |e: elunar_core::error::LengthError| Error::input(format!("truth of a tile: {e}"));
    let rows = truth_m.len() / cols;
    let (mut heights, mut slopes) = (HeightErrors::default(), SlopeErrors::default());
    heights.extend(truth_m, heights_m, None).map_err(misfit)?;
    let grid = |samples| GridView::new(samples, rows, cols).map_err(misfit);
    slopes.extend(grid(truth_m)?, grid(heights_m)?, pixel).map_err(misfit)?;
    Ok((heights, slopes))
}
