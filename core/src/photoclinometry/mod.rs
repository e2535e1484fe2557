//! Linear photoclinometry: the relief that explains what the coarse DTM leaves unexplained of an image.
//!
//! For small slopes, contrast is the slope along the light times the light's strength ([`crate::norm::Light`]). Of all reliefs h,
//! in pixels, the one is taken that makes
//!
//! ```text
//! sum (u . grad h - r)^2 + SMOOTHNESS |grad h|^2 + (h / coarse_px)^2
//! ```
//!
//! smallest: u is the direction of the light, r the slope along it that the image shows and the coarse DTM does not have. The
//! second term fills in what lies across the light, the third leaves to the coarse DTM what it knows. In frequencies that is one
//! multiplication, so the work is two Fourier transforms, whatever the ground looks like. The network is given the sum of coarse
//! DTM and relief to correct (our choice; the paper gives the coarse DTM alone): integrating along the light is what a network of
//! small convolutions learns slowly.

mod fft;
mod guide;

pub use guide::{Guide, GuideInput, LIMIT, MAPS};

use crate::error::LengthError;
use crate::norm::{Light, Shading};
use crate::part::{copy, head, item, part, part_mut, put};
use fft::{Lanes, Order, Way, transform};

/// Weight of slopes across the light, against the misfit along it (our choice, of 0.02 to 0.1 the best on synthetic scenes).
pub const SMOOTHNESS: f32 = 0.05;
/// Pixels by which a tile is at least continued on either side, mirrored, so that opposite sides do not touch.
const MARGIN_PX: usize = 24;

/// Sizes for tiles of one shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Photoclinometry {
    tile: (usize, usize),
    rows: Order,
    cols: Order,
}

impl Photoclinometry {
    /// For tiles of rows x columns.
    #[must_use]
    pub fn new(tile: (usize, usize)) -> Self {
        let padded = |n: usize| Order::at_least(n.saturating_add(2 * MARGIN_PX));
        Self { tile, rows: padded(tile.0), cols: padded(tile.1) }
    }

    /// Values of scratch memory: the padded tile, and tables.
    #[must_use]
    pub fn scratch_len(&self) -> usize {
        self.field_len() + 2 * self.rows.len() + 4 * self.cols.len()
    }

    fn field_len(&self) -> usize {
        self.rows.len() * self.cols.len()
    }

    /// First row and column of the tile in the padded field.
    fn corner(&self) -> (usize, usize) {
        ((self.rows.len() - self.tile.0) / 2, (self.cols.len() - self.tile.1) / 2)
    }

    /// Finds the relief of a tile. `brightness` and `coarse` give a pixel of the image, or `None` where it does not count, and of
    /// the coarse DTM in pixels, by row-major index; `coarse_px` is the side of a pixel of the coarse DTM on its own grid, in pixels of
    /// the image.
    ///
    /// # Errors
    /// [`LengthError`] if `scratch` is shorter than [`Self::scratch_len`].
    pub fn relief<'s>(
        &self,
        brightness: impl Fn(usize) -> Option<f32>,
        coarse: impl Fn(usize) -> f32,
        (shading, light): (&Shading, Light),
        coarse_px: f32,
        scratch: &'s mut [f32],
    ) -> Result<Relief<'s>, LengthError> {
        let found = scratch.len();
        let scratch =
            scratch.get_mut(..self.scratch_len()).ok_or(LengthError { expected: self.scratch_len(), found })?;
        let (field, tables) = scratch.split_at_mut_checked(self.field_len()).unwrap_or_default();
        let (row_roots, rest) = tables.split_at_mut_checked(2 * self.rows.len()).unwrap_or_default();
        let (col_roots, line) = rest.split_at_mut_checked(2 * self.cols.len()).unwrap_or_default();
        self.rows.roots(row_roots);
        self.cols.roots(col_roots);
        let strength = light.strength();
        let direction = [light.east / strength, light.south / strength];
        self.fill(field, brightness, coarse, shading, strength, direction);
        self.mirror(field);
        self.rows_forward(field, col_roots, line);
        let half = self.cols.len() / 2;
        let columns = Lanes { re: 0, im: half, stride: self.cols.len(), count: half };
        transform(field, &self.rows, row_roots, columns, Way::Forward);
        self.filter(field, direction, coarse_px);
        transform(field, &self.rows, row_roots, columns, Way::Backward);
        self.rows_backward(field, col_roots, line);
        let ((top, left), stride) = (self.corner(), self.cols.len());
        Ok(Relief { field, first: top * stride + left, stride, cols: self.tile.1 })
    }

    /// Puts the slope along the light that the coarse DTM leaves unexplained into the tile's part of the field, its mean taken off.
    fn fill(
        &self,
        field: &mut [f32],
        brightness: impl Fn(usize) -> Option<f32>,
        coarse: impl Fn(usize) -> f32,
        shading: &Shading,
        strength: f32,
        [east, south]: [f32; 2],
    ) {
        let ((rows, cols), (top, left)) = (self.tile, self.corner());
        let mut sum = 0.0f64;
        for row in 0..rows {
            for col in 0..cols {
                let at = |r: usize, c: usize| coarse(r * cols + c);
                let (up, down) = (row.saturating_sub(1), (row + 1).min(rows.saturating_sub(1)));
                let (before, after) = (col.saturating_sub(1), (col + 1).min(cols - 1));
                let across = (at(row, after) - at(row, before)) / (after - before).max(1) as f32;
                let along = (at(down, col) - at(up, col)) / (down - up).max(1) as f32;
                let known = east * across + south * along;
                let seen = brightness(row * cols + col).map(|v| shading.along(v, strength));
                // Where nothing is seen the coarse DTM stands.
                let missing = seen.map_or(0.0, |seen| seen - known);
                put(field, (top + row) * self.cols.len() + left + col, missing);
                sum += f64::from(missing);
            }
        }
        let mean = (sum / (rows * cols).max(1) as f64) as f32;
        for row in 0..rows {
            part_mut(field, (top + row) * self.cols.len() + left, cols).iter_mut().for_each(|v| *v -= mean);
        }
    }

    /// Continues the tile to all sides by its mirror image.
    fn mirror(&self, field: &mut [f32]) {
        let ((rows, cols), (top, left)) = (self.tile, self.corner());
        let (height, width) = (self.rows.len(), self.cols.len());
        for row in top..top + rows {
            let line = part_mut(field, row * width, width);
            for col in (0..left).chain(left + cols..width) {
                let from = item(line, left + mirrored(col as isize - left as isize, cols));
                put(line, col, from);
            }
        }
        for row in (0..top).chain(top + rows..height) {
            let from = top + mirrored(row as isize - top as isize, rows);
            for col in 0..width {
                let value = item(field, from * width + col);
                put(field, row * width + col, value);
            }
        }
    }

    /// Transforms rows two by two, as real and imaginary part; then each holds its own half spectrum: real parts of frequencies 0 to
    /// half - 1, imaginary parts of the same, and in the place of the first imaginary part, which is 0, frequency half.
    fn rows_forward(&self, field: &mut [f32], roots: &[f32], line: &mut [f32]) {
        let (width, half) = (self.cols.len(), self.cols.len() / 2);
        for row in (0..self.rows.len()).step_by(2) {
            let pair = row * width..(row + 2) * width;
            let lanes = Lanes { re: pair.start, im: pair.start + width, stride: 1, count: 1 };
            transform(field, &self.cols, roots, lanes, Way::Forward);
            let (first, second) =
                part_mut(field, pair.start, pair.len()).split_at_mut_checked(width).unwrap_or_default();
            for k in 0..=half {
                let (p, q) = (self.cols.place(k), self.cols.place((width - k) % width.max(1)));
                // Z(k) + conj Z(-k) and -i (Z(k) - conj Z(-k)), over 2.
                let (x, y) = ([item(first, p), item(first, q)], [item(second, p), item(second, q)]);
                let [a, b, c, d] = [x[0] + x[1], y[0] - y[1], y[0] + y[1], x[1] - x[0]].map(|v| 0.5 * v);
                if k == half {
                    // Both spectra's frequency half, real.
                    put(line, half, a);
                    put(line, width + half, c);
                } else {
                    put(line, k, a);
                    put(line, width + k, c);
                    if k > 0 {
                        put(line, half + k, b);
                        put(line, width + half + k, d);
                    }
                }
            }
            copy(first, head(line, width));
            copy(second, part(line, width, width));
        }
    }

    /// Undoes [`Self::rows_forward`], but for the length as a factor.
    fn rows_backward(&self, field: &mut [f32], roots: &[f32], line: &mut [f32]) {
        let (width, half) = (self.cols.len(), self.cols.len() / 2);
        for row in (0..self.rows.len()).step_by(2) {
            let pair = row * width..(row + 2) * width;
            {
                let (first, second) =
                    part_mut(field, pair.start, pair.len()).split_at_mut_checked(width).unwrap_or_default();
                copy(line, first);
                copy(part_mut(line, width, width), second);
                for k in 0..=half {
                    let (p, q) = (self.cols.place(k), self.cols.place((width - k) % width.max(1)));
                    let (a, c) = (item(line, k), item(line, width + k));
                    let inner = k > 0 && k < half;
                    let (b, d) = if inner { (item(line, half + k), item(line, width + half + k)) } else { (0.0, 0.0) };
                    // X1 + i X2, and conj X1 + i conj X2.
                    put(first, p, a - d);
                    put(second, p, b + c);
                    put(first, q, a + d);
                    put(second, q, c - b);
                }
            }
            let lanes = Lanes { re: pair.start, im: pair.start + width, stride: 1, count: 1 };
            transform(field, &self.cols, roots, lanes, Way::Backward);
        }
    }

    /// Multiplies the spectrum by -i D / (D^2 + SMOOTHNESS K^2 + 1 / coarse_px^2), D being the wave number along the light and K
    /// that in all, and by what the transforms lack.
    fn filter(&self, field: &mut [f32], [east, south]: [f32; 2], coarse_px: f32) {
        let (height, width, half) = (self.rows.len(), self.cols.len(), self.cols.len() / 2);
        let scale = 1.0 / (height * width) as f32;
        // Level ground far from any coarse pixel has no scale of its own: never below one pixel.
        let stiffness = 1.0 / (coarse_px.max(1.0) * coarse_px.max(1.0));
        let wave = |k: usize, n: usize| {
            let signed = if 2 * k > n { k as f32 - n as f32 } else { k as f32 };
            core::f32::consts::TAU * signed / n as f32
        };
        let gain = |down: f32, across: f32| {
            let along = east * across + south * down;
            scale * along / (along * along + SMOOTHNESS * (across * across + down * down) + stiffness)
        };
        self.filter_first(field, |down| gain(down, 0.0));
        for m in 0..height {
            // The highest frequency has no sign, so an odd filter has nothing to give it.
            let middle = 2 * m == height;
            let (down, line) = (wave(m, height), part_mut(field, self.rows.place(m) * width, width));
            let (re, im) = line.split_at_mut_checked(half).unwrap_or_default();
            for (k, (re, im)) in re.iter_mut().zip(im).enumerate().skip(1) {
                let gain = if middle { 0.0 } else { gain(down, wave(k, width)) };
                // Times -i.
                (*re, *im) = (*im * gain, -*re * gain);
            }
        }
    }

    /// The first column holds the spectra of two real sequences: of frequency 0, which is filtered, and of the highest, which goes.
    fn filter_first(&self, field: &mut [f32], gain: impl Fn(f32) -> f32) {
        let (height, width, half) = (self.rows.len(), self.cols.len(), self.cols.len() / 2);
        for m in 0..=height / 2 {
            let n = (height - m) % height.max(1);
            let (p, q) = (self.rows.place(m) * width, self.rows.place(n) * width);
            let at = |place: usize| item(field, place);
            let (re, im) = (0.5 * (at(p) + at(q)), 0.5 * (at(p + half) - at(q + half)));
            let gain = if 2 * m == height { 0.0 } else { gain(core::f32::consts::TAU * m as f32 / height as f32) };
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

/// Index of the sample that stands for sample `i` beyond the ends of `n`, the end sample not repeated.
fn mirrored(i: isize, n: usize) -> usize {
    let period = 2 * (n.max(2) - 1);
    let i = i.rem_euclid(period.max(1) as isize) as usize;
    i.min(period - i).min(n.saturating_sub(1))
}

/// A tile's relief, in pixels, in the scratch memory.
#[derive(Debug)]
pub struct Relief<'s> {
    field: &'s [f32],
    first: usize,
    stride: usize,
    cols: usize,
}

impl Relief<'_> {
    /// The relief at the pixel of a row-major index of the tile, pixels.
    #[must_use]
    pub fn at(&self, index: usize) -> f32 {
        let cols = self.cols.max(1);
        self.field.get(self.first + index / cols * self.stride + index % cols).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests;
