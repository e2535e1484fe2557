//! The expected errors of the tiles of a strip, and of a line of it.

use super::ring::{Ring, RingShape, put_floats};
use crate::photoclinometry::{Errors, ExpectedErrors};
use crate::tile::{Shape, Tiling};

/// The expected errors of a line, and where its heights come from. They are the means of the tiles' own, with the weights of their heights.
/// Errors are NaN in voids, and if the model's maps are not weighed.
#[derive(Debug, Default)]
pub struct LineErrors<'o> {
    /// Of heights, metres, without the coarse DTM's own error.
    pub height_m: &'o mut [f32],
    /// Of slopes along either axis, metres per metre.
    pub slope: &'o mut [f32],
    /// Codes of [`crate::photoclinometry::Origin`].
    pub origin: &'o mut [u8],
}

/// A ring of rows of tiles: a line for each tile.
#[derive(Debug)]
pub(super) struct Expected<'m>(pub(super) Ring<'m>);

impl Expected<'_> {
    /// Number of sums of a pixel.
    pub(super) const SUMS: usize = 4;
    const BYTES: usize = 4 * ExpectedErrors::VALUES;

    /// Returns the size of the ring: rows of tiles that can reach one line, with the last row, which is moved back, and the row in progress.
    pub(super) fn shape(tiling: &Tiling, tile: Shape) -> Option<RingShape> {
        let rows = tile.rows.div_ceil(tiling.stride().rows.max(1)).saturating_add(2);
        Some(RingShape { lines: rows.checked_mul(tiling.shape().cols)?, line_bytes: Self::BYTES })
    }

    /// Stores those of a tile.
    pub(super) fn keep(&mut self, index: usize, errors: &ExpectedErrors) {
        self.0.write(index, |bytes| put_floats(bytes, errors.to_values()));
    }

    /// Returns those of a tile that reaches a line not yet returned, and whether they are lost since the last call.
    pub(super) fn get(&mut self, index: usize) -> (ExpectedErrors, u64) {
        let lost = self.0.check(index, 0..Self::BYTES);
        let line = self.0.line(index);
        let values = core::array::from_fn(|k| line.float(k));
        (if line.is_lost(0) { ExpectedErrors::UNKNOWN } else { ExpectedErrors::from_values(values) }, lost)
    }
}

/// Returns the errors in the order of sums.
pub(super) fn parts(errors: Errors) -> [f32; Expected::SUMS] {
    [errors.height_m, errors.slope, errors.explained, errors.dark]
}
