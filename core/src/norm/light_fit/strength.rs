//! The strength of a light of one direction: what is expected of it, and what the fit says.
//!
//! The expectation is a normal distribution of the logarithm, since strengths are factors. The fit is a normal distribution of the strength
//! itself, which may be about a negative number: then brightness falls towards the light. Their product is summed over the
//! strengths that a light can have (our choice: the product of two normal distributions of logarithms takes a weak and unsure fit for
//! a sure one).

use crate::norm::light::{STRENGTH_MAX, STRENGTH_MIN};

/// Strengths of the sum, in equal factors.
const STEPS: usize = 65;
/// Standard deviation of the logarithm of a fitted strength beyond its noise: long waves show another strength than short ones (our choice;
/// 0.13 over synthetic scenes, 0.3 over real ones).
pub(super) const FITTED_SPREAD: f64 = 0.2;
/// Largest Bayes factor that is told.
const ODDS_MAX: f64 = 1e12;

/// What is expected of a strength.
#[derive(Debug, Clone, Copy)]
pub(super) struct Expected {
    /// Logarithm of the strength.
    pub(super) log: f64,
    /// Its standard deviation.
    pub(super) spread: f64,
}

impl Expected {
    /// Expects a strength, with the standard deviation of its logarithm.
    pub(super) fn new(strength: f64, spread: f64) -> Self {
        Self { log: libm::log(strength), spread }
    }

    /// Returns what both say, independent of each other.
    pub(super) fn and(self, other: Self) -> Self {
        let [a, b] = [self, other].map(|of| 1.0 / (of.spread * of.spread));
        Self { log: (a * self.log + b * other.log) / (a + b), spread: libm::sqrt(1.0 / (a + b)) }
    }
}

/// The strength after the fit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Strength {
    /// Mean of the logarithm, and its standard deviation.
    pub(super) log: f64,
    pub(super) spread: f64,
    /// Bayes factor: how much likelier the fit is under a light of the expected strength than without light; at most 1e12.
    pub(super) odds: f64,
}

impl Strength {
    /// Joins the expectation and a fitted strength with its variance. A fit that is not positive says nothing of the strength, but counts
    /// in the Bayes factor.
    pub(super) fn new(expected: Expected, fitted: Option<(f64, f64)>) -> Self {
        let alone = Self { log: expected.log, spread: expected.spread, odds: 1.0 };
        let Some((found, variance)) = fitted else { return alone };
        let (low, high) = (libm::log(STRENGTH_MIN), libm::log(STRENGTH_MAX));
        let logs = || (0..STEPS).map(|i| low + (high - low) * i as f64 / (STEPS - 1) as f64);
        let prior = |log: f64| {
            let off = (log - expected.log) / expected.spread;
            -0.5 * off * off
        };
        // A factor changes no sign, so a fit below 0 is off by its noise alone. The variance of the factor is scaled by the product of fitted and
        // true strength, so that twice and half of the fitted one are as likely.
        let of_factor = FITTED_SPREAD * FITTED_SPREAD * found.max(0.0);
        // Logarithm of the likelihood over that without light.
        let likelihood = |log: f64| {
            let strength = libm::exp(log);
            let (off, wide) = (found - strength, variance + of_factor * strength);
            0.5 * (found * found / variance - off * off / wide - libm::log(wide / variance))
        };
        // Numbers of any size stay finite if the largest is taken out.
        let largest = logs().map(|log| prior(log) + likelihood(log)).fold(f64::NEG_INFINITY, f64::max);
        if !largest.is_finite() {
            return alone;
        }
        let [mut expected_sum, mut sum, mut first, mut second] = [0.0; 4];
        for log in logs() {
            let weight = libm::exp(prior(log) + likelihood(log) - largest);
            expected_sum += libm::exp(prior(log));
            sum += weight;
            first += weight * log;
            second += weight * log * log;
        }
        let odds = (libm::exp(largest) * sum / expected_sum).min(ODDS_MAX);
        if found <= 0.0 {
            return Self { odds, ..alone };
        }
        let mean = first / sum;
        Self { log: mean, spread: libm::sqrt((second / sum - mean * mean).max(0.0)), odds }
    }

    /// Returns the probability of a light, if it was `before` without the fit.
    pub(super) fn probability(&self, before: f64) -> f64 {
        before * self.odds / (before * self.odds + 1.0 - before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strength(fitted: Option<(f64, f64)>) -> Strength {
        Strength::new(Expected::new(1.8, 0.9), fitted)
    }

    #[test]
    fn a_sure_fit_is_kept_and_an_unsure_one_is_drawn() {
        let sure = strength(Some((0.7, 1e-4)));
        assert!((sure.log - 0.7_f64.ln()).abs() < 0.06 && (sure.spread - 0.2).abs() < 0.02, "{sure:?}");
        assert!(sure.odds > 1e6 && sure.probability(0.5) > 0.999);
        // Known within a factor of 2, so between the fit and what is expected.
        let unsure = strength(Some((0.5, 0.5)));
        assert!((0.5..1.8).contains(&unsure.log.exp()) && unsure.spread > 0.4, "{unsure:?}");
        let none = strength(None);
        assert!((none.log.exp() - 1.8).abs() < 1e-12 && none.spread == 0.9 && none.odds == 1.0);
    }

    #[test]
    fn no_light_in_a_sure_fit_is_evidence_against_one() {
        let absent = strength(Some((0.0, 0.01)));
        assert!(absent.odds < 0.1 && absent.probability(0.9) < 0.3, "{absent:?}");
        let opposite = strength(Some((-1.0, 0.01)));
        assert!(opposite.odds < absent.odds && opposite.log.exp() == strength(None).log.exp(), "{opposite:?}");
        // A fit that knows nothing.
        let open = strength(Some((0.3, 1e6)));
        assert!((open.odds - 1.0).abs() < 0.01, "{open:?}");
    }

    #[test]
    fn odds_change_the_odds_of_before() {
        let of = |odds, before| Strength { odds, ..strength(None) }.probability(before);
        assert_eq!(
            [of(1.0, 0.25), of(3.0, 0.25), of(1.0 / 3.0, 0.75), of(7.0, 0.0), of(7.0, 1.0)],
            [0.25, 0.5, 0.5, 0.0, 1.0]
        );
    }

    #[test]
    fn any_numbers_give_finite_ones() {
        for found in [-1e30, -5.0, 0.0, 1e-9, 7.0, 1e30] {
            for variance in [1e-30, 1e-3, 1.0, 1e30] {
                let Strength { log, spread, odds } = strength(Some((found, variance)));
                assert!(
                    log.is_finite() && spread.is_finite() && (0.0..=ODDS_MAX).contains(&odds),
                    "{found} {variance}"
                );
            }
        }
    }

    #[test]
    fn two_expectations_are_narrower_than_one() {
        let both = Expected::new(1.0, 0.6).and(Expected::new(4.0, 0.6));
        assert!((both.log.exp() - 2.0).abs() < 1e-12 && (both.spread - 0.6 / 2.0_f64.sqrt()).abs() < 1e-12);
    }
}
