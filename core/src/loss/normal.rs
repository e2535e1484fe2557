//! Angle between surface normals: l_norm = mean (1 − cos(n, n*)), n = (−∂x z, −∂y z, 1), with Sobel derivatives per pixel step of the
//! normalised elevation (therefore these are not the normals of the ground).

use super::Pair;
use super::sobel::{Derivatives, each, scatter};
use crate::error::same_length;
use crate::loss::LossError;

/// Returns the loss over the pixels whose 3 x 3 neighbourhood is valid: 0 for parallel normals, above 1 only for normals that differ by
/// more than a right angle.
///
/// # Errors
/// [`LossError::NothingValid`] if no neighbourhood is complete.
pub fn value(pair: &Pair<'_>) -> Result<f64, LossError> {
    let (mut sum, mut count) = (0.0, 0usize);
    for (_, _, d) in each(pair) {
        sum += 1.0 - cosine(&d).0;
        count += 1;
    }
    if count == 0 { Err(LossError::NothingValid) } else { Ok(sum / count as f64) }
}

/// Adds weight · ∂l_norm/∂z* to `gradient` and returns the loss.
///
/// With g the true and g* the predicted derivative, ∂cos/∂g*_x = g_x / (|n| |n*|) − cos · g*_x / |n*|².
///
/// # Errors
/// [`LossError::NothingValid`] as [`value`]; [`LossError::Length`] if `gradient` does not have one sample per pixel.
pub fn add_gradient(pair: &Pair<'_>, weight: f64, gradient: &mut [f32]) -> Result<f64, LossError> {
    same_length(pair.truth.len(), gradient.len())?;
    let loss = value(pair)?;
    let share = -weight / each(pair).count() as f64;
    for (row, col, d) in each(pair) {
        let (cos, lengths, predicted_square) = cosine(&d);
        let x = d.truth_x / lengths - cos * d.predicted_x / predicted_square;
        let y = d.truth_y / lengths - cos * d.predicted_y / predicted_square;
        scatter(pair, (row, col), share * x, share * y, gradient);
    }
    Ok(loss)
}

/// Returns cos(n, n*), |n| |n*| and |n*|².
fn cosine(d: &Derivatives) -> (f64, f64, f64) {
    let truth_square = d.truth_x * d.truth_x + d.truth_y * d.truth_y + 1.0;
    let predicted_square = d.predicted_x * d.predicted_x + d.predicted_y * d.predicted_y + 1.0;
    let lengths = libm::sqrt(truth_square) * libm::sqrt(predicted_square);
    ((d.truth_x * d.predicted_x + d.truth_y * d.predicted_y + 1.0) / lengths, lengths, predicted_square)
}
