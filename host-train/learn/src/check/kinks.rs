//! Kinks of the loss. At a kink, the argument of an absolute value is zero except for rounding, and any derivative between the two slopes
//! is valid.
//!
//! `f32` and `f64` arithmetic may then give different signs. The bounds hold for any order of summation. The error of a sum of n products
//! is at most n u times the sum of their magnitudes, where u = 2⁻²⁴ is the unit roundoff of `f32`.

use crate::train::loss::LossWeights;
use elunar_core::loss::PAD_EPS;
use elunar_core::tile::Shape;

/// Unit roundoff of `f32`.
const U: f64 = f32::EPSILON as f64 / 2.0;
/// Number of roundings in a difference of two Sobel derivatives: six products and additions each, the division by 8, the difference.
const SOBEL_ROUNDINGS: f64 = 8.0;
/// Number of roundings in z / z̄ − z* / z̄* in addition to those of the means: the offset, divisions, the difference.
const RATIO_ROUNDINGS: f64 = 8.0;

/// The kinks of the hybrid loss (Eq. 5–7) at one prediction.
#[derive(Debug, Clone, PartialEq)]
pub struct Kinks {
    /// Number of absolute values whose argument is zero except for rounding.
    pub count: usize,
    /// Number of all absolute values: three in every pixel.
    pub of: usize,
    /// Greatest difference of two valid derivatives in each pixel of the prediction, without [`Self::offset`].
    pub slack: Vec<f64>,
    /// Greatest difference of two valid gradients that is the same in all pixels. It comes from the prediction's mean.
    pub offset: f64,
}

impl Kinks {
    /// Finds the kinks of `weights` at `prediction`, with the mean-normalised elevation term; both maps row-major `[rows, cols]`.
    pub fn find(truth: &[f32], prediction: &[f32], shape: Shape, weights: &LossWeights) -> Self {
        let mut kinks = Self { count: 0, of: 3 * prediction.len(), slack: vec![0.0; prediction.len()], offset: 0.0 };
        kinks.add_elevation(truth, prediction, shape, f64::from(weights.elevation));
        for across in [true, false] {
            kinks.add_sobel(truth, prediction, shape, across, f64::from(weights.gradient));
        }
        kinks
    }

    /// Adds |z / z̄ − z* / z̄*|. Its derivative affects its own pixel and, through the mean, every pixel.
    fn add_elevation(&mut self, truth: &[f32], prediction: &[f32], Shape { rows, cols }: Shape, weight: f64) {
        let len = prediction.len() as f64;
        let mean = |z: &[f32]| z.iter().map(|v| f64::from(*v)).sum::<f64>() / len + PAD_EPS;
        let magnitude = |z: &[f32]| z.iter().map(|v| f64::from(v.abs())).sum::<f64>() / len;
        let (true_mean, mean) = (mean(truth), mean(prediction));
        // The means are sums over a row, then over a column. The error is in units of the mean.
        let roundings = |z: &[f32], mean: f64| (rows + cols) as f64 * magnitude(z) / mean.abs() + RATIO_ROUNDINGS;
        let (true_roundings, roundings) = (roundings(truth, true_mean), roundings(prediction, mean));
        for (i, (t, p)) in truth.iter().zip(prediction).enumerate() {
            let (t, p) = (f64::from(*t) / true_mean, f64::from(*p) / mean);
            if (t - p).abs() <= U * (true_roundings * t.abs() + roundings * p.abs()) {
                self.count += 1;
                self.slack[i] += 2.0 * weight / len / mean.abs();
                self.offset += 2.0 * weight / len * p.abs() / mean.abs() / len;
            }
        }
    }

    /// Returns the greatest difference between two gradients of the loss, beyond the kinks' bounds; infinity if they differ in length or
    /// hold a NaN.
    pub fn difference(&self, one: &[f32], other: &[f32]) -> f64 {
        let differences: Vec<f64> = one.iter().zip(other).map(|(a, b)| f64::from(a - b)).collect();
        if one.len() != other.len() || differences.len() != self.slack.len() || differences.iter().any(|d| d.is_nan()) {
            return f64::INFINITY;
        }
        // Nearly all pixels have no kink of their own. Their common difference is the median.
        let mut sorted = differences.clone();
        sorted.sort_by(f64::total_cmp);
        let common = sorted.get(sorted.len() / 2).map_or(0.0, |median| median.clamp(-self.offset, self.offset));
        let beyond = differences.iter().zip(&self.slack).map(|(d, slack)| (d - common).abs() - slack);
        beyond.fold(0.0, f64::max)
    }

    /// Adds |∂(z − z*)| along columns (`across`) or rows. Its derivative affects the neighbours.
    fn add_sobel(&mut self, truth: &[f32], prediction: &[f32], shape: Shape, across: bool, weight: f64) {
        let len = prediction.len();
        for at in 0..len {
            let (mut argument, mut magnitude) = (0.0, 0.0);
            for (i, tap) in neighbours(at, shape, across) {
                let (t, p) = (f64::from(truth[i]), f64::from(prediction[i]));
                argument += tap * (t - p);
                magnitude += tap.abs() * (t.abs() + p.abs());
            }
            if argument.abs() <= U * SOBEL_ROUNDINGS * magnitude {
                self.count += 1;
                for (i, tap) in neighbours(at, shape, across) {
                    self.slack[i] += 2.0 * weight / len as f64 * tap.abs();
                }
            }
        }
    }
}

/// Returns the pixels and factors that a Sobel derivative (over 8, the border replicated) at pixel `at` reads.
fn neighbours(at: usize, Shape { rows, cols }: Shape, across: bool) -> impl Iterator<Item = (usize, f64)> {
    let inside = |i: usize, step: usize, len: usize| (i + step).saturating_sub(1).min(len - 1);
    (0..3).flat_map(move |along| [(0, -1.0), (2, 1.0)].map(|(side, sign)| (along, side, sign))).map(
        move |(along, side, sign)| {
            let (down, right) = if across { (along, side) } else { (side, along) };
            let place = inside(at / cols, down, rows) * cols + inside(at % cols, right, cols);
            (place, sign * if along == 1 { 0.25 } else { 0.125 })
        },
    )
}
