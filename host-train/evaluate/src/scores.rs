//! The scores of one candidate.

use super::quantiles::Quantiles;
use elunar_base::{Error, Result};
use elunar_core::grid::GridView;
use elunar_core::metrics::{HeightErrors, SlopeErrors};
use elunar_core::terrain::{PixelSize, gradient};
use elunar_raster::Raster;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;

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
        let (rows, cols) = (truth.rows, truth.cols);
        let maps = [truth.samples.as_slice(), &dtm.samples];
        let band = Band { maps: &maps, cols, row: 0, inner: 0..rows };
        let scores = scored(1, rows * cols, pixel, &mut |take| take(&band))?;
        scores.into_iter().next().ok_or_else(|| Error::input("evaluate: a DTM expected, none found"))
    }
}

/// Some rows of the truth and of all candidates, in metres, NaN where any is void.
#[derive(Debug, Clone)]
pub(super) struct Band<'a, M: AsRef<[f32]> + Sync> {
    /// The truth first.
    pub maps: &'a [M],
    pub cols: usize,
    /// Number of the first row in the scene.
    pub row: usize,
    /// Rows that count. A row above and one below them give slopes, where there are such.
    pub inner: Range<usize>,
}

/// Receives bands, from top to bottom.
pub(super) type TakeBand<'a, M> = &'a mut dyn FnMut(&Band<'_, M>) -> Result<()>;

/// Scores `candidates` maps against the truth. `read` gives all bands, and is called several times: percentiles need the errors again. There are
/// `most` pixels at most.
///
/// # Errors
/// [`Error::Input`] if sizes differ or no pixel is valid. Errors of `read` are passed on.
pub(super) fn scored<M: AsRef<[f32]> + Sync>(
    candidates: usize,
    most: usize,
    pixel: PixelSize,
    read: &mut dyn FnMut(TakeBand<'_, M>) -> Result<()>,
) -> Result<Vec<Scores>> {
    let mut scorers: Vec<Scorer> = (0..candidates).map(|_| Scorer::new(most, pixel)).collect();
    while scorers.iter().any(|scorer| !scorer.is_done()) {
        read(&mut |band| {
            let all = scorers.par_iter_mut().zip(&band.maps[1..]);
            all.map(|(scorer, map)| scorer.add(band.maps[0].as_ref(), map.as_ref(), band.cols, &band.inner)).collect()
        })?;
        scorers.iter_mut().for_each(Scorer::end_reading);
    }
    scorers.iter().map(Scorer::scores).collect()
}

/// Scores that are being computed, in several readings: first sums and percentiles, then deviations from the median.
struct Scorer {
    pixel: PixelSize,
    most: usize,
    is_first: bool,
    heights: HeightErrors,
    slopes: SlopeErrors,
    errors: Quantiles,
    sizes: Quantiles,
    slope_sizes: Quantiles,
    about_median: Option<AboutMedian>,
}

/// Deviations of errors from their median.
struct AboutMedian {
    median_m: f64,
    is_first: bool,
    square: f64,
    sizes: Quantiles,
}

impl Scorer {
    fn new(most: usize, pixel: PixelSize) -> Self {
        let percentiles = || Quantiles::new(&PERCENTILES.map(|percent| f64::from(percent) / 100.0), most);
        Self {
            pixel,
            most,
            is_first: true,
            heights: HeightErrors::default(),
            slopes: SlopeErrors::default(),
            errors: Quantiles::new(&[0.5], most),
            sizes: percentiles(),
            slope_sizes: percentiles(),
            about_median: None,
        }
    }

    fn is_done(&self) -> bool {
        let percentiles = [&self.errors, &self.sizes, &self.slope_sizes].iter().all(|q| q.is_done());
        percentiles && self.about_median.as_ref().is_none_or(|about| about.sizes.is_done() && !about.is_first)
    }

    fn add(&mut self, truth: &[f32], dtm: &[f32], cols: usize, inner: &Range<usize>) -> Result<()> {
        let misfit = |e: elunar_core::error::LengthError| Error::input(format!("evaluate: {e}"));
        let rows = |map: &[f32]| map.len() / cols.max(1);
        let truth_grid = GridView::new(truth, rows(truth), cols).map_err(misfit)?;
        let dtm_grid = GridView::new(dtm, rows(dtm), cols).map_err(misfit)?;
        let within = |map: &'_ [f32]| inner.start * cols..(inner.end * cols).min(map.len());
        let (of_truth, of_dtm) = (&truth[within(truth)], &dtm[within(dtm)]);
        if self.is_first {
            self.heights.extend(of_truth, of_dtm, None).map_err(misfit)?;
            self.slopes.extend(truth_grid, dtm_grid, self.pixel).map_err(misfit)?;
        }
        let both = of_truth.iter().zip(of_dtm).filter(|(t, z)| t.is_finite() && z.is_finite());
        for error_m in both.map(|(t, z)| f64::from(*z) - f64::from(*t)) {
            self.errors.push(error_m);
            self.sizes.push(error_m.abs());
            if let Some(about) = &mut self.about_median {
                let deviation_m = error_m - about.median_m;
                if about.is_first {
                    about.square += deviation_m.powi(2);
                }
                about.sizes.push(deviation_m.abs());
            }
        }
        if !self.slope_sizes.is_done() {
            slope_errors(truth_grid, dtm_grid, self.pixel).for_each(|error_deg| self.slope_sizes.push(error_deg));
        }
        Ok(())
    }

    fn end_reading(&mut self) {
        self.is_first = false;
        [&mut self.errors, &mut self.sizes, &mut self.slope_sizes].into_iter().for_each(Quantiles::end_reading);
        if let Some(about) = &mut self.about_median {
            about.is_first = false;
            about.sizes.end_reading();
        } else if let Some(median_m) = self.errors.of().filter(|_| self.errors.is_done()) {
            let sizes = Quantiles::new(&[0.5], self.most);
            self.about_median = Some(AboutMedian { median_m: median_m[0], is_first: true, square: 0.0, sizes });
        }
    }

    fn scores(&self) -> Result<Scores> {
        let none = || Error::input("evaluate: a pixel valid in both expected, none found");
        let about = self.about_median.as_ref().ok_or_else(none)?;
        let (heights, slopes) = (&self.heights, &self.slopes);
        let error_percentiles_m = percentiles(&self.sizes);
        Ok(Scores {
            pixels: heights.count(),
            share_within: heights.share_within().unwrap_or_default(),
            mae_m: heights.mae_m().unwrap_or_default(),
            rmse_m: heights.rmse_m().unwrap_or_default(),
            bias_m: heights.bias_m().unwrap_or_default(),
            median_m: about.median_m,
            rmse_median_removed_m: (about.square / heights.count() as f64).sqrt(),
            largest_m: heights.max_m().unwrap_or_default(),
            nmad_m: NORMAL * about.sizes.of().map_or(0.0, |median| median[0]),
            error_95_m: error_percentiles_m[3],
            error_percentiles_m,
            slope_error_percentiles_deg: percentiles(&self.slope_sizes),
            slope_pixels: slopes.count(),
            slope_mae_deg: slopes.mae_deg().unwrap_or_default(),
            slope_rmse_deg: slopes.rmse_deg().unwrap_or_default(),
            slope_bias_deg: slopes.bias_deg().unwrap_or_default(),
        })
    }
}

fn percentiles(found: &Quantiles) -> [f64; PERCENTILES.len()] {
    found.of().and_then(|found| found.try_into().ok()).unwrap_or_default()
}

/// Returns |error| of the Horn slope, degrees, of all pixels with a slope in both.
fn slope_errors(truth: GridView<'_, f32>, dtm: GridView<'_, f32>, pixel: PixelSize) -> impl Iterator<Item = f64> {
    let slope_deg = move |grid: GridView<'_, f32>, row: usize, col: usize| {
        gradient(grid, row, col, pixel).map(|(east, south)| east.hypot(south).atan().to_degrees())
    };
    let cols = truth.cols();
    let all = (0..truth.rows()).flat_map(move |row| (0..cols).map(move |col| (row, col)));
    all.filter_map(move |(row, col)| Some((slope_deg(dtm, row, col)? - slope_deg(truth, row, col)?).abs()))
}
