//! One tile: heights from image and coarse DTM.

use super::journal::{LevelLog, SfsJournal, StepLog, TileLog, errors};
use super::level::{Level, Objective};
use super::pyramid::{doubled, pyramid};
use super::settings::SfsSettings;
use super::solver::{End, solve};
use crate::mosaic::TileWeights;
use crate::predict::{Band, Cutout, TileMaker, TileOutcome};
use elunar_base::Result;
use elunar_core::terrain::PixelSize;
use elunar_core::tile::{Shape, Window};
use std::time::{Duration, Instant};

/// Solves tiles on one thread.
pub(super) struct Solver<'a> {
    objective: Objective,
    settings: SfsSettings,
    /// Distance from one row and from one column to the next, metres.
    pixel_m: (f64, f64),
    weights: TileWeights,
    journal: &'a SfsJournal,
}

impl<'a> Solver<'a> {
    pub(super) fn new(
        settings: SfsSettings,
        scene: Shape,
        pixel_m: (f64, f64),
        journal: &'a SfsJournal,
    ) -> Result<Self> {
        let objective = Objective {
            light: settings.light()?,
            smoothness_m: settings.smoothness_weight_m,
            dem_per_m: settings.dem_constraint_weight_per_m,
        };
        Ok(Self { objective, settings, pixel_m, weights: TileWeights::new(scene), journal })
    }
}

impl TileMaker for Solver<'_> {
    fn make(&mut self, band: &Band, window: Window) -> Result<TileOutcome> {
        let Some(Cutout { image, coarse_m, valid }) = band.cut(window) else { return Ok(TileOutcome::Empty) };
        let weigh = |(&weight, &valid): (&f64, &bool)| if valid { weight } else { 0.0 };
        let weights = self.weights.of(window).iter().zip(&valid).map(weigh).collect();
        let truth_m = self.journal.truth(window)?;
        let maps = TileMaps { image: &image, coarse_m: &coarse_m, valid: &valid, truth_m: truth_m.as_deref() };
        match self.heights(&maps, window)? {
            Some((heights_m, log)) => {
                self.journal.add(log);
                Ok(TileOutcome::Predicted { maps: heights_m.into(), weights })
            }
            None => Ok(TileOutcome::Coarse { maps: coarse_m.into(), weights }),
        }
    }
}

/// The maps of a tile, row-major.
struct TileMaps<'a> {
    image: &'a [f32],
    coarse_m: &'a [f32],
    valid: &'a [bool],
    truth_m: Option<&'a [f32]>,
}

impl Solver<'_> {
    /// Returns the heights, metres; `None` for a tile without contrast.
    fn heights(&self, maps: &TileMaps, window: Window) -> Result<Option<(Vec<f32>, TileLog)>> {
        let start = Instant::now();
        let mut watching = Duration::ZERO;
        let Some((finest, lit_px)) = self.finest(maps, window) else { return Ok(None) };
        // Heights are relative to this datum, so that their squares do not swamp small differences.
        let datum_m = maps.coarse_m.iter().map(|&z| f64::from(z)).sum::<f64>() / maps.coarse_m.len() as f64;
        let finest = Level { coarse_m: finest.coarse_m.iter().map(|z| z - datum_m).collect(), ..finest };
        let levels = pyramid(finest, self.settings.levels);
        let pixel = PixelSize { row_m: self.pixel_m.0, col_m: self.pixel_m.1 };
        let mut logs = vec![];
        // The correction to the coarse DTM, from the coarser level.
        let mut correction: Option<(Vec<f64>, usize)> = None;
        for (index, level) in levels.iter().enumerate().rev() {
            let mut heights_m = level.coarse_m.clone();
            if let Some((half, half_cols)) = &correction {
                let added = doubled(half, *half_cols, level.rows, level.cols);
                heights_m.iter_mut().zip(added).for_each(|(z, add)| *z += add);
            }
            let mut steps = vec![];
            let end = solve(level, &self.objective, &self.settings, &mut heights_m, |step, heights_m| {
                let watch = Instant::now();
                let errors = maps.truth_m.and_then(|truth_m| {
                    let heights_m = at_full_size(&levels, index, heights_m);
                    let heights_m: Vec<f32> = heights_m.iter().map(|z| (z + datum_m) as f32).collect();
                    errors(truth_m, &heights_m, window.cols, pixel).ok()
                });
                steps.push(StepLog::new(step, level, errors));
                watching += watch.elapsed();
            });
            logs.push(LevelLog { rows: level.rows, cols: level.cols, converged: end == End::Converged, steps });
            heights_m.iter_mut().zip(&level.coarse_m).for_each(|(z, coarse)| *z -= coarse);
            correction = Some((heights_m, level.cols));
        }
        let mut heights_m = maps.coarse_m.to_vec();
        if let Some((added, _)) = correction {
            heights_m.iter_mut().zip(added).for_each(|(z, add)| *z = (f64::from(*z) + add) as f32);
        }
        let seconds = (start.elapsed() - watching).as_secs_f64();
        Ok(Some((heights_m, TileLog { row: window.row, col: window.col, seconds, lit_px, levels: logs })))
    }

    /// Returns the level of the full image, and the number of its pixels with weight.
    fn finest(&self, maps: &TileMaps, window: Window) -> Option<(Level, usize)> {
        let Window { rows, cols, .. } = window;
        let seen = || maps.image.iter().zip(maps.valid).filter(|(_, valid)| **valid).map(|(v, _)| f64::from(*v));
        let mean = seen().sum::<f64>() / seen().count() as f64;
        let (low, high) = seen().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        // Without contrast it is not an image of sunlit ground.
        if !(mean > 0.0 && low < high) || rows < 3 || cols < 3 {
            return None;
        }
        let image: Vec<f64> = maps.image.iter().map(|&v| f64::from(v) / mean).collect();
        let counts = |i: usize| {
            let (row, col) = (i / cols, i % cols);
            let inner = row > 0 && col > 0 && row + 1 < rows && col + 1 < cols;
            inner && maps.valid[i] && image[i] > self.settings.shadow_threshold
        };
        let weight: Vec<f64> = (0..rows * cols).map(|i| if counts(i) { 1.0 } else { 0.0 }).collect();
        let lit_px = weight.iter().filter(|&&w| w > 0.0).count();
        let coarse_m = maps.coarse_m.iter().map(|&z| f64::from(z)).collect();
        let level = Level { rows, cols, row_m: self.pixel_m.0, col_m: self.pixel_m.1, image, weight, coarse_m };
        (lit_px > 0).then_some((level, lit_px))
    }
}

/// Returns the heights of a level on the grid of the finest level.
fn at_full_size(levels: &[Level], index: usize, heights_m: &[f64]) -> Vec<f64> {
    let mut added: Vec<f64> = heights_m.iter().zip(&levels[index].coarse_m).map(|(z, coarse)| z - coarse).collect();
    for (fine, half) in levels.iter().zip(&levels[1..]).take(index).rev() {
        added = doubled(&added, half.cols, fine.rows, fine.cols);
    }
    added.iter().zip(&levels[0].coarse_m).map(|(add, coarse)| add + coarse).collect()
}
