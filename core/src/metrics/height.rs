//! Height errors in metres (some of Eq. 11–18, and the shares of the paper's tests).

use super::{each_pair, mean};
use crate::error::LengthError;

/// Limits, in metres, of [`HeightErrors::share_within`] (the paper's).
pub const LIMITS_M: [f64; 3] = [2.0, 4.0, 10.0];

/// Accumulates errors e = predicted − truth.
///
/// ```
/// use elunar_core::metrics::HeightErrors;
/// let mut errors = HeightErrors::default();
/// errors.extend(&[0.0, 10.0], &[3.0, 9.0], None)?;
/// assert_eq!(errors.mae_m(), Some(2.0));
/// assert_eq!(errors.rmse_m(), Some(5.0f64.sqrt()));
/// assert_eq!(errors.share_within(), Some([0.5, 1.0, 1.0]));
/// # Ok::<(), elunar_core::error::LengthError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HeightErrors {
    count: u64,
    sum: f64,
    absolute: f64,
    square: f64,
    largest: f64,
    within: [u64; 3],
}

impl HeightErrors {
    /// Adds one pixel; heights in metres.
    pub fn push(&mut self, truth_m: f64, predicted_m: f64) {
        let error = predicted_m - truth_m;
        self.count += 1;
        self.sum += error;
        self.absolute += error.abs();
        self.square += error * error;
        self.largest = self.largest.max(error.abs());
        for (within, limit_m) in self.within.iter_mut().zip(LIMITS_M) {
            *within += u64::from(error.abs() < limit_m);
        }
    }

    /// Adds every pixel that is real in both grids and not masked.
    ///
    /// # Errors
    /// [`LengthError`] if the lengths differ.
    pub fn extend(&mut self, truth_m: &[f32], predicted_m: &[f32], valid: Option<&[bool]>) -> Result<(), LengthError> {
        each_pair(truth_m, predicted_m, valid, |t, p| self.push(t, p))
    }

    /// Adds the pixels of another accumulator.
    pub fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.absolute += other.absolute;
        self.square += other.square;
        self.largest = self.largest.max(other.largest);
        for (a, b) in self.within.iter_mut().zip(other.within) {
            *a += b;
        }
    }

    /// Number of pixels.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the mean error (bias), metres. Here and below, `None` without pixels.
    pub fn bias_m(&self) -> Option<f64> {
        mean(self.sum, self.count)
    }

    /// Returns the mean absolute error, metres.
    pub fn mae_m(&self) -> Option<f64> {
        mean(self.absolute, self.count)
    }

    /// Returns the root mean square error, metres.
    pub fn rmse_m(&self) -> Option<f64> {
        mean(self.square, self.count).map(libm::sqrt)
    }

    /// Returns the largest absolute error, metres.
    pub fn max_m(&self) -> Option<f64> {
        if self.count == 0 { None } else { Some(self.largest) }
    }

    /// Returns the deviation from altimeter points (Eq. 18): √(Σe² / (r − 1)), without removal of a mean; `None` below two points.
    pub fn std_m(&self) -> Option<f64> {
        mean(self.square, self.count.saturating_sub(1)).map(libm::sqrt)
    }

    /// Returns the shares, in [0, 1], of |e| below each of [`LIMITS_M`].
    pub fn share_within(&self) -> Option<[f64; 3]> {
        if self.count == 0 { None } else { Some(self.within.map(|n| n as f64 / self.count as f64)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn nothing_counted_has_no_metric() {
        let mut errors = HeightErrors::default();
        errors.extend(&[1.0, f32::NAN, 3.0], &[f32::NAN, 1.0, 2.0], Some(&[true, true, false])).unwrap();
        assert_eq!(errors.count(), 0);
        assert_eq!((errors.mae_m(), errors.rmse_m(), errors.std_m()), (None, None, None));
        assert_eq!((errors.bias_m(), errors.max_m(), errors.share_within()), (None, None, None));
        assert!(errors.extend(&[1.0], &[], None).is_err());
        assert!(errors.extend(&[1.0], &[1.0], Some(&[])).is_err());
    }

    #[test]
    fn limits_are_exclusive_and_the_deviation_divides_by_one_less() {
        let mut errors = HeightErrors::default();
        for error in [2.0, -4.0, 10.0, 0.0] {
            errors.push(100.0, 100.0 + error);
        }
        assert_eq!(errors.share_within(), Some([0.25, 0.5, 0.75]));
        assert_eq!(errors.std_m(), Some((120.0f64 / 3.0).sqrt()));
        assert_eq!((errors.bias_m(), errors.max_m()), (Some(2.0), Some(10.0)));
    }

    proptest! {
        #[test]
        fn matches_the_definitions_and_merging_is_counting(
            pairs in proptest::collection::vec((-9e3f32..9e3, -30f32..30.0), 1..60), cut in 0usize..60,
        ) {
            let truth: Vec<f32> = pairs.iter().map(|p| p.0).collect();
            let pred: Vec<f32> = pairs.iter().map(|p| p.0 + p.1).collect();
            let e: Vec<f64> = truth.iter().zip(&pred).map(|(t, p)| f64::from(*p) - f64::from(*t)).collect();
            let n = e.len() as f64;
            let cut = cut.min(e.len());
            let (mut whole, mut first, mut rest) = Default::default();
            HeightErrors::extend(&mut whole, &truth, &pred, None).unwrap();
            HeightErrors::extend(&mut first, &truth[..cut], &pred[..cut], None).unwrap();
            HeightErrors::extend(&mut rest, &truth[cut..], &pred[cut..], None).unwrap();
            first.merge(&rest);
            for errors in [whole, first] {
                let close = |a: Option<f64>, b: f64| (a.unwrap() - b).abs() <= 1e-12 * (1.0 + b.abs());
                prop_assert!(close(errors.mae_m(), e.iter().map(|e| e.abs()).sum::<f64>() / n));
                prop_assert!(close(errors.rmse_m(), (e.iter().map(|e| e * e).sum::<f64>() / n).sqrt()));
                prop_assert!(close(errors.bias_m(), e.iter().sum::<f64>() / n));
                let within = |limit: f64| e.iter().filter(|e| e.abs() < limit).count() as f64 / n;
                prop_assert_eq!(errors.share_within(), Some([within(2.0), within(4.0), within(10.0)]));
            }
        }
    }
}
