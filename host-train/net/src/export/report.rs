//! The error of quantisation: the runner against the float network, on tiles that were not used for calibration.

use super::calibrate::CalibrationTile;
use super::compile::Export;
use super::float;
use elunar_base::{Error, Result};
use elunar_core::grid::GridView;
use elunar_core::nn::{Model, Progress, Runner, required};
use elunar_core::terrain::{PixelSize, slope_deg};
use elunar_core::tile::Shape;
use std::fmt;

/// Differences between the int8 runner and the float network.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct RunnerDifferences {
    /// Number of tiles compared.
    pub tiles: usize,
    /// Root mean square difference, normalised units.
    pub rmse_units: f64,
    /// Largest difference, normalised units.
    pub max_units: f64,
    /// The differences in metres, and their effect on the DTM; `None` if the tiles are not terrain.
    pub ground: Option<GroundComparison>,
}

/// Differences in metres and degrees.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct GroundComparison {
    /// Root mean square difference between int8 and float, metres.
    pub rmse_m: f64,
    /// Largest difference between int8 and float, metres.
    pub max_m: f64,
    /// Root mean square difference of Horn slopes between int8 and float, degrees.
    pub slope_rmse_deg: f64,
    /// Error of the float network against the truth, metres.
    pub float_error_m: f64,
    /// Error of the int8 runner against the truth, metres.
    pub int8_error_m: f64,
    /// Slope error of the float network against the truth, degrees.
    pub float_slope_error_deg: f64,
    /// Slope error of the int8 runner against the truth, degrees.
    pub int8_slope_error_deg: f64,
    /// Growth of the error against the truth from float to int8, percent.
    pub error_growth_percent: f64,
    /// Growth of the slope error, percent.
    pub slope_error_growth_percent: f64,
}

/// Runs both networks on every tile. Calls `progress` after each.
///
/// # Errors
/// [`Error::Input`] if the runner refuses a tile.
pub fn compare(export: &Export, tiles: &[CalibrationTile], progress: impl Fn(usize)) -> Result<RunnerDifferences> {
    let fault = |e: &dyn fmt::Display| Error::input(format!("export: comparison: {e}"));
    let model = Model::new(&export.bytes).map_err(|e| fault(&e))?;
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::new(model, &mut arena).map_err(|e| fault(&e))?;
    let mut sum = Sums::default();
    for (index, tile) in tiles.iter().enumerate() {
        let float = float::run(&export.graph, &tile.image, &tile.coarse).pop().unwrap_or_default();
        let mut int8 = vec![0.0; float.len()];
        runner.begin(&tile.image, &tile.coarse).map_err(|e| fault(&e))?;
        while runner.step(u64::MAX).map_err(|e| fault(&e))? == Progress::Running {}
        runner.output(&mut int8).map_err(|e| fault(&e))?;
        sum.take(&float, &int8, tile, model.tile());
        progress(index + 1);
    }
    Ok(sum.comparison(tiles.len()))
}

/// Differences between two results over some tiles.
#[derive(Default)]
pub(crate) struct Sums {
    units: Mean,
    max_units: f64,
    metres: Mean,
    max_m: f64,
    slope: Mean,
    /// Errors of float and int8 against the truth: metres, then degrees.
    errors: [Mean; 4],
}

/// A mean of squares.
#[derive(Default, Clone, Copy)]
struct Mean {
    sum: f64,
    count: usize,
}

impl Mean {
    fn take(&mut self, a: &[f32], b: &[f32], factor: f64) {
        for (a, b) in a.iter().zip(b).filter(|(a, b)| a.is_finite() && b.is_finite()) {
            self.sum += ((*a as f64 - *b as f64) * factor).powi(2);
            self.count += 1;
        }
    }

    fn root(self) -> f64 {
        (self.sum / self.count.max(1) as f64).sqrt()
    }
}

impl Sums {
    pub(crate) fn take(&mut self, float: &[f32], int8: &[f32], tile: &CalibrationTile, Shape { rows, cols }: Shape) {
        let largest = float.iter().zip(int8).fold(0.0f64, |m, (a, b)| m.max((*a as f64 - *b as f64).abs()));
        self.units.take(float, int8, 1.0);
        self.max_units = self.max_units.max(largest);
        let Some(ground) = &tile.ground else { return };
        let metres = ground.metres_per_unit as f64;
        self.metres.take(float, int8, metres);
        self.max_m = self.max_m.max(largest * metres);
        let slopes =
            [float, int8, &ground.truth].map(|map| slope(map, rows, cols, ground.metres_per_unit, ground.pixel_m));
        self.slope.take(&slopes[0], &slopes[1], 1.0);
        self.errors[0].take(float, &ground.truth, metres);
        self.errors[1].take(int8, &ground.truth, metres);
        self.errors[2].take(&slopes[0], &slopes[2], 1.0);
        self.errors[3].take(&slopes[1], &slopes[2], 1.0);
    }

    /// Returns the comparison over `tiles` tiles.
    pub(crate) fn comparison(&self, tiles: usize) -> RunnerDifferences {
        let [float_error_m, int8_error_m, float_slope_error_deg, int8_slope_error_deg] = self.errors.map(Mean::root);
        let ground = GroundComparison {
            rmse_m: self.metres.root(),
            max_m: self.max_m,
            slope_rmse_deg: self.slope.root(),
            float_error_m,
            int8_error_m,
            float_slope_error_deg,
            int8_slope_error_deg,
            error_growth_percent: growth_percent(float_error_m, int8_error_m),
            slope_error_growth_percent: growth_percent(float_slope_error_deg, int8_slope_error_deg),
        };
        RunnerDifferences {
            tiles,
            rmse_units: self.units.root(),
            max_units: self.max_units,
            ground: (self.metres.count > 0).then_some(ground),
        }
    }
}

/// Returns the growth from one error to another, percent; 0 if the first is 0.
pub(crate) fn growth_percent(before: f64, after: f64) -> f64 {
    if before > 0.0 { 100.0 * (after / before - 1.0) } else { 0.0 }
}

/// Returns the Horn slope of normalised heights, degrees; NaN at the border.
fn slope(map: &[f32], rows: usize, cols: usize, metres_per_unit: f32, pixel_m: f32) -> Vec<f32> {
    let metres: Vec<f32> = map.iter().map(|v| v * metres_per_unit).collect();
    let mut out = vec![f32::NAN; metres.len()];
    if let Ok(grid) = GridView::new(&metres, rows, cols) {
        // The lengths are equal by construction.
        let _ = slope_deg(grid, PixelSize::square(pixel_m as f64), &mut out);
    }
    out
}

impl fmt::Display for RunnerDifferences {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "int8 against float on {} tiles not used for calibration:", self.tiles)?;
        write!(f, "  difference    {:.4} rms, {:.3} largest, in normalised units", self.rmse_units, self.max_units)?;
        let Some(g) = &self.ground else { return Ok(()) };
        writeln!(
            f,
            "\n  difference    {:.3} m rms, {:.2} m largest; slope {:.3} deg rms",
            g.rmse_m, g.max_m, g.slope_rmse_deg
        )?;
        writeln!(f, "  float error   {:.3} m rms; slope {:.3} deg rms", g.float_error_m, g.float_slope_error_deg)?;
        writeln!(f, "  int8 error    {:.3} m rms; slope {:.3} deg rms", g.int8_error_m, g.int8_slope_error_deg)?;
        write!(f, "  growth        {:+.2} %; slope {:+.2} %", g.error_growth_percent, g.slope_error_growth_percent)
    }
}
