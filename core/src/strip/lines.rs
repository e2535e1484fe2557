//! The lines kept: a ring of image and coarse heights, from which tiles are cut.

use crate::mask::is_real;
use crate::part::{item, part, part_mut};
use crate::tile::Window;

/// Image and coarse heights of the last lines; voids are NaN.
#[derive(Debug)]
pub(super) struct Lines<'m> {
    pub(super) image: &'m mut [f32],
    pub(super) coarse_m: &'m mut [f32],
    pub(super) cols: usize,
    pub(super) ring: usize,
}

impl Lines<'_> {
    /// Stores line `row` in the place of the line that is `ring` lines older.
    pub(super) fn keep(&mut self, row: usize, image: &[f32], coarse_m: &[f32]) {
        let at = self.first(row);
        for (kept, line) in [(&mut *self.image, image), (&mut *self.coarse_m, coarse_m)] {
            for (kept, &v) in part_mut(kept, at, self.cols).iter_mut().zip(line) {
                *kept = if is_real(v) { v } else { f32::NAN };
            }
        }
    }

    /// Returns line `row`: image and coarse heights.
    pub(super) fn line(&self, row: usize) -> (&[f32], &[f32]) {
        let at = self.first(row);
        (part(self.image, at, self.cols), part(self.coarse_m, at, self.cols))
    }

    /// Cuts a tile out of a strip of `rows` lines, and continues the strip beyond its last line and column by repeating them. With `void`,
    /// the image is void there and wherever the coarse DTM is. Returns whether both inputs are real in any pixel of the tile.
    pub(super) fn cut(&self, window: Window, rows: usize, void: bool, image: &mut [f32], coarse_m: &mut [f32]) -> bool {
        let (last_row, last_col, width) = (rows.saturating_sub(1), self.cols.saturating_sub(1), window.cols.max(1));
        let mut any = false;
        for (i, (image, coarse_m)) in image.chunks_mut(width).zip(coarse_m.chunks_mut(width)).enumerate() {
            let row = window.row.saturating_add(i);
            let (from, from_m) = self.line(row.min(last_row));
            for (c, (v, z)) in image.iter_mut().zip(coarse_m).enumerate() {
                let col = window.col.saturating_add(c);
                (*v, *z) = (item(from, col.min(last_col)), item(from_m, col.min(last_col)));
                let real = v.is_finite() && z.is_finite();
                any |= real;
                if void && (!real || row > last_row || col > last_col) {
                    *v = f32::NAN;
                }
            }
        }
        any
    }

    fn first(&self, row: usize) -> usize {
        (row % self.ring.max(1)).saturating_mul(self.cols)
    }
}
