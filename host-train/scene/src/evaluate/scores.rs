//! The scores of one candidate.

use elunar_core::grid::GridView;
use elunar_core::metrics::{HeightErrors, SlopeErrors};
use elunar_core::terrain::{PixelSize, gradient};
use elunar_raster::quantile::quantile;
use elunar_raster::{Error, Raster, Result};
use serde::{Deserialize, Serialize};

/// Standard deviation of a normal distribution over its median absolute deviation.
const NORMAL: f64 = 1.4826;

/// Percentiles of absolute errors, %.
pub const PERCENTILES: [u32; 5] = [50, 68, 90, 95, 99];

/// Errors are candidate minus truth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// Pixels scored.
    pub pixels: u64,
    /// Shares, in [0, 1], of |error| below 2, 4 and 10 m (the paper's RE, Sec. V).
    pub share_within: [f64; 3],
    /// Mean absolute error, metres (the paper's MAE).
    pub mae_m: f64,
    /// Root mean square error, metres (Eq. 12).
    pub rmse_m: f64,
    /// Mean error, metres.
    pub bias_m: f64,
    /// Median error, metres.
    pub median_m: f64,
    /// Root mean square error after the median is subtracted. A constant error of the datum does not change it.
    pub rmse_median_removed_m: f64,
    /// Largest |error|, metres.
    pub largest_m: f64,
    /// Normalised median absolute deviation, metres: 1.4826 times the median of |error - median|. It equals the standard deviation of normal
    /// errors, and outliers hardly change it.
    pub nmad_m: f64,
    /// |error| that 95 % of the pixels do not exceed, metres (LE95).
    pub error_95_m: f64,
    /// |error| that 50, 68, 90, 95 and 99 % of the pixels do not exceed ([`PERCENTILES`]), metres.
    #[serde(default)]
    pub error_percentiles_m: [f64; PERCENTILES.len()],
    /// |error| of the Horn slope that 50, 68, 90, 95 and 99 % of the pixels with a slope do not exceed, degrees.
    #[serde(default)]
    pub slope_error_percentiles_deg: [f64; PERCENTILES.len()],
    /// Pixels with a slope in both, which needs 3 x 3 valid pixels. If there are 0, the slope figures below are 0 as well.
    pub slope_pixels: u64,
    /// Mean absolute error of the Horn slope, degrees.
    pub slope_mae_deg: f64,
    /// Root mean square error of the slope, degrees.
    pub slope_rmse_deg: f64,
    /// Mean error of the slope, degrees. It is negative for a candidate that is too smooth.
    pub slope_bias_deg: f64,
}

impl Scores {
    /// Scores `dtm` against `truth`, both in metres on one grid, over the pixels that are valid in both.
    ///
    /// # Errors
    /// [`Error::Input`] if the sizes differ or no pixel is valid in both.
    pub fn of(truth: &Raster, dtm: &Raster, pixel: PixelSize) -> Result<Self> {
        let misfit = |e: elunar_core::error::LengthError| Error::input(format!("evaluate: {e}"));
        let mut heights = HeightErrors::default();
        heights.extend(&truth.samples, &dtm.samples, None).map_err(misfit)?;
        let mut slopes = SlopeErrors::default();
        let truth_grid = GridView::new(&truth.samples, truth.rows, truth.cols).map_err(misfit)?;
        let dtm_grid = GridView::new(&dtm.samples, dtm.rows, dtm.cols).map_err(misfit)?;
        slopes.extend(truth_grid, dtm_grid, pixel).map_err(misfit)?;
        let both = truth.samples.iter().zip(&dtm.samples).filter(|(t, z)| t.is_finite() && z.is_finite());
        let mut errors: Vec<f64> = both.map(|(t, z)| f64::from(*z) - f64::from(*t)).collect();
        let median_m = quantile(&mut errors, 0.5)
            .ok_or_else(|| Error::input("evaluate: a pixel valid in both expected, none found"))?;
        let mut sizes: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
        let mut deviations: Vec<f64> = errors.iter().map(|e| (e - median_m).abs()).collect();
        let mut slope_sizes = slope_errors(truth_grid, dtm_grid, pixel);
        let square = errors.iter().map(|e| (e - median_m).powi(2)).sum::<f64>() / errors.len() as f64;
        Ok(Self {
            pixels: heights.count(),
            share_within: heights.share_within().unwrap_or_default(),
            mae_m: heights.mae_m().unwrap_or_default(),
            rmse_m: heights.rmse_m().unwrap_or_default(),
            bias_m: heights.bias_m().unwrap_or_default(),
            median_m,
            rmse_median_removed_m: square.sqrt(),
            largest_m: heights.max_m().unwrap_or_default(),
            nmad_m: NORMAL * quantile(&mut deviations, 0.5).unwrap_or_default(),
            error_95_m: quantile(&mut sizes, 0.95).unwrap_or_default(),
            error_percentiles_m: percentiles(&mut sizes),
            slope_error_percentiles_deg: percentiles(&mut slope_sizes),
            slope_pixels: slopes.count(),
            slope_mae_deg: slopes.mae_deg().unwrap_or_default(),
            slope_rmse_deg: slopes.rmse_deg().unwrap_or_default(),
            slope_bias_deg: slopes.bias_deg().unwrap_or_default(),
        })
    }
}

fn percentiles(values: &mut [f64]) -> [f64; PERCENTILES.len()] {
    PERCENTILES.map(|percent| quantile(values, f64::from(percent) / 100.0).unwrap_or_default())
}

/// Returns |error| of the Horn slope, degrees, of all pixels with a slope in both.
fn slope_errors(truth: GridView<'_, f32>, dtm: GridView<'_, f32>, pixel: PixelSize) -> Vec<f64> {
    let slope_deg = |grid: GridView<'_, f32>, row: usize, col: usize| {
        gradient(grid, row, col, pixel).map(|(east, south)| east.hypot(south).atan().to_degrees())
    };
    let all = (0..truth.rows()).flat_map(|row| (0..truth.cols()).map(move |col| (row, col)));
    all.filter_map(|(row, col)| Some((slope_deg(dtm, row, col)? - slope_deg(truth, row, col)?).abs())).collect()
}
