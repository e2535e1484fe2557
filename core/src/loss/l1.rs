//! Plain L1, mean |z − z*|: the paper's ablation of the mean-normalised loss.

use super::{Pair, sign};
use crate::error::same_length;
use crate::loss::LossError;

/// Returns the mean absolute difference over the valid pixels.
pub fn value(pair: &Pair<'_>) -> f64 {
    pair.pixels().map(|(_, t, p)| (t - p).abs()).sum::<f64>() / pair.count as f64
}

/// Adds weight · sign(z* − z) / n to `gradient` and returns the loss.
///
/// # Errors
/// [`LossError::Length`] if `gradient` does not have one sample per pixel.
pub fn add_gradient(pair: &Pair<'_>, weight: f64, gradient: &mut [f32]) -> Result<f64, LossError> {
    same_length(pair.truth.len(), gradient.len())?;
    for (i, t, p) in pair.pixels() {
        gradient[i] += (weight * sign(p - t) / pair.count as f64) as f32;
    }
    Ok(value(pair))
}
