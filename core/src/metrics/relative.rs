//! Relative errors on normalised elevations in [0, NR] (some of Eq. 11–17), for validation.

use super::{each_pair, mean};
use crate::error::LengthError;
use crate::loss::PAD_EPS;

/// Accumulates REL, RMSE, log10, threshold shares and PSNR.
///
/// The lowest pixel of every tile is 0, where a ratio has no meaning. Therefore REL, log10 and the thresholds count only pixels whose truth
/// exceeds [`PAD_EPS`], and the prediction is raised to [`PAD_EPS`] before logarithm and ratio (our choice).
///
/// ```
/// use elunar_core::metrics::RelativeErrors;
/// let mut errors = RelativeErrors::default();
/// errors.extend(&[0.0, 10.0, 20.0], &[1.0, 11.0, 30.0], None)?;
/// assert_eq!(errors.rel(), Some(0.3));
/// assert_eq!(errors.share_within_ratio(), Some([0.5, 1.0, 1.0]));
/// # Ok::<(), elunar_core::error::LengthError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelativeErrors {
    count: u64,
    square: f64,
    peak: f64,
    positive: u64,
    relative: f64,
    log10: f64,
    within: [u64; 3],
}

impl Default for RelativeErrors {
    fn default() -> Self {
        Self { count: 0, square: 0.0, peak: f64::NEG_INFINITY, positive: 0, relative: 0.0, log10: 0.0, within: [0; 3] }
    }
}

impl RelativeErrors {
    /// Adds one pixel; normalised elevations.
    pub fn push(&mut self, truth: f64, predicted: f64) {
        self.count += 1;
        self.square += (truth - predicted) * (truth - predicted);
        self.peak = self.peak.max(predicted);
        if truth <= PAD_EPS {
            return;
        }
        self.positive += 1;
        self.relative += (truth - predicted).abs() / truth;
        let raised = predicted.max(PAD_EPS);
        self.log10 += (libm::log10(truth) - libm::log10(raised)).abs();
        let ratio = (truth / raised).max(raised / truth);
        let mut limit = 1.0;
        for within in &mut self.within {
            limit *= 1.25;
            *within += u64::from(ratio < limit);
        }
    }

    /// Adds every pixel that is real in both grids and not masked.
    ///
    /// # Errors
    /// [`LengthError`] if the lengths differ.
    pub fn extend(&mut self, truth: &[f32], predicted: &[f32], valid: Option<&[bool]>) -> Result<(), LengthError> {
        each_pair(truth, predicted, valid, |t, p| self.push(t, p))
    }

    /// Adds the pixels of another accumulator.
    pub fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.square += other.square;
        self.peak = self.peak.max(other.peak);
        self.positive += other.positive;
        self.relative += other.relative;
        self.log10 += other.log10;
        for (a, b) in self.within.iter_mut().zip(other.within) {
            *a += b;
        }
    }

    /// Number of pixels.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the mean of |z − z*| / z (REL). Here and below, `None` before the first pixel that counts.
    pub fn rel(&self) -> Option<f64> {
        mean(self.relative, self.positive)
    }

    /// Returns the root mean square error, normalised units.
    pub fn rmse(&self) -> Option<f64> {
        mean(self.square, self.count).map(libm::sqrt)
    }

    /// Returns the mean of |log10 z − log10 z*|.
    pub fn log10(&self) -> Option<f64> {
        mean(self.log10, self.positive)
    }

    /// Returns the shares, in [0, 1], of max(z/z*, z*/z) below 1.25, 1.25², 1.25³ (a1 to a3).
    pub fn share_within_ratio(&self) -> Option<[f64; 3]> {
        if self.positive == 0 { None } else { Some(self.within.map(|n| n as f64 / self.positive as f64)) }
    }

    /// Returns the peak signal-to-noise ratio in dB, 10 log10(max(z*)² / MSE) with the prediction's maximum; infinite without error.
    pub fn psnr_db(&self) -> Option<f64> {
        mean(self.square, self.count).map(|mse| 10.0 * libm::log10(self.peak * self.peak / mse))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn tiles_without_positive_truth_have_rmse_but_no_ratios() {
        let mut errors = RelativeErrors::default();
        assert_eq!((errors.rmse(), errors.psnr_db()), (None, None));
        errors.push(0.0, 2.0);
        errors.push(PAD_EPS, 2.0);
        assert_eq!(errors.count(), 2);
        assert!(errors.rmse().unwrap() > 1.99);
        assert_eq!((errors.rel(), errors.log10(), errors.share_within_ratio()), (None, None, None));
    }

    #[test]
    fn negative_predictions_are_raised_before_the_logarithm() {
        let mut errors = RelativeErrors::default();
        errors.push(1.0, -5.0);
        assert_eq!(errors.rel(), Some(6.0));
        assert_eq!(errors.log10(), Some(3.0));
        assert_eq!(errors.share_within_ratio(), Some([0.0; 3]));
    }

    /// Computes the definitions, one array expression per line, over pixels kept in memory.
    fn naive(truth: &[f64], pred: &[f64]) -> [f64; 7] {
        let mean = |v: Vec<f64>| v.iter().sum::<f64>() / v.len() as f64;
        let pairs: Vec<(f64, f64)> = truth.iter().copied().zip(pred.iter().copied()).collect();
        let kept: Vec<(f64, f64)> = pairs.iter().copied().filter(|(t, _)| *t > 1e-3).collect();
        let mse = mean(pairs.iter().map(|(t, p)| (t - p).powi(2)).collect());
        let share = |j: i32| {
            mean(
                kept.iter().map(|(t, p)| f64::from((t / p.max(1e-3)).max(p.max(1e-3) / t) < 1.25f64.powi(j))).collect(),
            )
        };
        [
            mean(kept.iter().map(|(t, p)| (t - p).abs() / t).collect()),
            mse.sqrt(),
            mean(kept.iter().map(|(t, p)| (t.log10() - p.max(1e-3).log10()).abs()).collect()),
            share(1),
            share(2),
            share(3),
            10.0 * (pred.iter().copied().fold(f64::MIN, f64::max).powi(2) / mse).log10(),
        ]
    }

    proptest! {
        #[test]
        fn matches_the_definitions_and_merging_is_counting(
            pairs in proptest::collection::vec((0f32..50.0, -2f32..52.0), 2..60), cut in 0usize..60,
        ) {
            let truth: Vec<f32> = pairs.iter().map(|p| p.0).collect();
            let pred: Vec<f32> = pairs.iter().map(|p| p.1).collect();
            prop_assume!(truth.iter().any(|t| *t > 1e-3));
            let wide = |v: &[f32]| v.iter().map(|v| f64::from(*v)).collect::<Vec<f64>>();
            let expected = naive(&wide(&truth), &wide(&pred));
            let cut = cut.min(truth.len());
            let (mut errors, mut rest) = (RelativeErrors::default(), RelativeErrors::default());
            errors.extend(&truth[..cut], &pred[..cut], None).unwrap();
            rest.extend(&truth[cut..], &pred[cut..], None).unwrap();
            errors.merge(&rest);
            let [a1, a2, a3] = errors.share_within_ratio().unwrap();
            let found = [errors.rel(), errors.rmse(), errors.log10(), Some(a1), Some(a2), Some(a3), errors.psnr_db()];
            for (f, e) in found.iter().zip(expected) {
                prop_assert!((f.unwrap() - e).abs() <= 1e-12 * (1.0 + e.abs()), "{found:?} instead of {expected:?}");
            }
        }
    }
}
