//! Linear photoclinometry: the relief that explains the part of an image that the coarse DTM does not explain.
//!
//! For small slopes, contrast is the slope along the light times the light's strength ([`crate::norm::Light`]). Of all reliefs h, in
//! pixels, the result is the one that minimises
//!
//! ```text
//! sum (u . grad h - r)^2 + w |grad h|^2 + (h / (1.4 coarse_px))^2
//! ```
//!
//! where u is the direction of the light, and r is the slope along it that the image shows and the coarse DTM does not have. The second
//! term determines slopes across the light; the third keeps the long waves of the coarse DTM. The weight w is [`SMOOTHNESS`], or larger
//! where less of the contrast is relief ([`Share`]). In frequencies the solution is one
//! multiplication, so the work is two Fourier transforms for every ground. The network takes the sum of coarse DTM and relief and corrects
//! it (our choice; the paper gives the coarse DTM alone), because a network of small convolutions learns the integration along the light
//! slowly.

mod expected;
mod fft;
mod guide;
mod share;
mod spectrum;
mod work;

pub use expected::{Errors, ExpectedErrors, Origin};
pub(crate) use guide::GuideForm;
pub use guide::{Guide, GuideInput, LIMIT, MAPS, SLOPED_MAPS, Weight};
pub use share::{Contrast, OCTAVES, Share};

use crate::error::LengthError;
use crate::mask::Mean;
use crate::norm::{Light, Shading};
use crate::part::{copy, head, head_mut, item, part, part_mut, put};
use crate::tile::Shape;
use core::ops::Range;
use fft::{GROUP, Lanes, Order, Way, transform};
use share::Power;
use spectrum::{Gain, filter, power};
pub(crate) use work::{FieldWork, Task};

/// Weight of slopes across the light, relative to the misfit along it (our choice: of 0.02 to 0.1 the best on synthetic scenes).
pub const SMOOTHNESS: f32 = 0.05;
/// Length, in coarse pixels, over which a height weighs as much as a slope (our choice: with 1, waves of one to two coarse pixels are 2 to 5 %
/// flatter; with 2, heights gain less).
const STIFFNESS_COARSE_PX: f32 = 1.4;
/// Length of a dark stretch of a row, in coarse pixels, from which on it hides the ground: the coarse DTM shows such ground better (our choice:
/// with 1 coarse pixel, slopes of ray-traced scenes are 2 % worse).
const HIDDEN_COARSE_PX: f32 = 4.0;
/// Smallest number of pixels by which a tile is continued on either side, mirrored, so that opposite sides do not touch.
const MARGIN_PX: usize = 24;
/// Number of rows that are transformed together, in pairs as real and imaginary part. The margin has space for them.
const TOGETHER: usize = 2 * GROUP;
const _: () = assert!(TOGETHER <= MARGIN_PX);
/// Number of columns that are transformed together.
const COLUMNS: usize = 4 * GROUP;

/// Sizes for tiles of one shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Photoclinometry {
    tile: Shape,
    rows: Order,
    cols: Order,
}

/// Writes rows of a map, by their number.
pub trait Rows: Fn(usize, &mut [f32]) {}

impl<T: Fn(usize, &mut [f32])> Rows for T {}

/// A tile as its relief is found from it. `B` writes a row of the image, NaN where it is invalid; `C` writes a row of the coarse DTM in
/// pixels.
#[derive(Debug, Clone, Copy)]
pub struct LitTile<'a, B, C> {
    /// Rows of the image.
    pub brightness: B,
    /// Rows of the coarse DTM.
    pub coarse: C,
    /// From brightness to slope.
    pub shading: &'a Shading,
    /// The light of the tile.
    pub light: Light,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub coarse_px: f32,
}

impl Photoclinometry {
    /// Makes the plan for tiles of this shape.
    #[must_use]
    pub fn new(tile: Shape) -> Self {
        let padded = |n: usize| Order::at_least(n.saturating_add(2 * MARGIN_PX));
        Self { tile, rows: padded(tile.rows), cols: padded(tile.cols) }
    }

    /// Number of values of scratch memory: the padded tile, and tables.
    #[must_use]
    pub fn scratch_len(&self) -> usize {
        self.field_len() + 2 * self.rows.len() + 2 * self.cols.len()
    }

    fn field_len(&self) -> usize {
        self.rows.len() * self.cols.len()
    }

    /// Returns the first row and column of the tile in the padded field.
    fn corner(&self) -> (usize, usize) {
        ((self.rows.len() - self.tile.rows) / 2, (self.cols.len() - self.tile.cols) / 2)
    }

    /// Finds the relief of a tile. `share` weighs slopes, and the relief is multiplied by `trust`.
    ///
    /// # Errors
    /// [`LengthError`] if `scratch` is shorter than [`Self::scratch_len`].
    pub fn relief<'s>(
        &self,
        tile: &LitTile<'_, impl Rows, impl Rows>,
        share: &Share,
        trust: f32,
        scratch: &'s mut [f32],
    ) -> Result<Relief<'s>, LengthError> {
        let mut work = FieldWork::default();
        while self.advance(&mut work, &Task::Relief { share, trust }, tile, scratch)?.is_some() {}
        Ok(self.found(scratch))
    }

    /// Returns the relief that the work on a field has left in the scratch memory.
    pub(crate) fn found<'s>(&self, scratch: &'s [f32]) -> Relief<'s> {
        let ((top, left), stride) = (self.corner(), self.cols.len());
        Relief { field: head(scratch, self.field_len()), first: top * stride + left, stride, tile: self.tile }
    }

    /// Measures the contrast of a tile: the slopes along the light that the coarse DTM does not
    /// explain. They are tapered towards the tile's edges (by a raised cosine over a quarter of a side), so that no wave is cut.
    ///
    /// # Errors
    /// [`LengthError`] if `scratch` is shorter than [`Self::scratch_len`].
    pub fn contrast(
        &self,
        tile: &LitTile<'_, impl Rows, impl Rows>,
        scratch: &mut [f32],
    ) -> Result<Contrast, LengthError> {
        let mut work = FieldWork::default();
        while self.advance(&mut work, &Task::Contrast, tile, scratch)?.is_some() {}
        Ok(self.measured(&work))
    }

    /// Returns the contrast that the work on a field has measured.
    pub(crate) fn measured(&self, work: &FieldWork) -> Contrast {
        // By Parseval's theorem the power of all waves is the number of values times the sum of squares. Half of the waves are summed.
        let (values, squares) = (self.field_len() as f64, f64::from(work.squares));
        Contrast::new(work.power, squares / values, 2.0 / (values * squares))
    }

    /// Returns the direction of a light as a unit vector.
    fn direction(light: Light) -> [f32; 2] {
        let strength = light.strength();
        [light.east / strength, light.south / strength]
    }

    /// Divides the scratch memory.
    fn field<'s>(&self, scratch: &'s mut [f32]) -> Result<Field<'s>, LengthError> {
        let found = scratch.len();
        let scratch =
            scratch.get_mut(..self.scratch_len()).ok_or(LengthError { expected: self.scratch_len(), found })?;
        let (field, tables) = scratch.split_at_mut_checked(self.field_len()).unwrap_or_default();
        let (row_roots, col_roots) = tables.split_at_mut_checked(2 * self.rows.len()).unwrap_or_default();
        Ok(Field { field, row_roots, col_roots })
    }

    /// Returns the places of the numbers of some columns, once rows are transformed.
    fn columns(&self, block: usize) -> Lanes {
        let (half, first) = (self.cols.len() / 2, block * COLUMNS);
        Lanes { re: first, im: half + first, stride: self.cols.len(), count: COLUMNS.min(half.saturating_sub(first)) }
    }

    /// Splits the field into the rows above the tile, which are free while rows are processed, and the rest, which begins with the tile's
    /// rows.
    fn margin<'f>(&self, field: &'f mut [f32]) -> (&'f mut [f32], &'f mut [f32]) {
        field.split_at_mut_checked(self.corner().0 * self.cols.len()).unwrap_or_default()
    }

    /// Writes a row of the slope along the light that the coarse DTM does not explain into the tile's part of the field; NaN where the image is
    /// invalid, or a shadow hides the ground. Adds those of lit ground to `lit`. Rows come in order.
    fn fill_row(&self, field: &mut [f32], tile: &LitTile<'_, impl Rows, impl Rows>, row: usize, lit: &mut Mean) {
        let LitTile { brightness, coarse, shading, light, coarse_px } = tile;
        let ([east, south], strength) = (Self::direction(*light), light.strength());
        let dark_below = shading.dark_below();
        // `as` turns NaN and negative numbers into 0.
        let hidden_px = ((HIDDEN_COARSE_PX * *coarse_px) as usize).max(1);
        let (Shape { rows, cols }, (_, left), width) = (self.tile, self.corner(), self.cols.len());
        let (margin, tile) = self.margin(field);
        // Space for three rows of the coarse DTM and one of the image.
        let (heights, rest) = margin.split_at_mut_checked(3 * cols).unwrap_or_default();
        let bright = head_mut(rest, cols);
        if row == 0 {
            coarse(0, head_mut(heights, cols));
        }
        let (up, down) = (row.saturating_sub(1), (row + 1).min(rows - 1));
        if down > row {
            coarse(down, part_mut(heights, down % 3 * cols, cols));
        }
        brightness(row, bright);
        let [above, here, below] = [up, row, down].map(|row| part(heights, row % 3 * cols, cols));
        let out = part_mut(tile, row * width + left, cols);
        let per_row = 1.0 / (down - up).max(1) as f32;
        let missing = |across: f32, along: f32, v: f32| {
            // NaN where the image is invalid.
            let slope = shading.along(v, strength) - (east * across + south * (along * per_row));
            // A dark slope may be steeper than its brightness says. If the coarse DTM is steeper, nothing remains to be explained.
            if v < dark_below { slope.min(0.0) } else { slope }
        };
        let columns = out.iter_mut().zip(bright.iter()).zip(above.iter().zip(below));
        for (((out, &v), (a, b)), z) in columns.skip(1).zip(here.windows(3)) {
            *out = missing(0.5 * (z[2] - z[0]), b - a, v);
        }
        // The first and the last column have one neighbour.
        let last = cols.saturating_sub(1);
        for (col, before, after) in [(0, 0, 1), (last, cols.saturating_sub(2), last)] {
            let across = item(here, after.min(last)) - item(here, before);
            put(out, col, missing(across, item(below, col) - item(above, col), item(bright, col)));
        }
        hide(out, bright, dark_below, hidden_px);
        for (v, _) in out.iter().zip(bright.iter()).filter(|(v, bright)| !v.is_nan() && **bright >= dark_below) {
            lit.sum += f64::from(*v);
            lit.count += 1;
        }
    }

    /// Subtracts the mean over lit ground from the slopes; where they are unknown they become 0.
    fn level(&self, field: &mut [f32], lit: Mean) {
        let (Shape { rows, cols }, (_, left), width) = (self.tile, self.corner(), self.cols.len());
        let mean = (lit.sum / lit.count.max(1) as f64) as f32;
        for line in self.margin(field).1.chunks_exact_mut(width.max(1)).take(rows) {
            part_mut(line, left, cols).iter_mut().for_each(|v| *v = if v.is_nan() { 0.0 } else { *v - mean });
        }
    }

    /// Returns the room for rows side by side, and the tile's rows of a block.
    fn block<'f>(&self, field: &'f mut [f32], block: usize) -> (&'f mut [f32], &'f mut [f32]) {
        let (width, rows) = (self.cols.len(), self.tile.rows);
        let (margin, tile) = self.margin(field);
        let first = (block * TOGETHER).min(rows);
        (head_mut(margin, TOGETHER * width), part_mut(tile, first * width, TOGETHER.min(rows - first) * width))
    }

    /// Continues the tile's rows to both sides by their mirror image.
    fn mirror_cols(&self, field: &mut [f32]) {
        let (Shape { rows, cols }, (_, left), width) = (self.tile, self.corner(), self.cols.len());
        let (_, tile) = self.margin(field);
        for line in tile.chunks_exact_mut(width.max(1)).take(rows) {
            for col in (0..left).chain(left + cols..width) {
                let from = item(line, left + mirrored(col as isize - left as isize, cols));
                put(line, col, from);
            }
        }
    }

    /// Multiplies the tile by its taper, and continues its rows by zeros. Returns the sum of the squares of the taper.
    fn taper(&self, field: &mut [f32]) -> f32 {
        let (Shape { rows, cols }, (_, left), width) = (self.tile, self.corner(), self.cols.len());
        let (margin, tile) = self.margin(field);
        let across = head_mut(margin, cols);
        for (col, weight) in across.iter_mut().enumerate() {
            *weight = raised_cosine(col, cols);
        }
        let squares = |n: usize| (0..n).map(|i| raised_cosine(i, n) * raised_cosine(i, n)).sum::<f32>();
        for (row, line) in tile.chunks_exact_mut(width.max(1)).take(rows).enumerate() {
            let down = raised_cosine(row, rows);
            head_mut(line, left).fill(0.0);
            part_mut(line, left + cols, width - left - cols).fill(0.0);
            let weights = across.iter();
            part_mut(line, left, cols).iter_mut().zip(weights).for_each(|(v, weight)| *v *= down * weight);
        }
        squares(rows) * squares(cols)
    }

    /// Sets the rows above and below the tile to zero.
    fn clear_margins(&self, field: &mut [f32]) {
        let (rows, (top, _), width) = (self.tile.rows, self.corner(), self.cols.len());
        let (above, rest) = self.margin(field);
        above.fill(0.0);
        part_mut(rest, rows * width, (self.rows.len() - top - rows) * width).fill(0.0);
    }

    /// Returns the wave number of frequency `k` of `n`, radians per pixel.
    #[inline(always)]
    fn wave(k: usize, n: usize) -> f32 {
        // Processors with vectors turn shorter integers into floats side by side.
        let (k, n) = (k as i32, n as i32);
        let signed = if 2 * k > n { k as f32 - n as f32 } else { k as f32 };
        core::f32::consts::TAU * signed / n as f32
    }

    /// Adds the power of each octave, by direction: block 0 has the first column, the others some rows each. Of a wave and its opposite, one
    /// counts.
    fn power(&self, field: &[f32], block: usize, octaves: &mut [Power; OCTAVES]) {
        let (height, width, half) = (self.rows.len(), self.cols.len(), self.cols.len() / 2);
        let Some(rows) = self.spectrum(block) else {
            // The first column contains two real sequences; its frequency 0 is half their sum.
            for m in 1..height.div_ceil(2) {
                let (p, q) = (self.rows.place(m) * width, self.rows.place(height - m) * width);
                let at = |place: usize| item(field, place);
                let (re, im) = (0.5 * (at(p) + at(q)), 0.5 * (at(p + half) - at(q + half)));
                let (down, power) = (Self::wave(m, height), re * re + im * im);
                if let Some(octave) = octaves.get_mut(share::octave(down * down)) {
                    // Across the rows' direction.
                    octave.add(power, -power, 0.0);
                }
            }
            return;
        };
        for m in rows.filter(|m| 2 * m != height) {
            let (down, line) = (Self::wave(m, height), part(field, self.rows.place(m) * width, width));
            let (re, im) = line.split_at_checked(half).unwrap_or_default();
            power(re, im, (down, width), octaves);
        }
    }

    /// Returns the rows of the spectrum in a block; `None` for block 0.
    fn spectrum(&self, block: usize) -> Option<Range<usize>> {
        let first = block.checked_sub(1)? * TOGETHER;
        Some(first..(first + TOGETHER).min(self.rows.len()))
    }

    /// Continues the tile's rows, or their transforms, above and below by their mirror image.
    fn mirror_rows(&self, field: &mut [f32]) {
        let (rows, (top, _), width) = (self.tile.rows, self.corner(), self.cols.len());
        let (above, rest) = self.margin(field);
        let (tile, below) = rest.split_at_mut_checked(rows * width).unwrap_or_default();
        let line = |row: isize| part(tile, mirrored(row, rows) * width, width);
        for row in 0..top {
            copy(part_mut(above, row * width, width), line(row as isize - top as isize));
        }
        for row in rows..self.rows.len() - top {
            copy(part_mut(below, (row - rows) * width, width), line(row as isize));
        }
    }

    /// Transforms the tile's rows in pairs, as real and imaginary part. Afterwards each row contains its own half spectrum: real parts of
    /// frequencies 0 to half - 1, then the imaginary parts. The first imaginary part is 0, so frequency half takes its place. Blocks of rows come
    /// in order.
    fn rows_forward(&self, field: &mut [f32], roots: &[f32], block: usize) {
        let (width, half) = (self.cols.len().max(1), self.cols.len() / 2);
        let (room, rows) = self.block(field, block);
        if block == 0 {
            room.fill(0.0);
        }
        {
            // Lanes beyond the last row contain any values; their transforms are not used.
            for (row, line) in rows.chunks_exact(width).enumerate() {
                let lane = row / 2 + row % 2 * GROUP;
                room.iter_mut().skip(lane).step_by(TOGETHER).zip(line).for_each(|(to, from)| *to = *from);
            }
            transform(room, &self.cols, roots, ROOM, Way::Forward);
            for k in 0..=half {
                let places = [k, (width - k) % width].map(|k| self.cols.place(k) * TOGETHER);
                let [p, q] = places.map(|at| part(room, at, TOGETHER));
                for (pair, lines) in rows.chunks_mut((2 * width).max(1)).enumerate() {
                    // Z(k) + conj Z(-k) and -i (Z(k) - conj Z(-k)), over 2.
                    let [x, y] = [pair, GROUP + pair].map(|lane| [item(p, lane), item(q, lane)]);
                    let [a, b, c, d] = [x[0] + x[1], y[0] - y[1], y[0] + y[1], x[1] - x[0]].map(|v| 0.5 * v);
                    // Frequency half is real.
                    put(lines, k, a);
                    put(lines, width + k, c);
                    if k > 0 && k < half {
                        put(lines, half + k, b);
                        put(lines, width + half + k, d);
                    }
                }
            }
        }
    }

    /// Inverts [`Self::rows_forward`] up to a factor of the length; pixels beside the tile are not restored.
    fn rows_backward(&self, field: &mut [f32], roots: &[f32], block: usize) {
        let (width, half) = (self.cols.len().max(1), self.cols.len() / 2);
        let (Shape { cols, .. }, (_, left)) = (self.tile, self.corner());
        let (room, rows) = self.block(field, block);
        {
            for k in 0..=half {
                let inner = k > 0 && k < half;
                let [p, q] = [k, (width - k) % width].map(|k| self.cols.place(k) * TOGETHER);
                for (pair, lines) in rows.chunks((2 * width).max(1)).enumerate() {
                    let (a, c) = (item(lines, k), item(lines, width + k));
                    let (b, d) =
                        if inner { (item(lines, half + k), item(lines, width + half + k)) } else { (0.0, 0.0) };
                    // X1 + i X2, and conj X1 + i conj X2.
                    put(room, p + pair, a - d);
                    put(room, p + GROUP + pair, b + c);
                    put(room, q + pair, a + d);
                    put(room, q + GROUP + pair, c - b);
                }
            }
            transform(room, &self.cols, roots, ROOM, Way::Backward);
            for (row, line) in rows.chunks_exact_mut(width).enumerate() {
                let lane = row / 2 + row % 2 * GROUP;
                let from = room.iter().skip(left * TOGETHER + lane).step_by(TOGETHER);
                part_mut(line, left, cols).iter_mut().zip(from).for_each(|(to, from)| *to = *from);
            }
        }
    }

    /// Multiplies the spectrum by -i D / (D^2 + w K^2 + 1 / (1.4 coarse_px)^2), where D is the wave number along the light, K the total wave
    /// number, and w the weight of slopes; by the trust; and by the missing factors of the transforms.
    ///
    /// Block 0 has the first column, the others some rows each.
    fn filter(
        &self,
        field: &mut [f32],
        direction: [f32; 2],
        coarse_px: f32,
        (share, trust): (&Share, f32),
        block: usize,
    ) {
        let (height, width, half) = (self.rows.len(), self.cols.len(), self.cols.len() / 2);
        let scale = trust / (height * width) as f32;
        // At least one pixel, because level ground far from any coarse pixel has no scale of its own.
        let length_px = STIFFNESS_COARSE_PX * coarse_px.max(1.0);
        let stiffness = 1.0 / (length_px * length_px);
        let gain = Gain { direction, weights: &share.weights(), scale, stiffness };
        let Some(rows) = self.spectrum(block) else {
            return self.filter_first(field, |down| {
                let [weight] = gain.weights.of(&[down * down]);
                gain.of([0.0, down], down * down, weight)
            });
        };
        for m in rows {
            let (down, line) = (Self::wave(m, height), part_mut(field, self.rows.place(m) * width, width));
            let (re, im) = line.split_at_mut_checked(half).unwrap_or_default();
            // The highest frequency has no sign, so an odd filter makes it 0.
            let is_removed = 2 * m == height;
            filter(re, im, (down, width), gain, is_removed);
        }
    }

    /// Filters the first column, which contains the spectra of two real sequences: frequency 0, which is filtered, and the highest
    /// frequency, which becomes 0.
    fn filter_first(&self, field: &mut [f32], gain: impl Fn(f32) -> f32) {
        let (height, width, half) = (self.rows.len(), self.cols.len(), self.cols.len() / 2);
        for m in 0..=height / 2 {
            let n = (height - m) % height.max(1);
            let (p, q) = (self.rows.place(m) * width, self.rows.place(n) * width);
            let at = |place: usize| item(field, place);
            let (re, im) = (0.5 * (at(p) + at(q)), 0.5 * (at(p + half) - at(q + half)));
            let gain = if 2 * m == height { 0.0 } else { gain(Self::wave(m, height)) };
            let (re, im) = (im * gain, -re * gain);
            put(field, p, re);
            put(field, p + half, im);
            if n != m {
                put(field, q, re);
                put(field, q + half, -im);
            }
        }
    }
}

/// Rows side by side in the margin: the real parts of one number, then its imaginary parts, number after number.
const ROOM: Lanes = Lanes { re: 0, im: GROUP, stride: TOGETHER, count: GROUP };

/// The scratch memory: the padded tile, and tables of its rows and columns.
struct Field<'s> {
    field: &'s mut [f32],
    row_roots: &'s mut [f32],
    col_roots: &'s mut [f32],
}

/// Sets the slopes of a row to NaN where `hidden_px` or more pixels side by side are dark.
fn hide(slopes: &mut [f32], brightness: &[f32], dark_below: f32, hidden_px: usize) {
    // Most rows have no dark pixel, which a processor with vectors sees at once.
    if !brightness.iter().fold(false, |any, v| any | (*v < dark_below)) {
        return;
    }
    let mut dark = 0;
    for end in 0..=brightness.len() {
        if brightness.get(end).is_some_and(|v| *v < dark_below) {
            dark += 1;
            continue;
        }
        if dark >= hidden_px {
            part_mut(slopes, end - dark, dark).fill(f32::NAN);
        }
        dark = 0;
    }
}

/// Returns the weight of sample `i` of `n`: 1 in the middle half, falling to 0 over the outer quarters.
fn raised_cosine(i: usize, n: usize) -> f32 {
    let from_edge = i.min(n.saturating_sub(1).saturating_sub(i)) as f32 + 0.5;
    let part = from_edge / (0.25 * n.max(1) as f32);
    if part >= 1.0 { 1.0 } else { 0.5 - 0.5 * libm::cosf(core::f32::consts::PI * part) }
}

/// Returns the index of the sample that stands for sample `i` beyond the ends of `n` samples; the end sample is not repeated.
fn mirrored(i: isize, n: usize) -> usize {
    let period = 2 * (n.max(2) - 1);
    let i = i.rem_euclid(period.max(1) as isize) as usize;
    i.min(period - i).min(n.saturating_sub(1))
}

/// A tile's relief, in pixels, stored in the scratch memory.
#[derive(Debug)]
pub struct Relief<'s> {
    field: &'s [f32],
    first: usize,
    stride: usize,
    tile: Shape,
}

impl Relief<'_> {
    /// Returns the relief at `len` pixels of a row of the tile from a row-major index on, in pixels; an empty slice beyond the tile.
    #[must_use]
    #[inline]
    pub fn part(&self, index: usize, len: usize) -> &[f32] {
        let cols = self.tile.cols.max(1);
        part(self.field, self.first + index / cols * self.stride + index % cols, len)
    }
}

#[cfg(test)]
mod tests;
