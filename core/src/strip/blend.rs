//! The weighted mean of overlapping tiles, line by line.
//!
//! Only sums of weighted heights are kept. Sums of weights are computed when a line leaves: they depend only on the places of tiles,
//! because every tile has a height wherever the strip is valid.

use super::cut::Cut;
use super::expected::{Expected, LineErrors, parts};
use super::lines::Lines;
use crate::overlap::{Open, OverlapWeights};
use crate::part::{item, part, part_mut, put};
use crate::photoclinometry::Origin;
use crate::tile::{Shape, Window};

/// Sums of a ring of lines; NaN where no tile has been added yet.
#[derive(Debug)]
pub(super) struct Blend<'m> {
    pub(super) sums: &'m mut [f64],
    /// Scratch memory for a line of the strip, a line of a tile, and the computation of weights.
    pub(super) aside: &'m mut [f64],
    pub(super) weights: OverlapWeights,
    pub(super) tile: Shape,
    pub(super) cols: usize,
}

impl Blend<'_> {
    /// Adds a tile's heights wherever the strip is valid.
    pub(super) fn add(&mut self, cut: &Cut, window: Window, lines: &Lines<'_>, heights_m: &[f32]) {
        let (open, cols) = (Open::of(window, cut.scene), window.cols);
        for (r, heights_m) in heights_m.chunks_exact(cols.max(1)).enumerate() {
            let row = window.row.saturating_add(r);
            if row >= cut.scene.rows {
                break;
            }
            let (weights, scratch) = weights_of(self.aside, self.cols, cols);
            // The plan guarantees the lengths.
            let _ = self.weights.line(open, r, weights, scratch);
            let (image, coarse_m) = lines.line(row);
            let valid = image.iter().zip(coarse_m).map(|(v, z)| v.is_finite() && z.is_finite()).skip(window.col);
            let at = (row % self.tile.rows.max(1)).saturating_mul(self.cols);
            let sums = part_mut(self.sums, at, self.cols).iter_mut().skip(window.col);
            for (((sum, valid), weight), &height_m) in sums.zip(valid).zip(weights).zip(heights_m) {
                if valid {
                    *sum = if sum.is_nan() { 0.0 } else { *sum } + *weight * f64::from(height_m);
                }
            }
        }
    }

    /// Writes the heights of a line to which all tiles have been added, NaN in voids; then the sums of the line are free for another line.
    pub(super) fn take(&mut self, cut: &Cut, row: usize, out_m: &mut [f32]) {
        self.weigh(cut, row, 0, |_, _, _, _| ());
        let at = (row % self.tile.rows.max(1)).saturating_mul(self.cols);
        let (sums, totals) = (part_mut(self.sums, at, self.cols), part(self.aside, 0, self.cols));
        for ((out_m, sum), total) in out_m.iter_mut().zip(sums).zip(totals) {
            *out_m = (*sum / total) as f32;
            *sum = f64::NAN;
        }
    }

    /// Writes the expected errors of a line. `errors` are those of all tiles.
    pub(super) fn expected(
        &mut self,
        cut: &Cut,
        row: usize,
        lines: &Lines<'_>,
        errors: &Expected<'_>,
        out: LineErrors<'_>,
    ) {
        let (image, coarse_m) = lines.line(row);
        let (tile, cols) = (self.tile, self.cols);
        self.weigh(cut, row, Expected::SUMS, |index, first, weights, sums| {
            let errors = errors.get(cut, tile, index);
            for (col, weight) in (first..cols).zip(weights) {
                for (line, error) in parts(errors.at(item(image, col))).into_iter().enumerate() {
                    if let Some(sum) = sums.get_mut(line * cols + col) {
                        *sum += *weight * f64::from(error);
                    }
                }
            }
        });
        let (totals, rest) = self.aside.split_at_mut_checked(cols).unwrap_or_default();
        for (col, (v, z)) in image.iter().zip(coarse_m).enumerate() {
            let total = item(totals, col);
            let mean = |line: usize| (item(rest, line * cols + col) / total) as f32;
            let [height_m, slope, explained, dark] =
                if v.is_finite() && z.is_finite() { core::array::from_fn(mean) } else { [f32::NAN; 4] };
            put(out.height_m, col, height_m);
            put(out.slope, col, slope);
            put(out.origin, col, Origin::of(explained, dark) as u8);
        }
    }

    /// Adds up the weights of all tiles over a line, in the order in which tiles are added. `each` takes the number of a tile, its first
    /// column, its weights, and `lines` sums of every column that begin at 0.
    fn weigh(&mut self, cut: &Cut, row: usize, lines: usize, mut each: impl FnMut(usize, usize, &[f64], &mut [f64])) {
        part_mut(self.aside, 0, (1 + lines) * self.cols).fill(0.0);
        let across = cut.tiling.shape().cols;
        let first = row.saturating_sub(self.tile.rows) / cut.tiling.stride().rows.max(1);
        let mut made = None;
        for index in first.saturating_mul(across).. {
            let Some(window) = cut.tiling.get(index).filter(|window| window.row <= row) else { break };
            let r = row - window.row;
            if r >= window.rows {
                continue;
            }
            let (totals, rest) = self.aside.split_at_mut_checked(self.cols).unwrap_or_default();
            let (sums, rest) = rest.split_at_mut_checked(lines * self.cols).unwrap_or_default();
            let (weights, scratch) = weights_of(rest, 0, window.cols);
            // Neighbours within a row of tiles have the same weights, except the first and the last tile.
            let open = Open::of(window, cut.scene);
            if made != Some((open, r)) {
                // The plan guarantees the lengths.
                let _ = self.weights.line(open, r, weights, scratch);
                made = Some((open, r));
            }
            for (total, weight) in totals.iter_mut().skip(window.col).zip(weights.iter()) {
                *total += *weight;
            }
            each(index, window.col, weights, sums);
        }
    }
}

/// Returns the memory for a tile's line of weights behind the first `skip` values, and the scratch memory for its computation.
fn weights_of(aside: &mut [f64], skip: usize, cols: usize) -> (&mut [f64], &mut [f64]) {
    let room = part_mut(aside, skip, cols + OverlapWeights::scratch_len(cols));
    room.split_at_mut_checked(cols).unwrap_or_default()
}
