//! The hybrid loss (Eq. 5–7) and its variants on plain slices, each with its analytic gradient.
//!
//! This is the reference implementation; training uses tensors, and a test compares the two. Every term is a mean over one tile, computed
//! in `f64`; the loss of a batch is the mean over its tiles. `add_gradient` functions add weight · ∂term/∂predicted to the caller's buffer,
//! so terms add up without scratch memory. Where a term has a kink (|x| at 0), its gradient is 0.
//!
//! ```
//! use elunar_core::loss::{Pair, hybrid::{Weights, add_gradient, terms}};
//! use elunar_core::tile::Shape;
//! let truth = [0.0, 10.0, 20.0, 50.0];
//! let predicted = [1.0, 10.0, 30.0, 40.0];
//! let pair = Pair::new(&truth, &predicted, None, Shape::new(2, 2))?;
//! let mut gradient = [0.0; 4];
//! let found = add_gradient(&pair, Default::default(), Weights::default(), &mut gradient)?;
//! assert_eq!(found, terms(&pair, Default::default())?);
//! assert!(found.total(Weights::default()) > 0.0);
//! # Ok::<(), elunar_core::loss::LossError>(())
//! ```

mod error;
pub mod gradient;
pub mod hybrid;
pub mod l1;
pub mod mean_elevation;
pub mod normal;
mod sobel;

pub use error::LossError;

use crate::error::same_length;
use crate::mask;
use crate::tile::Shape;

/// The "small offset" on the means of Eq. 6–7, and the threshold of the relative metrics (value: our choice).
pub const PAD_EPS: f64 = 1e-3;

/// A true and a predicted tile of normalised elevations, with an optional mask. In a `Pair` all buffers have the tile's shape, and at least
/// one pixel is valid (see [`mask::counts`]) in both tiles.
#[derive(Debug, Clone, Copy)]
pub struct Pair<'a> {
    truth: &'a [f32],
    predicted: &'a [f32],
    valid: Option<&'a [bool]>,
    rows: usize,
    cols: usize,
    count: usize,
}

impl<'a> Pair<'a> {
    /// Pairs two row-major tiles of `shape`.
    ///
    /// # Errors
    /// [`LossError::Length`] if a buffer does not fit the shape, [`LossError::NothingValid`] if no pixel is valid.
    pub fn new(
        truth: &'a [f32],
        predicted: &'a [f32],
        valid: Option<&'a [bool]>,
        shape: Shape,
    ) -> Result<Self, LossError> {
        let Shape { rows, cols } = shape;
        let expected = shape.pixels();
        same_length(expected, truth.len())?;
        same_length(expected, predicted.len())?;
        if let Some(valid) = valid {
            same_length(expected, valid.len())?;
        }
        let mut pair = Self { truth, predicted, valid, rows, cols, count: 0 };
        pair.count = (0..expected).filter(|&i| pair.counts(i)).count();
        if pair.count == 0 { Err(LossError::NothingValid) } else { Ok(pair) }
    }

    /// Returns whether pixel `i` is valid in both tiles.
    fn counts(&self, i: usize) -> bool {
        mask::counts(self.truth, self.valid, i) && mask::is_real(self.predicted[i])
    }

    /// Returns (index, truth, predicted) of every valid pixel.
    fn pixels(&self) -> impl Iterator<Item = (usize, f64, f64)> {
        (0..self.truth.len())
            .filter(|&i| self.counts(i))
            .map(|i| (i, f64::from(self.truth[i]), f64::from(self.predicted[i])))
    }
}

/// Returns −1, 0 or 1: the derivative of |x|, 0 at the kink.
fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

#[cfg(test)]
mod tests;
