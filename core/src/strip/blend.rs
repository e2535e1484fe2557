//! The weighted mean of overlapping tiles, line by line.
//!
//! Only means are kept. The weights of the tiles in a mean are computed when another one is added: they depend only on the places of tiles.

use super::cut::Cut;
use super::expected::{Expected, LineErrors, parts};
use super::mean::{MEAN_BYTES, MEANS, clear, means};
use super::ring::{PIECE, Ring};
use crate::overlap::{Open, OverlapWeights, TAPS};
use crate::part::{item, part, part_mut, put};
use crate::photoclinometry::Origin;
use crate::samples::{Samples, is_set};
use crate::tile::{Shape, Window};

/// Means of a ring of lines; NaN where no tile has been added yet.
#[derive(Debug)]
pub(super) struct Blend<'m> {
    pub(super) means: Ring<'m>,
    /// Memory for the computation of weights and of expected errors: nothing is kept in it.
    pub(super) aside: &'m mut [f64],
    pub(super) weights: OverlapWeights,
    pub(super) tile: Shape,
    pub(super) cols: usize,
}

/// A tile to be added: its place, heights and bits of valid heights.
#[derive(Debug, Clone, Copy)]
pub(super) struct Added<'t> {
    pub(super) index: usize,
    pub(super) window: Window,
    pub(super) heights_m: &'t [f32],
    pub(super) valid: &'t [u8],
}

impl Blend<'_> {
    /// Returns the cost of a line of a tile, about that of so many multiply-accumulates: mostly that of two lines of weights.
    pub(super) fn line_cost(&self) -> u64 {
        (4 * TAPS * self.tile.cols + 2 * PIECE) as u64
    }

    /// Number of values of memory beside the means: for lines of weights of three tiles, or, with expected errors, sums of a line.
    pub(super) fn aside_len(cols: usize, tile: Shape, expected_errors: bool) -> usize {
        let weigh = tile.cols.saturating_add(OverlapWeights::scratch_len(tile.cols));
        let lines = if expected_errors { cols.saturating_mul(1 + Expected::SUMS) } else { 0 };
        lines.max(2 * tile.cols).saturating_add(weigh)
    }

    /// Makes all lines empty.
    pub(super) fn clear(&mut self) {
        (0..self.tile.rows).for_each(|row| self.means.rewrite(row, |piece, _| clear(piece)));
    }

    /// Adds line `r` of a tile wherever it is valid. Returns the number of pieces that are lost since the last time.
    pub(super) fn add(&mut self, cut: &Cut, tile: &Added<'_>, r: usize) -> u64 {
        let (window, cols) = (tile.window, self.tile.cols);
        let row = window.row.saturating_add(r);
        self.weigh_before(cut, tile, row);
        let (before, rest) = self.aside.split_at_mut_checked(cols).unwrap_or_default();
        let (own, rest) = rest.split_at_mut_checked(cols).unwrap_or_default();
        let (_, scratch) = weights_of(rest, 0, cols);
        // The plan guarantees the lengths.
        let _ = self.weights.line(Open::of(window, cut.scene), r, own, scratch);
        let end = window.col.saturating_add(cols).min(self.cols);
        let lost = self.means.check(row, MEAN_BYTES * window.col..MEAN_BYTES * end);
        for piece in window.col / MEANS..end.div_ceil(MEANS) {
            let first = piece * MEANS;
            let (from, to) = (first.max(window.col), end.min(first.saturating_add(MEANS)));
            let (c, count) = (from - window.col, to - from);
            let weights = part(before, c, count).iter().zip(part(own, c, count));
            let heights_m = (r * cols + c..).zip(part(tile.heights_m, r * cols + c, count));
            self.means.change(row, piece, |bytes| {
                for ((mut mean, (before, weight)), (pixel, z)) in
                    means(bytes).skip(from - first).zip(weights).zip(heights_m)
                {
                    if is_set(tile.valid, pixel) {
                        let (found, z) = (mean.get(), f64::from(*z));
                        mean.set(if found.is_nan() { z } else { (found * before + weight * z) / (before + weight) });
                    }
                }
            });
        }
        lost
    }

    /// Writes the heights of a line to which all tiles have been added, NaN in voids; then its place is free for another line. Returns the number of pieces that are lost
    /// since the last time.
    pub(super) fn take(&mut self, row: usize, out_m: &mut [f32]) -> u64 {
        let lost = self.means.check(row, 0..MEAN_BYTES * self.cols);
        let mut pieces = out_m.chunks_mut(MEANS);
        self.means.rewrite(row, |piece, is_lost| {
            for (mean, out_m) in means(piece).zip(pieces.next().unwrap_or_default()) {
                *out_m = if is_lost { f32::NAN } else { mean.get() as f32 };
            }
            clear(piece);
        });
        lost
    }

    /// Writes the expected errors of a line with these heights. `errors` are those of all tiles. Returns the number of pieces that are lost since
    /// the last time.
    pub(super) fn expected(
        &mut self,
        cut: &Cut,
        row: usize,
        image: &impl Samples,
        heights_m: &[f32],
        errors: &mut Expected<'_>,
        out: LineErrors<'_>,
    ) -> u64 {
        let (cols, mut lost) = (self.cols, 0);
        self.weigh(cut, row, Expected::SUMS, |index, first, weights, sums| {
            let (errors, lost_now) = errors.get(index);
            lost += lost_now;
            for (col, weight) in (first..cols).zip(weights) {
                for (line, error) in parts(errors.at(image.at(col))).into_iter().enumerate() {
                    if let Some(sum) = sums.get_mut(line * cols + col) {
                        *sum += *weight * f64::from(error);
                    }
                }
            }
        });
        let (totals, rest) = self.aside.split_at_mut_checked(cols).unwrap_or_default();
        for (col, z) in heights_m.iter().enumerate() {
            let total = item(totals, col);
            let mean = |line: usize| (item(rest, line * cols + col) / total) as f32;
            let [height_m, slope, explained, dark] =
                if z.is_finite() { core::array::from_fn(mean) } else { [f32::NAN; 4] };
            put(out.height_m, col, height_m);
            put(out.slope, col, slope);
            put(out.origin, col, Origin::of(explained, dark) as u8);
        }
        lost
    }

    /// Adds up the weights of the tiles before this one over its part of a line, in order, at the begin of the memory aside.
    fn weigh_before(&mut self, cut: &Cut, tile: &Added<'_>, row: usize) {
        let cols = self.tile.cols;
        part_mut(self.aside, 0, cols).fill(0.0);
        let (from, to) = (tile.window.col, tile.window.col.saturating_add(cols));
        let mut made = None;
        for (_, window) in reaching(cut, self.tile, row).take_while(|(index, _)| *index < tile.index) {
            let end = window.col.saturating_add(cols);
            if end <= from || window.col >= to {
                continue;
            }
            let (before, rest) = self.aside.split_at_mut_checked(cols).unwrap_or_default();
            let (weights, scratch) = weights_of(rest, cols, cols);
            let key = (Open::of(window, cut.scene), row - window.row);
            if made != Some(key) {
                // The plan guarantees the lengths.
                let _ = self.weights.line(key.0, key.1, weights, scratch);
                made = Some(key);
            }
            for col in from.max(window.col)..to.min(end) {
                put(before, col - from, item(before, col - from) + item(weights, col - window.col));
            }
        }
    }

    /// Adds up the weights of all tiles over a line, in the order in which tiles are added. `each` takes the number of a tile, its first
    /// column, its weights, and `lines` sums of every column that begin at 0.
    fn weigh(&mut self, cut: &Cut, row: usize, lines: usize, mut each: impl FnMut(usize, usize, &[f64], &mut [f64])) {
        part_mut(self.aside, 0, (1 + lines) * self.cols).fill(0.0);
        let mut made = None;
        for (index, window) in reaching(cut, self.tile, row) {
            let (totals, rest) = self.aside.split_at_mut_checked(self.cols).unwrap_or_default();
            let (sums, rest) = rest.split_at_mut_checked(lines * self.cols).unwrap_or_default();
            let (weights, scratch) = weights_of(rest, 0, window.cols);
            // Neighbours within a row of tiles have the same weights, except the first and the last tile.
            let key = (Open::of(window, cut.scene), row - window.row);
            if made != Some(key) {
                // The plan guarantees the lengths.
                let _ = self.weights.line(key.0, key.1, weights, scratch);
                made = Some(key);
            }
            for (total, weight) in totals.iter_mut().skip(window.col).zip(weights.iter()) {
                *total += *weight;
            }
            each(index, window.col, weights, sums);
        }
    }
}

/// Returns the tiles over a line, by their numbers.
fn reaching(cut: &Cut, tile: Shape, row: usize) -> impl Iterator<Item = (usize, Window)> {
    let tiling = cut.tiling;
    let first = row.saturating_sub(tile.rows) / tiling.stride().rows.max(1);
    let windows =
        (first.saturating_mul(tiling.shape().cols)..).map_while(move |index| Some((index, tiling.get(index)?)));
    windows.take_while(move |(_, window)| window.row <= row).filter(move |(_, window)| row - window.row < window.rows)
}

/// Returns the memory for a tile's line of weights behind the first `skip` values, and the scratch memory for its computation.
fn weights_of(aside: &mut [f64], skip: usize, cols: usize) -> (&mut [f64], &mut [f64]) {
    let room = part_mut(aside, skip, cols + OverlapWeights::scratch_len(cols));
    room.split_at_mut_checked(cols).unwrap_or_default()
}
