//! The weighted sum of the three terms (Eq. 5).

use super::{Pair, gradient, l1, mean_elevation, normal};
use crate::loss::LossError;

/// The elevation term of the sum.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ElevationTerm {
    /// Mean-normalised L1 (Eq. 6–7), as in the paper.
    #[default]
    MeanNormalised,
    /// Plain L1, an ablation of the paper.
    L1,
}

/// Weights of the sum. The default is the paper's 10, 1, 1; the paper's first iterations use 10, 0, 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// Weight of the elevation term.
    pub elevation: f64,
    /// Weight of the gradient term.
    pub gradient: f64,
    /// Weight of the normal term.
    pub normal: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Self { elevation: 10.0, gradient: 1.0, normal: 1.0 }
    }
}

/// The three terms of a tile, without weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Terms {
    /// Elevation term, dimensionless (mean-normalised) or in normalised units (L1).
    pub elevation: f64,
    /// Gradient term, normalised units per pixel.
    pub gradient: f64,
    /// Normal term, 0 to 2.
    pub normal: f64,
}

impl Terms {
    /// Returns the loss (Eq. 5).
    pub fn total(&self, weights: Weights) -> f64 {
        weights.elevation * self.elevation + weights.gradient * self.gradient + weights.normal * self.normal
    }
}

/// Returns the three terms.
///
/// # Errors
/// Those of [`mean_elevation::value`] and [`gradient::value`].
pub fn terms(pair: &Pair<'_>, elevation: ElevationTerm) -> Result<Terms, LossError> {
    let elevation = match elevation {
        ElevationTerm::MeanNormalised => mean_elevation::value(pair)?,
        ElevationTerm::L1 => l1::value(pair),
    };
    Ok(Terms { elevation, gradient: gradient::value(pair)?, normal: normal::value(pair)? })
}

/// Adds the derivative of the weighted sum with respect to the prediction to `out`, and returns the terms.
///
/// # Errors
/// As [`terms`], and [`LossError::Length`] if `out` does not have one sample per pixel. After an error `out` may contain a part of the sum.
pub fn add_gradient(
    pair: &Pair<'_>,
    elevation: ElevationTerm,
    weights: Weights,
    out: &mut [f32],
) -> Result<Terms, LossError> {
    let elevation = match elevation {
        ElevationTerm::MeanNormalised => mean_elevation::add_gradient(pair, weights.elevation, out)?,
        ElevationTerm::L1 => l1::add_gradient(pair, weights.elevation, out)?,
    };
    let gradient = gradient::add_gradient(pair, weights.gradient, out)?;
    Ok(Terms { elevation, gradient, normal: normal::add_gradient(pair, weights.normal, out)? })
}
