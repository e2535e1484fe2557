//! L1 over gradients: l_grad = mean |∂x(z − z*)| + mean |∂y(z − z*)|, with Sobel derivatives.

use super::{Pair, sign, sobel};
use crate::error::same_length;
use crate::loss::LossError;

/// Returns the loss over the pixels whose 3 x 3 neighbourhood is valid.
///
/// # Errors
/// [`LossError::NothingValid`] if no neighbourhood is complete.
pub fn value(pair: &Pair<'_>) -> Result<f64, LossError> {
    let (mut sum, mut count) = (0.0, 0usize);
    for (_, _, d) in sobel::each(pair) {
        sum += (d.truth_x - d.predicted_x).abs() + (d.truth_y - d.predicted_y).abs();
        count += 1;
    }
    if count == 0 { Err(LossError::NothingValid) } else { Ok(sum / count as f64) }
}

/// Adds weight · ∂l_grad/∂z* to `gradient` and returns the loss.
///
/// # Errors
/// [`LossError::NothingValid`] as [`value`]; [`LossError::Length`] if `gradient` does not have one sample per pixel.
pub fn add_gradient(pair: &Pair<'_>, weight: f64, gradient: &mut [f32]) -> Result<f64, LossError> {
    same_length(pair.truth.len(), gradient.len())?;
    let loss = value(pair)?;
    let share = weight / sobel::each(pair).count() as f64;
    for (row, col, d) in sobel::each(pair) {
        let (x, y) = (sign(d.predicted_x - d.truth_x), sign(d.predicted_y - d.truth_y));
        sobel::scatter(pair, (row, col), share * x, share * y, gradient);
    }
    Ok(loss)
}
