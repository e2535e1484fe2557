//! Means over the cells of a rectangle: squares with the side of a coarse pixel, of which one begins at every half cell.
//!
//! The maps are read in squares of half a cell. Each gives its sums, and their moments about its corner; from those of 4 x 4 follow the mean
//! under a cell's tent and the cell's slopes. Some columns of cells are read together from top to bottom, with the sums over the last four rows
//! of squares: few where memory is small, many where reading each pixel once is worth more.

use crate::mask::is_real;
use crate::part::{head_mut, item, part};
use crate::samples::Samples;
use crate::terrain::PixelSize;

/// Means over a cell: brightness, slope east, slope south.
pub(super) type Cell = [f64; 3];

/// Cells that begin along a cell's side: one at every half cell.
pub(super) const PHASES: usize = 2;
/// Squares of half a cell along the side of a cell's tent.
const TENT: usize = 4;
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

/// A sum over a square; the same weighted by the distance from its left side, from its top, and by both.
type Moments = [f64; 4];

/// Sums over a square of half a cell's side.
#[derive(Debug, Clone, Copy, Default)]
struct Square {
    /// Of the valid pixels' brightness, and of ones.
    bright: Moments,
    weight: Moments,
    /// Of the differences to either side, east and south.
    rise: [f64; 2],
    /// Whether all heights of these differences are valid.
    real: bool,
    /// Number of invalid pixels of the image.
    invalid: u32,
    /// Whether a pixel is lit, and whether one is dark.
    lit: bool,
    dark: bool,
}

/// What a row of a square shows of the image.
#[derive(Debug, Clone, Copy, Default)]
struct Row {
    /// Sums over valid pixels, plain and weighted by the distance from the left.
    bright: [f32; 2],
    weight: [f32; 2],
    invalid: u32,
    lit: bool,
    dark: bool,
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
    /// Whether one of the four squares lies in shadow: it has dark pixels and none that is lit.
    shadow: bool,
}

impl HalfCell {
    /// Joins the squares of a row that a cell's tent covers. The cell has the two in the middle.
    fn of(squares: &[Square; TENT], half: f64) -> Self {
        let [_, b, c, _] = squares;
        // A tent rises by 1 per column up to its middle, and then falls.
        let tents = [(0.0, 1.0), (half, 1.0), (2.0 * half, -1.0), (half, -1.0)];
        let across = |of: fn(&Square) -> Moments| {
            let mut sums = [0.0; 2];
            for (square, (start, rise)) in squares.iter().zip(tents) {
                let [sum, by_col, by_row, by_both] = of(square);
                sums = [sums[0] + (start * sum + rise * by_col), sums[1] + (start * by_row + rise * by_both)];
            }
            sums
        };
        Self {
            bright: across(|square| square.bright),
            weight: across(|square| square.weight),
            rise: [b.rise[0] + c.rise[0], b.rise[1] + c.rise[1]],
            real: b.real && c.real,
            invalid: b.invalid + c.invalid,
            shadow: squares.iter().any(|square| square.dark && !square.lit),
        }
    }
}

impl<S: Samples> Rectangle<'_, S> {
    /// Returns the sums over a square. Outside the cells only brightness counts.
    fn square(&self, top: usize, left: usize, has_slopes: bool) -> Square {
        let mut square = Square { real: true, ..Square::default() };
        for row in 0..self.half {
            let first = (top + row) * self.cols + left;
            let found = self.row(first);
            let from_top = row as f64 + 0.5;
            for (sums, of_row) in [(&mut square.bright, found.bright), (&mut square.weight, found.weight)] {
                let [plain, by_col] = of_row.map(f64::from);
                let of_row = [plain, by_col, from_top * plain, from_top * by_col];
                sums.iter_mut().zip(of_row).for_each(|(sum, v)| *sum += v);
            }
            square.invalid += found.invalid;
            (square.lit, square.dark) = (square.lit | found.lit, square.dark | found.dark);
            if has_slopes {
                self.slopes(first, &mut square);
            }
        }
        square
    }

    /// Adds the differences of heights along a row of a square.
    fn slopes(&self, first: usize, square: &mut Square) {
        let [above, below] = [first - self.cols, first + self.cols].map(|from| part(self.coarse_m, from, self.half));
        let (mut down, mut real) = ([0.0f32; LANES], true);
        for (a, b) in above.chunks(LANES).zip(below.chunks(LANES)) {
            for ((sum, a), b) in down.iter_mut().zip(a).zip(b) {
                *sum += b - a;
                real &= is_real(*a) & is_real(*b);
            }
        }
        // The sum of all differences along a row is that of its ends.
        let ends = [first + self.half, first + self.half - 1, first, first - 1].map(|i| item(self.coarse_m, i));
        let [last, before_last, second, before] = ends;
        square.real &= real && ends.into_iter().all(is_real);
        let [east, south] = &mut square.rise;
        *east += f64::from((last - second) + (before_last - before));
        *south += f64::from(total(down));
    }

    /// Returns what a square's row shows of the image.
    fn row(&self, from: usize) -> Row {
        let (mut sums, mut by_col, mut invalid, mut dark) = ([0.0f32; LANES], [0.0f32; LANES], 0u32, 0u32);
        let mut add = |first: usize, lane: usize, v: f32| {
            let is_real = is_real(v);
            let value = if is_real { v } else { 0.0 };
            sums[lane] += value;
            by_col[lane] += (first as f32 + (lane as f32 + 0.5)) * value;
            invalid += u32::from(!is_real);
            dark += u32::from(is_real & (v < self.dark_below));
        };
        let mut room = [0.0; TOGETHER];
        for first in (0..self.half).step_by(TOGETHER) {
            let room = head_mut(&mut room, TOGETHER.min(self.half - first));
            let (whole, rest) = self.image.line(from + first, room).as_chunks::<LANES>();
            for (values, first) in whole.iter().zip((first..).step_by(LANES)) {
                (0..LANES).for_each(|lane| add(first, lane, values[lane]));
            }
            let first = first + whole.len() * LANES;
            // Small cells have less than a whole group: half of one, then pixel by pixel.
            let (four, last) = rest.as_chunks::<{ LANES / 2 }>();
            four.iter().for_each(|values| (0..LANES / 2).for_each(|lane| add(first, lane, values[lane])));
            last.iter().zip(four.len() * LANES / 2..).for_each(|(v, lane)| add(first, lane & (LANES - 1), *v));
        }
        // All weights are exact.
        let width = self.half as f32;
        let weight = if invalid == 0 { [width, 0.5 * width * width] } else { self.weights(from) };
        let lit = invalid + dark < self.half as u32;
        Row { bright: [total(sums), total(by_col)], weight, invalid, lit, dark: dark > 0 }
    }

    /// Returns the number of a row's valid pixels, and the sum of their distances from the left.
    fn weights(&self, from: usize) -> [f32; 2] {
        let valid = (0..self.half).filter(|i| is_real(self.image.at(from + i)));
        valid.fold([0.0; 2], |[count, by_col], i| [count + 1.0, by_col + (i as f32 + 0.5)])
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
        let shadow = [a, b, c, d].into_iter().any(|half| half.shadow);
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

/// Up to `COLUMNS` columns of cells, of which each begins `2 / APART` half cells after the one before; gives row after row, each half a cell below the
/// one before. `APART` columns further is the cell that begins where one ends.
pub(super) struct CellColumns<'a, S, const COLUMNS: usize, const APART: usize> {
    maps: &'a Rectangle<'a, S>,
    /// First pixel of the first cell.
    left: usize,
    columns: usize,
    /// First row of the next half cell of rows.
    top: usize,
    /// Rows of cells that are left.
    rows: usize,
    halves: [[HalfCell; TENT]; COLUMNS],
}

impl<'a, S: Samples, const COLUMNS: usize, const APART: usize> CellColumns<'a, S, COLUMNS, APART> {
    pub(super) fn new(maps: &'a Rectangle<'a, S>, down: &Places, left: usize, columns: usize) -> Self {
        let top = down.first - maps.half;
        let mut new = Self { maps, left, columns, top, rows: down.count, halves: [Default::default(); COLUMNS] };
        (0..TENT - 1).for_each(|i| new.read(i > 0));
        new
    }

    /// Reads half a cell of rows.
    fn read(&mut self, has_slopes: bool) {
        let (maps, step) = (self.maps, PHASES / APART);
        let mut squares = [Square::default(); TENT];
        // The first of a cell's tent lies before it, the last behind it.
        let last = step * (self.columns - 1) + TENT - 1;
        for i in 0..=last {
            squares.rotate_left(1);
            let [.., newest] = &mut squares;
            let is_inside = 0 < i && i < last;
            *newest = maps.square(self.top, self.left - maps.half + i * maps.half, has_slopes && is_inside);
            let column = i.checked_sub(TENT - 1).filter(|i| i % step == 0).map(|i| i / step);
            if let Some(halves) = column.and_then(|column| self.halves.get_mut(column)) {
                halves.rotate_left(1);
                let [.., newest] = halves;
                *newest = HalfCell::of(&squares, maps.half as f64);
            }
        }
        self.top += maps.half;
    }
}

impl<S: Samples, const COLUMNS: usize, const APART: usize> Iterator for CellColumns<'_, S, COLUMNS, APART> {
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
            let squares = [1, 2, 3, 4].map(|left| maps.square(1, left, true));
            let half = HalfCell::of(&squares, 1.0);
            (squares[0].lit, squares[0].dark, maps.cell(&[half; 4]).is_some())
        };
        assert_eq!(cell(0.5, 0.5), (true, false, true));
        assert_eq!(cell(0.499, 0.5), (false, true, false));
        assert_eq!(cell(f32::NAN, 0.5), (false, false, true));
    }
}
