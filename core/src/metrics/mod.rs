//! The figures of a comparison of DTMs: accumulators to which pixels or tiles are added one by one, so that memory does not depend on the
//! size of a scene.
//!
//! [`height`] works in metres (the paper's test metrics: MAE, RMSE, share of |e| below 2, 4 and 10 m) and [`relative`] on normalised
//! elevations (Eq. 11–17). [`slope`] works on slopes in degrees and [`mod@gradient`] on slopes as vectors, which no metric of the paper
//! measures. [`correlation`] works on any two maps. Every accumulator can `merge` another one, so every thread can have its own.

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
use crate::grid::GridView;
use crate::mask;
use crate::terrain::{PixelSize, gradient};

/// Calls `push` for every pixel that is valid in both grids.
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

/// Calls `push` with both gradients (towards east and south, metres per metre, after Horn) of every pixel whose 3 x 3 neighbourhood is real in
/// both grids.
fn each_gradient(
    truth_m: GridView<'_, f32>,
    predicted_m: GridView<'_, f32>,
    pixel: PixelSize,
    mut push: impl FnMut((f64, f64), (f64, f64)),
) -> Result<(), LengthError> {
    let (rows, cols) = (truth_m.rows(), truth_m.cols());
    if (rows, cols) != (predicted_m.rows(), predicted_m.cols()) {
        return Err(LengthError { expected: rows * cols, found: predicted_m.rows() * predicted_m.cols() });
    }
    for (row, col) in (0..rows).flat_map(|row| (0..cols).map(move |col| (row, col))) {
        if let Some(truth) = gradient(truth_m, row, col, pixel)
            && let Some(predicted) = gradient(predicted_m, row, col, pixel)
        {
            push(truth, predicted);
        }
    }
    Ok(())
}

/// Returns `sum / count`, or `None` if `count` is 0.
fn mean(sum: f64, count: u64) -> Option<f64> {
    if count == 0 { None } else { Some(sum / count as f64) }
}
