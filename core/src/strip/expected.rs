//! The expected errors of the tiles of a strip, and of a line of it.

use super::cut::Cut;
use crate::part::{copy, part, part_mut};
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

/// A ring of rows of tiles.
#[derive(Debug)]
pub(super) struct Expected<'m> {
    pub(super) values: &'m mut [f32],
}

impl Expected<'_> {
    /// Number of sums of a pixel.
    pub(super) const SUMS: usize = 4;

    /// Returns the number of rows of tiles that can reach one line, with the last row, which is moved back, and the row in progress.
    fn rows(tiling: &Tiling, tile: Shape) -> usize {
        tile.rows.div_ceil(tiling.stride().rows.max(1)).saturating_add(2)
    }

    /// Returns the number of values to lend.
    pub(super) fn len(tiling: &Tiling, tile: Shape) -> Option<usize> {
        Self::rows(tiling, tile).checked_mul(tiling.shape().cols)?.checked_mul(ExpectedErrors::VALUES)
    }

    fn place(cut: &Cut, tile: Shape, index: usize) -> usize {
        let ring = Self::rows(&cut.tiling, tile).saturating_mul(cut.tiling.shape().cols);
        (index % ring.max(1)).saturating_mul(ExpectedErrors::VALUES)
    }

    /// Stores those of a tile.
    pub(super) fn keep(&mut self, cut: &Cut, tile: Shape, index: usize, errors: &ExpectedErrors) {
        let at = Self::place(cut, tile, index);
        copy(part_mut(self.values, at, ExpectedErrors::VALUES), &errors.to_values());
    }

    /// Returns those of a tile that reaches a line not yet returned.
    pub(super) fn get(&self, cut: &Cut, tile: Shape, index: usize) -> ExpectedErrors {
        let values = part(self.values, Self::place(cut, tile, index), ExpectedErrors::VALUES);
        values.first_chunk().map_or(ExpectedErrors::UNKNOWN, |values| ExpectedErrors::from_values(*values))
    }
}

/// Returns the errors in the order of sums.
pub(super) fn parts(errors: Errors) -> [f32; Expected::SUMS] {
    [errors.height_m, errors.slope, errors.explained, errors.dark]
}
