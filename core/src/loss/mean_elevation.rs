//! Mean-normalised L1 (Eq. 6–7): l_mn = mean |z / z̄ − z* / z̄*|, each tile divided by its own mean.
//!
//! The divisors are z̄ + ε for the truth and z̄* + ε for the prediction (ε = [`super::PAD_EPS`]). This term does not depend on the absolute
//! scale of the prediction; [`super::gradient`] determines it.

use super::{Pair, sign};
use crate::error::same_length;
use crate::loss::LossError;

/// Returns the loss over the valid pixels; the means are taken over the same pixels.
///
/// # Errors
/// [`LossError::ZeroMean`] if a mean plus ε is exactly zero.
pub fn value(pair: &Pair<'_>) -> Result<f64, LossError> {
    let (truth_mean, predicted_mean) = means(pair)?;
    Ok(pair.pixels().map(|(_, t, p)| (t / truth_mean - p / predicted_mean).abs()).sum::<f64>() / pair.count as f64)
}

/// Adds weight · ∂l_mn/∂z* to `gradient` and returns the loss.
///
/// With s_i = sign(z_i/z̄ − z*_i/z̄*) the derivative is (1/n) (−s_j / z̄* + Σ s_i z*_i / (n z̄*²)). The second part is the effect of pixel
/// j on the mean that divides all pixels.
///
/// # Errors
/// [`LossError::ZeroMean`] as [`value`]; [`LossError::Length`] if `gradient` does not have one sample per pixel.
pub fn add_gradient(pair: &Pair<'_>, weight: f64, gradient: &mut [f32]) -> Result<f64, LossError> {
    same_length(pair.truth.len(), gradient.len())?;
    let (truth_mean, predicted_mean) = means(pair)?;
    let n = pair.count as f64;
    let (mut loss, mut through_mean) = (0.0, 0.0);
    for (_, t, p) in pair.pixels() {
        let difference = t / truth_mean - p / predicted_mean;
        loss += difference.abs() / n;
        through_mean += sign(difference) * p / (n * predicted_mean * predicted_mean);
    }
    for (i, t, p) in pair.pixels() {
        let direct = -sign(t / truth_mean - p / predicted_mean) / predicted_mean;
        gradient[i] += (weight * (direct + through_mean) / n) as f32;
    }
    Ok(loss)
}

fn means(pair: &Pair<'_>) -> Result<(f64, f64), LossError> {
    let (truth, predicted) = pair.pixels().fold((0.0, 0.0), |(a, b), (_, t, p)| (a + t, b + p));
    let n = pair.count as f64;
    let (truth, predicted) = (truth / n + super::PAD_EPS, predicted / n + super::PAD_EPS);
    if truth == 0.0 || predicted == 0.0 { Err(LossError::ZeroMean) } else { Ok((truth, predicted)) }
}
