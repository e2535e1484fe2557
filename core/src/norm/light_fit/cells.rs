//! Means over the cells of a rectangle: squares with the side of a coarse pixel, of which one begins at every half cell.
//!
//! Cells overlap, so each row of the maps is read for several of them. Four columns of cells are read from top to bottom, and keep
//! the sums over the last four half cells of rows: no more is needed for the tents of its cells.

use crate::mask::is_real;
use crate::part::{copy, head_mut, item, part};
use crate::samples::Samples;
use crate::terrain::PixelSize;

/// Means over a cell: brightness, slope east, slope south.
pub(super) type Cell = [f64; 3];

/// Columns of cells that are read together: as wide as the widest square.
pub(super) const COLUMNS: usize = 4;
/// Cells that begin along a cell's side: one at every half cell.
const PHASES: usize = 2;
/// Greatest share of a cell's pixels of the image that may be invalid, as one over this number: scattered dead or saturated pixels, or the edge of
/// a void (our choice).
const INVALID_SHARE: u32 = 8;
/// Samples of a row that are read together.
const TOGETHER: usize = 64;
/// Sums that are added side by side, so that processors with vectors are faster. The result is the same on all.
const LANES: usize = 8;

/// Returns the mean of four cells.
#[inline]
pub(super) fn mean_of(cells: &[Cell; 4]) -> Cell {
    let mut mean = [0.0; 3];
    for cell in cells {
        mean.iter_mut().zip(cell).for_each(|(mean, v)| *mean += 0.25 * v);
    }
    mean
}

/// The places of cells along a side of a rectangle: as many as fit with their tents, about its middle.
pub(super) struct Places {
    first: usize,
    step: usize,
    count: usize,
}

impl Places {
    /// Returns the places along `pixels` for cells of a side; `None` if none fits.
    pub(super) fn of(pixels: usize, side: usize) -> Option<Self> {
        let step = side / PHASES;
        let spare = pixels.checked_sub(2 * side).filter(|_| step > 0)?;
        Some(Self { first: step + spare % step / 2, step, count: spare / step + 1 })
    }

    /// Returns the first pixel of a cell.
    pub(super) fn at(&self, place: usize) -> usize {
        self.first + self.step * place
    }

    /// Returns the number of places for a square of so many cells.
    pub(super) fn count(&self, cells: usize) -> usize {
        self.count.saturating_sub(PHASES * (cells - 1))
    }

    /// Returns the weight of a square of so many cells: squares overlap, and count for as many as would fill the same ground side by side.
    pub(super) fn share(&self, cells: usize) -> f64 {
        let count = self.count(cells).max(1) as f64;
        (1.0 + (count - 1.0) / (PHASES * cells) as f64) / count
    }
}

/// The maps of a rectangle, and half the side of its cells, pixels.
pub(super) struct Rectangle<'a, S> {
    pub(super) image: S,
    pub(super) coarse_m: &'a [f32],
    pub(super) cols: usize,
    pub(super) pixel: PixelSize,
    pub(super) half: usize,
    /// Brightness below which a pixel is dark.
    pub(super) dark_below: f32,
}

/// Sums for one column of cells, over as many rows as half a cell has.
#[derive(Debug, Clone, Copy, Default)]
struct HalfCell {
    /// Brightness under the tent across the column: its sum over rows, and the same weighted by the row's distance from the top.
    bright: [f64; 2],
    /// The weights of the pixels that counted, likewise.
    weight: [f64; 2],
    /// Sums of the differences to either side, east and south, over the cell's columns.
    rise: [f64; 2],
    /// Whether all heights of the cell's columns are valid.
    real: bool,
    /// Number of invalid pixels of the image in the cell's columns.
    invalid: u32,
    /// Whether a pixel is lit, and whether one is dark, in each quarter of the tent's width: half a cell.
    lit: [bool; 4],
    dark: [bool; 4],
}

impl<S: Samples> Rectangle<'_, S> {
    /// Returns the sums over half a cell of rows, for a column of cells whose first pixel is `left`. Above and below the cells only
    /// brightness counts.
    fn half(&self, top: usize, left: usize, has_slopes: bool) -> HalfCell {
        let mut half = HalfCell { real: true, ..HalfCell::default() };
        for row in 0..self.half {
            let first = (top + row) * self.cols + left;
            let (width, from) = (4 * self.half, first - self.half);
            let from_top = row as f64 + 0.5;
            let [bright, weight] = self.tent(from, width).map(f64::from);
            for ([sum, moment], of_row) in [(&mut half.bright, bright), (&mut half.weight, weight)] {
                *sum += of_row;
                *moment += from_top * of_row;
            }
            for (quarter, (lit, dark)) in half.lit.iter_mut().zip(&mut half.dark).enumerate() {
                let from = from + quarter * self.half;
                let mut pixels = (from..from + self.half).map(|i| self.image.at(i)).filter(|v| is_real(*v));
                // Most squares show at once that they are lit.
                *lit = *lit
                    || pixels.any(|v| {
                        let is_dark = v < self.dark_below;
                        *dark |= is_dark;
                        !is_dark
                    });
            }
            if has_slopes {
                self.slopes(first, &mut half);
            }
        }
        half
    }

    /// Adds the differences of heights along a row of a cell's columns, and counts the image's invalid pixels.
    fn slopes(&self, first: usize, half: &mut HalfCell) {
        let side = 2 * self.half;
        let [above, below] = [first - self.cols, first + self.cols].map(|from| part(self.coarse_m, from, side));
        let (mut down, mut real) = ([0.0f32; LANES], true);
        for (a, b) in above.chunks(LANES).zip(below.chunks(LANES)) {
            for ((sum, a), b) in down.iter_mut().zip(a).zip(b) {
                *sum += b - a;
                real &= is_real(*a) & is_real(*b);
            }
        }
        let mut room = [0.0; TOGETHER];
        for from in (0..side).step_by(TOGETHER) {
            let room = head_mut(&mut room, TOGETHER.min(side - from));
            half.invalid += self.image.line(first + from, room).iter().map(|v| u32::from(!is_real(*v))).sum::<u32>();
        }
        // The sum of all differences along a row is that of its ends.
        let ends = [first + side, first + side - 1, first, first - 1].map(|i| item(self.coarse_m, i));
        let [last, before_last, second, before] = ends;
        half.real &= real && ends.into_iter().all(is_real);
        let [east, south] = &mut half.rise;
        *east += f64::from((last - second) + (before_last - before));
        *south += f64::from(total(down));
    }

    /// Returns the sum of a row's valid pixels under a tent over all of them, and the sum of their weights.
    fn tent(&self, from: usize, width: usize) -> [f32; 2] {
        let (mut sums, mut weights, last) = ([0.0f32; LANES], [0.0f32; LANES], width as f32);
        let mut add = |first: usize, values: &[f32; LANES]| {
            for lane in 0..LANES {
                // All these numbers are exact.
                let from_left = first as f32 + (lane as f32 + 0.5);
                let (v, is_real) = (values[lane], is_real(values[lane]));
                let weight = if is_real { from_left.min(last - from_left) } else { 0.0 };
                sums[lane] += weight * if is_real { v } else { 0.0 };
                weights[lane] += weight;
            }
        };
        let mut room = [0.0; TOGETHER];
        for first in (0..width).step_by(TOGETHER) {
            let room = head_mut(&mut room, TOGETHER.min(width - first));
            let (whole, rest) = self.image.line(from + first, room).as_chunks::<LANES>();
            whole.iter().zip((first..).step_by(LANES)).for_each(|(values, first)| add(first, values));
            if !rest.is_empty() {
                let mut values = [f32::NAN; LANES];
                copy(head_mut(&mut values, rest.len()), rest);
                add(first + whole.len() * LANES, &values);
            }
        }
        [total(sums), total(weights)]
    }

    /// Returns the cell that two half cells of rows contain, with those above and below for its tent. `None` if a height is invalid, too many
    /// pixels of its image are ([`INVALID_SHARE`]), or one of the sixteen squares under its tent lies in shadow.
    fn cell(&self, [a, b, c, d]: &[HalfCell; 4]) -> Option<Cell> {
        let half = self.half as f64;
        // A tent over rows rises by 1 per row up to its middle, and then falls.
        let tent = |of: fn(&HalfCell) -> [f64; 2]| {
            let [[_, a], [b, of_b], [c, of_c], [d, of_d]] = [a, b, c, d].map(of);
            a + (half * b + of_b) + (2.0 * half * c - of_c) + (half * d - of_d)
        };
        let (bright, weight) = (tent(|half| half.bright), tent(|half| half.weight));
        let is_shadow = |half: &HalfCell| half.lit.iter().zip(half.dark).any(|(lit, dark)| dark && !lit);
        let shadow = [a, b, c, d].into_iter().any(is_shadow);
        let side = 2 * self.half as u32;
        let seen = INVALID_SHARE * (b.invalid + c.invalid) <= side * side;
        let count = 8.0 * half * half;
        let [[east_b, south_b], [east_c, south_c]] = [b.rise, c.rise];
        let slopes = [(east_b + east_c) / count / self.pixel.col_m, (south_b + south_c) / count / self.pixel.row_m];
        let [east, south] = slopes;
        (b.real && c.real && seen && !shadow && weight > 0.0).then_some([bright / weight, east, south])
    }
}

#[inline]
fn total(lanes: [f32; LANES]) -> f32 {
    lanes.into_iter().sum()
}

/// Four columns of cells, side by side, or fewer; gives row after row, each half a cell below the one before.
pub(super) struct CellColumns<'a, S> {
    maps: &'a Rectangle<'a, S>,
    /// First pixel of the first cell.
    left: usize,
    columns: usize,
    /// First row of the next half cell of rows.
    top: usize,
    /// Rows of cells that are left.
    rows: usize,
    halves: [[HalfCell; 4]; COLUMNS],
}

impl<'a, S: Samples> CellColumns<'a, S> {
    pub(super) fn new(maps: &'a Rectangle<'a, S>, down: &Places, left: usize, columns: usize) -> Self {
        let top = down.first - maps.half;
        let mut new = Self { maps, left, columns, top, rows: down.count, halves: Default::default() };
        (0..3).for_each(|i| new.read(i > 0));
        new
    }

    /// Reads half a cell of rows.
    fn read(&mut self, has_slopes: bool) {
        let side = 2 * self.maps.half;
        for (column, halves) in self.halves.iter_mut().enumerate().take(self.columns) {
            halves.rotate_left(1);
            let [.., newest] = halves;
            *newest = self.maps.half(self.top, self.left + side * column, has_slopes);
        }
        self.top += self.maps.half;
    }
}

impl<S: Samples> Iterator for CellColumns<'_, S> {
    type Item = [Option<Cell>; COLUMNS];

    fn next(&mut self) -> Option<Self::Item> {
        self.rows = self.rows.checked_sub(1)?;
        // The last half cell lies below all cells.
        self.read(self.rows > 0);
        let mut row = [None; COLUMNS];
        for (cell, halves) in row.iter_mut().zip(&self.halves).take(self.columns) {
            *cell = self.maps.cell(halves);
        }
        Some(row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_dark_below_the_limit_and_where_none_is_valid_is_no_shadow() {
        let cell = |left: f32, others: f32| {
            let image: [f32; 8 * 8] = core::array::from_fn(|i| if i % 8 == 1 { left } else { others });
            let pixel = PixelSize::square(1.0);
            let maps =
                Rectangle { image: &image[..], coarse_m: &[0.0; 8 * 8], cols: 8, pixel, half: 1, dark_below: 0.5 };
            let half = maps.half(1, 2, true);
            (half.lit[0], half.dark[0], maps.cell(&[half; 4]).is_some())
        };
        assert_eq!(cell(0.5, 0.5), (true, false, true));
        assert_eq!(cell(0.499, 0.5), (false, true, false));
        assert_eq!(cell(f32::NAN, 0.5), (false, false, true));
    }
}
