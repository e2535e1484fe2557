//! The lines kept: a ring of image and coarse heights, from which tiles are cut.

use crate::mask::is_real;
use crate::part::{item, part, part_mut};
use crate::samples::Samples;
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

    /// Returns image and coarse heights of a tile of a strip of `rows` lines. Beyond its last line and column the strip repeats them.
    pub(super) fn tile(&self, window: Window, rows: usize) -> [RingTile<'_>; 2] {
        let (cols, ring) = (self.cols, self.ring);
        [&*self.image, &*self.coarse_m].map(|lines| RingTile { lines, window, rows, cols, ring })
    }

    fn first(&self, row: usize) -> usize {
        (row % self.ring.max(1)).saturating_mul(self.cols)
    }
}

/// The samples of a tile in a ring of lines.
#[derive(Debug, Clone, Copy)]
pub(super) struct RingTile<'m> {
    lines: &'m [f32],
    window: Window,
    /// Lines and columns of the strip.
    rows: usize,
    cols: usize,
    ring: usize,
}

impl Samples for RingTile<'_> {
    fn len(&self) -> usize {
        self.window.shape().pixels()
    }

    fn at(&self, index: usize) -> f32 {
        let mut sample = [f32::NAN];
        self.read(index, &mut sample);
        sample[0]
    }

    fn read(&self, first: usize, out: &mut [f32]) {
        let (row, col) = (first / self.window.cols.max(1), first % self.window.cols.max(1));
        let row = self.window.row.saturating_add(row).min(self.rows.saturating_sub(1));
        let line = part(self.lines, (row % self.ring.max(1)).saturating_mul(self.cols), self.cols);
        let (col, last) = (self.window.col.saturating_add(col), self.cols.saturating_sub(1));
        for (value, col) in out.iter_mut().zip(col..) {
            *value = item(line, col.min(last));
        }
    }
}
