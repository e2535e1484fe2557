//! A light fitted to image and coarse DTM, and how sure it is.
//!
//! Brightness is regressed on the slopes of the coarse DTM in two octaves of wavelength, 2 to 4 and 4 to 8 pixels of the coarse DTM (our
//! choice). Shorter waves are missing in a coarse DTM: its slopes are too small there, and a fit finds a light that is too strong. Longer
//! waves of brightness are albedo and a Sun that turns, more than relief.
//!
//! - Both sides of the regression have the same smoothing. Slopes are means over a square cell as wide as a coarse pixel. The coarse DTM
//!   itself is a mean over a coarse pixel, so brightness is averaged over cell and coarse pixel, one after the other: with a tent.
//! - An octave is the variation of four cells, two by two, about their mean: a nested analysis of variance. The next octave takes these
//!   means as cells. Cells overlap: one begins at every half cell, so that all ground counts, and a mirrored scene has the
//!   mirrored light.
//! - A square of half a cell's side whose every pixel is dark (below a tenth of the mean brightness) lies in shadow, which shows no slope.
//!   Cells with such a square under their tent are left out (our choice: if only cells go that are dark throughout, a shadow over half of an
//!   image spoils the light of the other half). A cell with some dark pixels stays: without it the fit would miss the steepest ground and
//!   become too strong.
//! - Slopes of one direction alone that the image does not show count as error of the coarse DTM (`light_fit/relief.rs`).
//! - The octaves are weighted by the inverse of their unexplained variance (generalised least squares), since albedo is stronger in long
//!   waves.
//!
//! The image alone shows the line along which the Sun shines ([`Axis`]), but not from which end.

mod axis;
mod cells;
mod relief;
mod strength;

pub use axis::Axis;
pub(crate) use axis::DIRECTED_RELIEF;

use crate::norm::light::{Light, STRENGTH_MAX, STRENGTH_MIN};
use crate::norm::shading::Brightness;
use crate::part::{head_mut, item};
use crate::samples::Samples;
use crate::terrain::PixelSize;
use crate::words::Words;
use cells::{Cell, CellColumns, PHASES, Places, Rectangle, mean_of};
use relief::Relief;
use strength::{Expected, Strength};

/// Cells along the side of the widest square.
const COLUMNS: usize = 4;
/// Columns of cells that are read together where memory allows it. With 32 the function has 32 KiB of stack, which LLVM reserves in a loop that may
/// overwrite an argument.
const COLUMNS_TOGETHER: usize = 24;
/// Octaves of the fit.
const OCTAVES: usize = 2;
/// Smallest number of degrees of freedom of an octave: two are fitted.
const FREEDOM_MIN: f64 = 3.0;
/// Factor on the formal variance of the fit, for the direction of the light and its sign. Cells are correlated, and shading is not linear:
/// over 22 real and synthetic scenes errors are twice as large as the formal ones.
const VARIANCE_FACTOR: f64 = 4.0;
/// Share of the brightness's variance that is never taken for explained.
const UNEXPLAINED_MIN: f64 = 1e-4;
/// Standard deviation of the logarithm of the strength for a Sun of known elevation: images are often not linear in radiance, and the ground
/// does not always follow the Lunar-Lambert law (our choice; with 0.3 ray-traced images in 8 bits become worse than the coarse DTM).
const TOLD_SPREAD: f64 = 0.6;
/// The strength that is expected of a Sun of unknown elevation, and the standard deviation of its logarithm: a Sun 25 degrees high, between
/// 8 and 50 (our choice).
const EXPECTED_STRENGTH: f64 = 1.8;
const EXPECTED_SPREAD: f64 = 0.9;
/// Standard deviation of the logarithm of the strength that the image's contrast implies, by the share of it that has the light's direction (our
/// choice: a factor of 1.8).
const SHARE_SPREAD: f64 = 0.6;
/// Probability, before the fit is seen, that an image shows the ground of the coarse DTM; and if the caller tells its Sun (our choice).
const RELATED: f64 = 0.5;
const RELATED_TOLD: f64 = 0.9;

/// A light and its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightEstimate {
    /// The light.
    pub light: Light,
    /// Standard deviation of the logarithm of its strength.
    pub log_strength_sd: f32,
    /// Standard deviation of its azimuth, degrees, at most 180; 0 for a known azimuth.
    pub azimuth_sd_deg: f32,
    /// Share of the relief found under this light that is kept, 0 to 1; 1 for a known azimuth. Our choice: nearly the square of the expected
    /// cosine between the true and the fitted direction, erf(s / sqrt 2)^2 / (1 + t^2), with s the strength in standard deviations and t
    /// the standard deviation of the azimuth in radians. The first factor is the expected sign.
    pub trust: f32,
    /// Probability that brightness follows the slopes of the coarse DTM at all, 0 to 1. It is low where the image is of
    /// other ground, is misplaced, or shows albedo alone: then a fit finds a light by chance. Our choice: as likely as not before the fit is
    /// seen, nine to one if the azimuth is known; the Bayes factor of a light of the expected strength, along the image's [`Axis`] or the known
    /// azimuth, against none; with the formal variance of the fit.
    pub related: f32,
    /// Share of the contrast that is relief under this light in the waves of the fit, 2 to 8 coarse pixels, 0 to 1: what its strength explains there.
    /// `None` without a fit.
    pub long_share: Option<f32>,
}

/// A fit of the light to the parts of a scene added so far. The memory is fixed.
///
/// ```
/// use elunar_core::norm::{Light, LightFit};
///
/// // Hills with waves of 40 pixels, and a coarse DTM whose pixels are 8 pixels wide.
/// let height_m = |row: f32, col: f32| 3.0 * (row / 6.4).sin() + 2.0 * ((col + row) / 6.4).cos();
/// let light = Light::from_sun(300.0, 40.0).expect("above the horizon");
/// let pixels = || (0..160 * 160).map(|i| ((i / 160) as f32, (i % 160) as f32));
/// let coarse_m: Vec<f32> = pixels().map(|(row, col)| height_m(row, col)).collect();
/// let slope = |row: f32, col: f32| [height_m(row, col + 0.5) - height_m(row, col - 0.5), height_m(row + 0.5, col) - height_m(row - 0.5, col)];
/// let image: Vec<f32> = pixels()
///     .map(|(row, col)| 100.0 * (1.0 + (light.east * slope(row, col)[0] + light.south * slope(row, col)[1]) / 2.0))
///     .collect();
/// let fit = LightFit::of_tile(&image[..], &coarse_m, 160, 2.0, 8.0);
/// let found = fit.estimate(None, None).expect("hills in the light");
/// assert!((found.light.azimuth_deg() - 300.0).abs() < 3.0 && found.azimuth_sd_deg < 3.0 && found.trust > 0.9);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LightFit {
    /// Number of cells, and the sum over them of the mean brightness of lit ground about them.
    cells: f64,
    brightness: f64,
    octaves: [Octave; OCTAVES],
    axis: Option<Axis>,
}

/// Sums of one octave.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Octave {
    freedom: f64,
    /// Sums of products of deviations: II, Ix, Iy, xx, xy, yy.
    products: [f64; 6],
}

impl Octave {
    /// Adds four cells with a weight.
    #[inline]
    fn add(&mut self, cells: &[Cell; 4], weight: f64) {
        let mean = mean_of(cells);
        for [i, x, y] in cells {
            let [i, x, y] = [i - mean[0], x - mean[1], y - mean[2]];
            for (sum, v) in self.products.iter_mut().zip([i * i, i * x, i * y, x * x, x * y, y * y]) {
                *sum += weight * v;
            }
        }
        self.freedom += 3.0 * weight;
    }
}

/// What octaves know of the light: the inverse of its covariance (xx, xy, yy), and this matrix times the light (x, y).
#[derive(Debug, Clone, Copy)]
struct Information {
    precision: [f64; 3],
    vector: [f64; 2],
}

impl Information {
    /// Returns the light of the best fit and its covariance.
    fn solve(&self) -> Option<([f64; 2], [f64; 3])> {
        let ([xx, xy, yy], [x, y]) = (self.precision, self.vector);
        let determinant = xx * yy - xy * xy;
        let covariance = [yy / determinant, -xy / determinant, xx / determinant];
        let light = [covariance[0] * x + covariance[1] * y, covariance[1] * x + covariance[2] * y];
        let finite = light.iter().chain(&covariance).all(|v| v.is_finite());
        (finite && determinant > 0.0).then_some((light, covariance))
    }
}

impl Information {
    /// Returns the best strength of a light from this direction, and its variance.
    fn strength(&self, [x, y]: [f64; 2]) -> (f64, f64) {
        let precision = square(self.precision, [x, y]);
        ((self.vector[0] * x + self.vector[1] * y) / precision, 1.0 / precision)
    }

    /// Returns the probability that there is a light at all, if that is as likely as not before: its components are both 0, or have a
    /// Gaussian distribution about 0 with the covariance S, that of lights of the expected strength, along an axis if one is known. With the
    /// precision P and the best light v, the odds are `exp(v' P (P + S^-1)^-1 P v / 2) / sqrt(det(I + S P))`.
    fn related(&self, axis: Option<Axis>) -> f64 {
        let [x, y] = axis.map_or([1.0, 0.0], |axis| direction(axis.azimuth_deg));
        // Parts of the expected square of the strength along the axis and across it: half of it each without an axis, and otherwise the mean
        // square of the sine of a Gaussian angle across.
        let turn = axis.map_or(f64::INFINITY, |axis| axis.sd_deg.to_radians());
        let across = -0.5 * libm::expm1(-2.0 * turn * turn);
        let [along, across] = [1.0 - across, across].map(|part| part * EXPECTED_STRENGTH * EXPECTED_STRENGTH);
        let prior = [x * x / along + y * y / across, x * y / along - x * y / across, y * y / along + x * x / across];
        let [b, c] = self.vector.map(|v| VARIANCE_FACTOR * v);
        let mut both = Self { precision: self.precision.map(|v| VARIANCE_FACTOR * v), vector: [b, c] };
        both.precision.iter_mut().zip(prior).for_each(|(sum, v)| *sum += v);
        let Some((light, _)) = both.solve() else { return 0.0 };
        let [xx, xy, yy] = both.precision;
        let log_odds = 0.5 * (b * light[0] + c * light[1] - libm::log(along * across * (xx * yy - xy * xy)));
        let odds = libm::exp(log_odds) * RELATED / (1.0 - RELATED);
        1.0 / (1.0 + 1.0 / odds)
    }

    /// Adds the axis: a light of this strength has no component across it, within the axis' uncertainty.
    fn along(mut self, axis: Axis) -> Self {
        let [x, y] = direction(axis.azimuth_deg);
        let (strength, variance) = self.strength([x, y]);
        let sd = axis.sd_deg.to_radians();
        let weight = 1.0 / ((strength * strength + variance) * sd * sd);
        if weight.is_finite() {
            let across = [y * y, -x * y, x * x];
            self.precision.iter_mut().zip(across).for_each(|(sum, v)| *sum += weight * v);
        }
        self
    }
}

/// A rectangle that is added to a fit, one column of squares of cells after another.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FitPart<'a, S> {
    pub(crate) image: S,
    pub(crate) coarse_m: &'a [f32],
    pub(crate) cols: usize,
    pub(crate) pixel: PixelSize,
    pub(crate) cell_px: usize,
}

impl<S: Samples> FitPart<'_, S> {
    /// Returns the places of cells down and across; `None` if none fits.
    fn places(&self) -> Option<[Places; 2]> {
        let rows = self.coarse_m.len().checked_div(self.cols).unwrap_or(0);
        let places = [Places::of(rows, self.cell_px)?, Places::of(self.cols, self.cell_px)?];
        (self.coarse_m.len() == self.image.len()).then_some(places)
    }

    /// Number of columns of squares.
    pub(crate) fn columns(&self) -> usize {
        self.places().map_or(0, |[_, across]| across.count(2))
    }

    /// Adds the squares that begin in a column.
    pub(crate) fn add_to(&self, fit: &mut LightFit, brightness: &Brightness, column: usize) {
        self.add_columns::<COLUMNS, 1>(fit, brightness, column, 1);
    }

    /// Adds all squares, of many columns together: each pixel is read about once, not ten times, with 29 KB of stack. The sums are the same.
    fn add_all(&self, fit: &mut LightFit, brightness: &Brightness) {
        let (columns, together) = (self.columns(), COLUMNS_TOGETHER - (COLUMNS - 1) * PHASES);
        for first in (0..columns).step_by(together) {
            self.add_columns::<COLUMNS_TOGETHER, PHASES>(fit, brightness, first, together.min(columns - first));
        }
    }

    /// Adds the squares that begin in some columns from `first` on. `APART` is as for [`CellColumns`].
    fn add_columns<const WIDE: usize, const APART: usize>(
        &self,
        fit: &mut LightFit,
        brightness: &Brightness,
        first: usize,
        columns: usize,
    ) {
        let Some([down, across]) = self.places() else { return };
        let Self { image, coarse_m, cols, pixel, cell_px } = *self;
        let maps = Rectangle { image, coarse_m, cols, pixel, half: cell_px / 2, dark_below: brightness.dark_below() };
        let weights = [2, 4].map(|cells| down.share(cells) * across.share(cells));
        // At the right edge there are fewer cells than the widest square has.
        let there = across.count(1).saturating_sub(first).div_ceil(PHASES / APART);
        let wide = (columns + (COLUMNS - 1) * APART).min(there);
        // Behind the last there are none. In flight a flipped bit may ask for them.
        if wide == 0 {
            return;
        }
        let mut parts = [LightFit::default(); WIDE];
        let parts = head_mut(&mut parts, columns);
        let cells = CellColumns::<S, WIDE, APART>::new(&maps, &down, across.at(first), wide);
        add_rows(parts, cells, f64::from(brightness.lit_mean()), weights);
        parts.iter().for_each(|part| fit.add_fit(part, 1.0));
    }
}

/// Adds the squares that begin in some columns, from top to bottom: those of two by two cells, and those of four by four. Each column has its own fit.
fn add_rows<S: Samples, const WIDE: usize, const APART: usize>(
    columns: &mut [LightFit],
    cells: CellColumns<'_, S, WIDE, APART>,
    lit_mean: f64,
    [of_fine, of_long]: [f64; OCTAVES],
) {
    // Rows begin at every half cell. Cells of a square are two rows apart, and its halves four.
    let (mut rows, mut means) = ([[None; WIDE]; 3], [[None; WIDE]; 5]);
    let square = |[a, b]: [Option<Cell>; 2], [c, d]: [Option<Cell>; 2]| Some([a?, b?, c?, d?]);
    let pair = |row: &[Option<Cell>; WIDE], at: usize, apart: usize| [at, at + apart].map(|i| item(row, i));
    for row in cells {
        rows.rotate_left(1);
        means.rotate_left(1);
        let ([above, .., newest], [higher, .., lower]) = (&mut rows, &mut means);
        *newest = row;
        // The right half of the last square begins two cells after it.
        for (i, mean) in lower.iter_mut().enumerate().take(columns.len() + 2 * APART) {
            let found = square(pair(above, i, APART), pair(newest, i, APART));
            *mean = found.as_ref().map(mean_of);
            if let (Some(cells), Some(fit)) = (&found, columns.get_mut(i)) {
                fit.cells += 4.0 * of_fine;
                fit.brightness += 4.0 * of_fine * lit_mean;
                let [fine, _] = &mut fit.octaves;
                fine.add(cells, of_fine);
            }
        }
        for (i, fit) in columns.iter_mut().enumerate() {
            if let Some(cells) = square(pair(higher, i, 2 * APART), pair(lower, i, 2 * APART)) {
                let [_, long] = &mut fit.octaves;
                long.add(&cells, of_long);
            }
        }
    }
}

/// Returns the square x' C x of a symmetric matrix (xx, xy, yy).
fn square([xx, xy, yy]: [f64; 3], [x, y]: [f64; 2]) -> f64 {
    xx * x * x + 2.0 * xy * x * y + yy * y * y
}

/// Returns the unit vector that a light from this azimuth has.
fn direction(azimuth_deg: f64) -> [f64; 2] {
    [-libm::sin(azimuth_deg.to_radians()), libm::cos(azimuth_deg.to_radians())]
}

impl LightFit {
    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        words.f64(&mut self.cells);
        words.f64(&mut self.brightness);
        for Octave { freedom, products } in &mut self.octaves {
            words.f64(freedom);
            products.iter_mut().for_each(|v| words.f64(v));
        }
        words.option(&mut self.axis, Axis { azimuth_deg: 0.0, sd_deg: 0.0 }, |axis, words| {
            words.f64(&mut axis.azimuth_deg);
            words.f64(&mut axis.sd_deg);
        });
    }

    /// Makes the fit to one tile: `image` (brightness in any unit) and `coarse_m` (metres), row-major, `cols` wide, at valid pixels
    /// ([`crate::mask`]). `pixel_m` is the ground size of a pixel, `coarse_px` the side of a coarse pixel in pixels of the image.
    #[must_use]
    pub fn of_tile(image: impl Samples, coarse_m: &[f32], cols: usize, pixel_m: f64, coarse_px: f32) -> Self {
        let mut fit = Self::default();
        fit.add(image, coarse_m, cols, PixelSize::square(pixel_m), Self::cell_px(coarse_px));
        fit
    }

    /// Returns the side of a cell, pixels, for a coarse DTM whose pixels are `coarse_px` pixels of the image wide: as wide, but even.
    #[must_use]
    pub fn cell_px(coarse_px: f32) -> usize {
        // `as` turns NaN and negative numbers into 0.
        2 * ((0.5 * coarse_px + 0.5) as usize).clamp(2, 128)
    }

    /// Adds a rectangle: `image` (brightness in any unit) and `coarse_m` (metres), row-major, `cols` wide. Left out are cells with a void
    /// ([`crate::mask`]) or in shadow (a pixel is dark below a tenth of the rectangle's mean brightness), and less than half a cell at the edges.
    /// Does nothing if the maps differ in length.
    pub fn add(&mut self, image: impl Samples, coarse_m: &[f32], cols: usize, pixel: PixelSize, cell_px: usize) {
        let brightness = Brightness::of(image);
        let part = FitPart { image, coarse_m, cols, pixel, cell_px };
        part.add_all(self, &brightness);
    }

    /// Adds the fit of another part of the scene, with a weight from 0 to 1. The axis stays.
    pub fn add_fit(&mut self, other: &Self, weight: f64) {
        self.cells += weight * other.cells;
        self.brightness += weight * other.brightness;
        for (sum, octave) in self.octaves.iter_mut().zip(&other.octaves) {
            sum.freedom += weight * octave.freedom;
            sum.products.iter_mut().zip(octave.products).for_each(|(sum, v)| *sum += weight * v);
        }
    }

    /// Returns how far a light is from the fitted one, in units of the fit's uncertainty: chi squared with two degrees of freedom. `spread`
    /// is what two parts under one Sun differ by beyond their noise, as a share of the light's strength. `None` without light or variation.
    #[must_use]
    pub fn chi_squared(&self, light: Light, spread: f64) -> Option<f64> {
        let known = self.information()?;
        let (fitted, [xx, xy, yy]) = self.axis.map_or(known, |axis| known.along(axis)).solve()?;
        let (east, south) = (f64::from(light.east), f64::from(light.south));
        let more = spread * spread * (east * east + south * south);
        let covariance =
            Information { precision: [xx + more, xy, yy + more], vector: [east - fitted[0], south - fitted[1]] };
        let (solved, _) = covariance.solve()?;
        Some(solved[0] * covariance.vector[0] + solved[1] * covariance.vector[1])
    }

    /// States the axis that the image shows; without it the azimuth is that of the regression alone.
    #[must_use]
    pub fn with_axis(self, axis: Option<Axis>) -> Self {
        Self { axis, ..self }
    }

    /// Returns what all octaves know of the light; `None` without light or variation.
    fn information(&self) -> Option<Information> {
        let mean = self.brightness / self.cells;
        if !(mean > 0.0 && mean.is_finite()) {
            return None;
        }
        let mut sum = Information { precision: [0.0; 3], vector: [0.0; 2] };
        for octave in self.octaves.iter().filter(|octave| octave.freedom >= FREEDOM_MIN) {
            let [ii, ix, iy, xx, xy, yy] = octave.products;
            let (ii, vector) = (ii / (mean * mean), [ix / mean, iy / mean]);
            let products = Information { precision: [xx, xy, yy], vector };
            let Some((light, _)) = products.solve() else { continue };
            let explained = light[0] * vector[0] + light[1] * vector[1];
            let variance = (ii - explained).max(UNEXPLAINED_MIN * ii) / (octave.freedom - 2.0);
            let weight = 1.0 / (VARIANCE_FACTOR * variance);
            if weight.is_finite() {
                let relief = Relief::of([ii, vector[0], vector[1], xx, xy, yy]);
                sum.precision.iter_mut().zip(relief.precision).for_each(|(sum, v)| *sum += weight * v);
                sum.vector.iter_mut().zip(relief.vector).for_each(|(sum, v)| *sum += weight * v);
            }
        }
        (sum.precision[0] > 0.0).then_some(sum)
    }

    /// Returns the square of the strength that a light from a direction would have if it explained all of the contrast; `None` without slopes
    /// along it, or without contrast.
    fn whole_contrast(&self, along: [f64; 2]) -> Option<f64> {
        let mean = self.brightness / self.cells;
        let (mut sum, mut freedom) = (0.0, 0.0);
        for octave in self.octaves.iter().filter(|octave| octave.freedom >= FREEDOM_MIN) {
            let ratio = octave.products[0] / (mean * mean) / square(Relief::of(octave.products).slopes, along);
            if ratio > 0.0 && ratio.is_finite() {
                sum += octave.freedom * libm::log(ratio);
                freedom += octave.freedom;
            }
        }
        (freedom > 0.0).then(|| libm::exp(sum / freedom))
    }

    /// Returns the light, with its uncertainty, from the known angles of the Sun (azimuth clockwise from up, elevation, degrees). Unknown
    /// angles are fitted. The strength joins the fitted one and the one that the elevation implies, by their uncertainty. For a Sun of unknown elevation,
    /// a strength of 1.8 is expected, with a wide spread. For a known azimuth the strength that the image's contrast implies counts as
    /// well, if an [`Axis`] is stated: where the fit is unsure, a wrong one would make the relief of the whole scene too high.
    ///
    /// `None` if the light is unknown: an angle is not one of a Sun above the horizon; or azimuth or strength must be fitted, and brightness
    /// does not depend on slope; or the azimuth must be, and brightness falls towards the Sun.
    #[must_use]
    pub fn estimate(&self, azimuth_deg: Option<f64>, elevation_deg: Option<f64>) -> Option<LightEstimate> {
        let told = match elevation_deg {
            Some(elevation) => Some(f64::from(Light::from_sun(azimuth_deg.unwrap_or(0.0), elevation)?.strength())),
            None => None,
        };
        let (strength, spread) = told.map_or((EXPECTED_STRENGTH, EXPECTED_SPREAD), |strength| (strength, TOLD_SPREAD));
        let expected = Expected::new(strength, spread);
        match (azimuth_deg, self.information()) {
            (Some(azimuth), None) if told.is_some() => self.certain(azimuth, Strength::new(expected, None)),
            (Some(azimuth), Some(known)) => self.told(azimuth, &known, expected),
            (None, Some(known)) => self.found(&known, expected),
            (_, None) => None,
        }
    }

    /// Returns the light of an unknown azimuth.
    fn found(&self, known: &Information, expected: Expected) -> Option<LightEstimate> {
        let (light, covariance) = self.axis.map_or(*known, |axis| known.along(axis)).solve()?;
        let strength = libm::hypot(light[0], light[1]);
        let along = [light[0] / strength, light[1] / strength];
        let across = square(covariance, [-along[1], along[0]]);
        let variance = square(covariance, along);
        let azimuth_sd = libm::sqrt(across) / strength;
        let sign = libm::erf(strength / libm::sqrt(2.0 * variance));
        let azimuth = libm::atan2(-along[0], along[1]).to_degrees();
        // The formal variance of the strength (our choice): with the larger one weak lights are drawn too far to the expected strength.
        let joined = Strength::new(expected, Some((strength, variance / VARIANCE_FACTOR)));
        Some(LightEstimate {
            azimuth_sd_deg: azimuth_sd.to_degrees().min(180.0) as f32,
            trust: (sign * sign / (1.0 + azimuth_sd * azimuth_sd)) as f32,
            related: known.related(self.axis) as f32,
            ..self.certain(azimuth, joined)?
        })
    }

    /// Returns the light of a known azimuth.
    fn told(&self, azimuth_deg: f64, known: &Information, expected: Expected) -> Option<LightEstimate> {
        let along = direction(azimuth_deg);
        let implied = self.axis.zip(self.whole_contrast(along)).map(|(axis, whole)| {
            let strength = libm::sqrt(axis.share(azimuth_deg) * whole);
            Expected::new(strength.clamp(STRENGTH_MIN, STRENGTH_MAX), SHARE_SPREAD)
        });
        let expected = implied.map_or(expected, |implied| expected.and(implied));
        let (strength, variance) = known.strength(along);
        self.certain(azimuth_deg, Strength::new(expected, Some((strength, variance / VARIANCE_FACTOR))))
    }

    /// Returns a light of this azimuth and strength.
    fn certain(&self, azimuth_deg: f64, strength: Strength) -> Option<LightEstimate> {
        let light = Light::of(azimuth_deg, libm::exp(strength.log).clamp(STRENGTH_MIN, STRENGTH_MAX))?;
        let explained = |whole: f64| (libm::exp(2.0 * strength.log) / (whole * DIRECTED_RELIEF)).min(1.0) as f32;
        Some(LightEstimate {
            light,
            log_strength_sd: strength.spread as f32,
            azimuth_sd_deg: 0.0,
            trust: 1.0,
            related: strength.probability(RELATED_TOLD) as f32,
            long_share: self.whole_contrast(direction(azimuth_deg)).map(explained),
        })
    }
}

#[cfg(test)]
mod tests;
