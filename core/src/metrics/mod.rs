//! How good a DTM is: streaming accumulators, one pixel or one tile at a time, so that a scene of any size needs no memory.
//!
//! [`height`] works in metres (the paper's test metrics: MAE, RMSE, share of |e| below 2, 4 and 10 m), [`relative`] on
//! normalised elevations (Eq. 11–17), [`slope`] on degrees of slope and [`gradient`] on slopes as vectors, which no metric of the
//! paper sees, [`correlation`] on any two maps. Every accumulator can `merge` another, so threads keep their own.

pub mod correlation;
pub mod gradient;
pub mod height;
pub mod relative;
pub mod slope;

pub use correlation::Correlation;
pub use gradient::{Facing, GradientErrors};
pub use height::HeightErrors;
pub use relative::RelativeErrors;
pub use slope::SlopeErrors;

use crate::error::{LengthError, same_length};
use crate::mask;

/// Calls `push` for every pixel that counts in both grids.
fn each_pair(
    truth: &[f32],
    predicted: &[f32],
    valid: Option<&[bool]>,
    mut push: impl FnMut(f64, f64),
) -> Result<(), LengthError> {
    same_length(truth.len(), predicted.len())?;
    if let Some(valid) = valid {
        same_length(truth.len(), valid.len())?;
    }
    for i in 0..truth.len() {
        if mask::counts(truth, valid, i) && mask::is_real(predicted[i]) {
            push(f64::from(truth[i]), f64::from(predicted[i]));
        }
    }
    Ok(())
}

/// `sum / count`, or `None` when nothing was counted.
fn mean(sum: f64, count: u64) -> Option<f64> {
    if count == 0 { None } else { Some(sum / count as f64) }
}
