//! Pearson's correlation coefficient of two maps.

use super::each_pair;
use crate::error::LengthError;

/// Accumulates means, variances and covariance of pairs, in one pass and without cancellation (Welford; merging after Chan et al.).
///
/// ```
/// use elunar_core::metrics::Correlation;
/// let mut found = Correlation::default();
/// found.extend(&[1.0, 2.0, 3.0], &[10.0, 20.0, 30.0], None)?;
/// assert!(found.coefficient().is_some_and(|r| r > 0.999_999));
/// # Ok::<(), elunar_core::error::LengthError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Correlation {
    count: u64,
    mean: [f64; 2],
    /// Sums of squared deviations of each map; `product` is the sum of the products of deviations.
    square: [f64; 2],
    product: f64,
}

impl Correlation {
    /// Adds one pair.
    pub fn push(&mut self, a: f64, b: f64) {
        self.count += 1;
        let n = self.count as f64;
        let before = [a - self.mean[0], b - self.mean[1]];
        self.mean[0] += before[0] / n;
        self.mean[1] += before[1] / n;
        let after = [a - self.mean[0], b - self.mean[1]];
        self.square[0] += before[0] * after[0];
        self.square[1] += before[1] * after[1];
        self.product += before[0] * after[1];
    }

    /// Adds every pixel that is real in both maps and not masked.
    ///
    /// # Errors
    /// [`LengthError`] if the lengths differ.
    pub fn extend(&mut self, a: &[f32], b: &[f32], valid: Option<&[bool]>) -> Result<(), LengthError> {
        each_pair(a, b, valid, |a, b| self.push(a, b))
    }

    /// Adds the pairs of another accumulator.
    pub fn merge(&mut self, other: &Self) {
        if other.count == 0 {
            return;
        }
        let (n, m) = (self.count as f64, other.count as f64);
        let apart = [other.mean[0] - self.mean[0], other.mean[1] - self.mean[1]];
        let share = n * m / (n + m);
        for (k, apart) in apart.iter().enumerate() {
            self.square[k] += other.square[k] + apart * apart * share;
            self.mean[k] += apart * m / (n + m);
        }
        self.product += other.product + apart[0] * apart[1] * share;
        self.count += other.count;
    }

    /// Number of pairs.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns Pearson's coefficient, [-1, 1]; `None` if a map is constant.
    pub fn coefficient(&self) -> Option<f64> {
        let length = libm::sqrt(self.square[0]) * libm::sqrt(self.square[1]);
        if length > 0.0 { Some((self.product / length).clamp(-1.0, 1.0)) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn constant_maps_have_no_correlation() {
        let mut found = Correlation::default();
        assert_eq!(found.coefficient(), None);
        found.extend(&[5.0; 4], &[1.0, 2.0, 3.0, f32::NAN], None).unwrap();
        assert_eq!((found.count(), found.coefficient()), (3, None));
        assert!(found.extend(&[1.0], &[], None).is_err());
    }

    proptest! {
        #[test]
        fn matches_the_definition_far_from_zero_and_merging_is_counting(
            pairs in proptest::collection::vec((-30f32..30.0, -30f32..30.0), 3..60), cut in 0usize..60,
        ) {
            // Heights far from zero, where the textbook sum of squares would lose its digits.
            let a: Vec<f32> = pairs.iter().map(|p| p.0 - 2000.0).collect();
            let b: Vec<f32> = pairs.iter().map(|p| p.1 * 0.5 + p.0 + 9000.0).collect();
            let wide = |v: &[f32]| v.iter().map(|v| f64::from(*v)).collect::<Vec<f64>>();
            let (x, y) = (wide(&a), wide(&b));
            let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
            let (mx, my) = (mean(&x), mean(&y));
            let dot = |u: &[f64], mu: f64, v: &[f64], mv: f64| u.iter().zip(v).map(|(u, v)| (u - mu) * (v - mv)).sum::<f64>();
            let expected = dot(&x, mx, &y, my) / (dot(&x, mx, &x, mx) * dot(&y, my, &y, my)).sqrt();
            prop_assume!(expected.is_finite());
            let cut = cut.min(a.len());
            let (mut first, mut rest, mut whole) = (Correlation::default(), Correlation::default(), Correlation::default());
            whole.extend(&a, &b, None).unwrap();
            first.extend(&a[..cut], &b[..cut], None).unwrap();
            rest.extend(&a[cut..], &b[cut..], None).unwrap();
            first.merge(&rest);
            for found in [whole, first] {
                prop_assert_eq!(found.count(), a.len() as u64);
                prop_assert!((found.coefficient().unwrap() - expected).abs() < 1e-9);
            }
        }
    }
}
