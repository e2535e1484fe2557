//! Weights for blending the overlapping tiles of one scene.
//!
//! The weights follow the default of the Ames Stereo Pipeline's `dem_mosaic`: the distance to the nearest edge in steps over 4 neighbours,
//! blurred by a Gaussian of 5 pixels and squared. But only edges towards other tiles count (our choice): tiles of one scene have the
//! scene's border and voids in common, so there neither of two neighbours is better. Therefore weights do not depend on the data, and tiles
//! come in sixteen kinds, by which of the four edges count.
//!
//! Nothing is stored: a line of weights is computed on request, with two times [`TAPS`] multiplications per pixel. The same line of the
//! same tile always has the same bits.

use crate::error::{LengthError, same_length};
use crate::part::item;
use crate::tile::{Shape, Window};

/// Standard deviation of the blur, pixels.
pub const SIGMA_PX: f64 = 5.0;
/// Taps of the blur.
pub const TAPS: usize = taps(SIGMA_PX);
/// Largest distance; larger ones are set to it, pixels.
pub const FARTHEST_PX: u32 = farthest_px(TAPS);
/// Taps on either side of the middle.
const REACH: usize = TAPS / 2;

/// Returns the taps of a Gaussian blur of `sigma_px` pixels: the odd floor of 7 sigma (`dem_mosaic`).
#[must_use]
pub const fn taps(sigma_px: f64) -> usize {
    (7.0 * sigma_px) as usize | 1
}

/// Returns the distance in pixels beyond which distances are cut: extra crop 200 + twice the taps + 1 (`dem_mosaic`'s margin, without
/// erosion and hole filling).
#[must_use]
pub const fn farthest_px(taps: usize) -> u32 {
    (taps as u32).saturating_mul(2).saturating_add(201)
}

/// Writes one side of the symmetric kernel of a Gaussian blur of `sigma_px` pixels, centre first: the Gaussian integrated over each pixel.
/// The sum over both sides is one.
pub fn half_kernel(sigma_px: f64, kernel: &mut [f64]) {
    let edge = |x: f64| libm::erf(x / (sigma_px * core::f64::consts::SQRT_2));
    for (i, k) in kernel.iter_mut().enumerate() {
        *k = 0.5 * (edge(i as f64 + 0.5) - edge(i as f64 - 0.5));
    }
    let sum = item(kernel, 0) + 2.0 * kernel.iter().skip(1).sum::<f64>();
    kernel.iter_mut().for_each(|k| *k /= sum);
}

/// The sides of a tile that are the scene's border. There is no other tile beyond an open side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Open {
    /// First row.
    pub top: bool,
    /// Last row.
    pub bottom: bool,
    /// First column.
    pub left: bool,
    /// Last column.
    pub right: bool,
}

impl Open {
    /// Returns the sides of `window` that lie on or beyond the border of a scene of this shape.
    #[must_use]
    pub fn of(window: Window, scene: Shape) -> Self {
        let Window { row, col, rows, cols } = window;
        let ends = |first: usize, len: usize, scene: usize| first.saturating_add(len) >= scene;
        Self { top: row == 0, bottom: ends(row, rows, scene.rows), left: col == 0, right: ends(col, cols, scene.cols) }
    }
}

/// The weights for tiles of one shape.
///
/// ```
/// use elunar_core::overlap::{Open, OverlapWeights};
/// use elunar_core::tile::Shape;
///
/// let weights = OverlapWeights::new(Shape::new(64, 80));
/// let open = Open { top: true, bottom: false, left: true, right: false };
/// let (mut line, mut scratch) = ([0.0; 80], [0.0; OverlapWeights::scratch_len(80)]);
/// weights.line(open, 0, &mut line, &mut scratch)?;
/// // They fall towards the neighbour on the right.
/// assert!(line[0] > 100.0 * line[79] && line[79] > 0.0);
/// # Ok::<(), elunar_core::error::LengthError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverlapWeights {
    tile: Shape,
    /// One side of the symmetric kernel, centre first: the Gaussian integrated over each pixel. The sum over both sides is one.
    kernel: [f64; REACH + 1],
}

impl OverlapWeights {
    /// Makes the weights for tiles of this shape.
    #[must_use]
    pub fn new(tile: Shape) -> Self {
        let mut kernel = [0.0; REACH + 1];
        half_kernel(SIGMA_PX, &mut kernel);
        Self { tile, kernel }
    }

    /// Number of values of scratch memory that [`line`](Self::line) needs for tiles of `cols` columns.
    #[must_use]
    pub const fn scratch_len(cols: usize) -> usize {
        cols.saturating_add(2 * REACH).saturating_mul(2)
    }

    /// Returns the distance of pixel (`row`, `col`) to the nearest side that is not open, in pixels, at most [`FARTHEST_PX`]. The pixel
    /// itself counts. The distance is 0 beyond such a side. Beyond an open side the tile continues.
    #[must_use]
    pub fn distance_px(&self, open: Open, row: usize, col: usize) -> u32 {
        self.px_to_rows(open, row as isize).min(self.px_to_cols(open, col as isize))
    }

    fn px_to_rows(&self, open: Open, row: isize) -> u32 {
        along(row, self.tile.rows, open.top, open.bottom)
    }

    fn px_to_cols(&self, open: Open, col: isize) -> u32 {
        along(col, self.tile.cols, open.left, open.right)
    }

    /// Writes the weights of line `row` of a tile from left to right; all are positive.
    ///
    /// # Errors
    /// [`LengthError`] if the length of `out` is not the tile's columns, or that of `scratch` not [`scratch_len`](Self::scratch_len).
    pub fn line(&self, open: Open, row: usize, out: &mut [f64], scratch: &mut [f64]) -> Result<(), LengthError> {
        let cols = self.tile.cols;
        same_length(cols, out.len())?;
        same_length(Self::scratch_len(cols), scratch.len())?;
        // First down the columns, with those beyond an open side. The order of additions is always that of the pixels, so that sums have
        // the same bits. The loops run along the line, where processors add several numbers at once.
        let (reach, row) = (REACH as isize, row.min(isize::MAX as usize) as isize);
        let (columns_px, blurred) = scratch.split_at_mut_checked(cols.saturating_add(2 * REACH)).unwrap_or_default();
        for (i, column_px) in columns_px.iter_mut().enumerate() {
            *column_px = f64::from(self.px_to_cols(open, i as isize - reach));
        }
        blurred.fill(0.0);
        for offset in -reach..=reach {
            let weight = item(&self.kernel, offset.unsigned_abs());
            let row_px = f64::from(self.px_to_rows(open, row.saturating_add(offset)));
            for (blurred, &column_px) in blurred.iter_mut().zip(columns_px.iter()) {
                *blurred += weight * if column_px < row_px { column_px } else { row_px };
            }
        }
        out.fill(0.0);
        for tap in 0..TAPS {
            let weight = item(&self.kernel, tap.abs_diff(REACH));
            for (out, blurred) in out.iter_mut().zip(blurred.iter().skip(tap)) {
                *out += weight * *blurred;
            }
        }
        out.iter_mut().for_each(|weight| *weight *= *weight);
        Ok(())
    }
}

/// Returns the distance to the nearer of the two ends that are not open, at most [`FARTHEST_PX`].
fn along(at: isize, len: usize, before: bool, after: bool) -> u32 {
    let far = FARTHEST_PX as isize;
    let first = if before { far } else { at.saturating_add(1) };
    let last = if after { far } else { (len as isize).saturating_sub(at) };
    first.min(last).clamp(0, far) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: Open = Open { top: false, bottom: false, left: false, right: false };

    fn kinds() -> impl Iterator<Item = Open> {
        (0..16).map(|k| Open { top: k & 1 > 0, bottom: k & 2 > 0, left: k & 4 > 0, right: k & 8 > 0 })
    }

    fn table(tile: Shape, open: Open) -> Vec<f64> {
        let weights = OverlapWeights::new(tile);
        let (mut line, mut scratch) = (vec![0.0; tile.cols], vec![7.0; OverlapWeights::scratch_len(tile.cols)]);
        let mut all = vec![];
        for row in 0..tile.rows {
            weights.line(open, row, &mut line, &mut scratch).unwrap();
            all.extend_from_slice(&line);
        }
        all
    }

    /// Returns the weight of one pixel from the whole tile and its surroundings, by the definition in two dimensions.
    fn naive(Shape { rows, cols }: Shape, open: Open, row: usize, col: usize) -> f64 {
        let taps: Vec<f64> = (-17..=17).map(|i| (-f64::from(i * i) / 50.0).exp()).collect();
        let total: f64 = taps.iter().sum();
        let (mut sum, beyond) = (0.0, 400);
        for (i, a) in taps.iter().enumerate() {
            for (j, b) in taps.iter().enumerate() {
                let (r, c) = (row as i64 + i as i64 - 17, col as i64 + j as i64 - 17);
                let top = if open.top { r + beyond } else { r + 1 };
                let left = if open.left { c + beyond } else { c + 1 };
                let bottom = rows as i64 - r + if open.bottom { beyond } else { 0 };
                let right = cols as i64 - c + if open.right { beyond } else { 0 };
                sum += a * b / (total * total) * top.min(bottom).min(left).min(right).clamp(0, 271) as f64;
            }
        }
        sum * sum
    }

    #[test]
    fn weights_are_blurred_distances_squared() {
        let tiles = [Shape::new(64, 80), Shape::new(5, 9), Shape::new(300, 40)];
        for (tile, open) in tiles.into_iter().flat_map(|t| kinds().map(move |k| (t, k))) {
            let found = table(tile, open);
            for i in (0..tile.pixels()).step_by(97) {
                let (row, col) = (i / tile.cols, i % tile.cols);
                let expected = naive(tile, open, row, col);
                // The Gaussian at the middle of a pixel differs from its mean over the pixel by up to 0.7 % of a tap.
                assert!(
                    (found[i] / expected - 1.0).abs() < 0.02,
                    "{tile} {open:?} {row} {col}: {} {expected}",
                    found[i]
                );
            }
            assert!(found.iter().all(|w| *w > 0.0));
        }
    }

    #[test]
    fn open_sides_are_those_of_the_scene() {
        let of = |row, col| Open::of(Window { row, col, rows: 20, cols: 30 }, Shape::new(60, 90));
        assert_eq!(of(20, 30), NONE);
        assert_eq!(of(0, 60), Open { top: true, right: true, ..NONE });
        assert_eq!(of(40, 0), Open { bottom: true, left: true, ..NONE });
        assert_eq!(Open::of(Window { row: 0, col: 0, rows: 99, cols: 99 }, Shape::new(3, 3)), kinds().last().unwrap());
    }

    #[test]
    fn far_inside_nothing_is_felt_and_odd_buffers_are_refused() {
        let all = kinds().last().unwrap();
        assert!(table(Shape::new(30, 40), all).iter().all(|w| (w / 271.0_f64.powi(2) - 1.0).abs() < 1e-12));
        let weights = OverlapWeights::new(Shape::new(30, 40));
        assert_eq!(
            (weights.distance_px(NONE, 0, 9), weights.distance_px(NONE, 29, 9), weights.distance_px(NONE, 15, 38)),
            (1, 1, 2)
        );
        assert!(weights.line(NONE, 0, &mut [0.0; 39], &mut [0.0; 148]).is_err());
        assert!(weights.line(NONE, 0, &mut [0.0; 40], &mut [0.0; 147]).is_err());
        let mut far = [1.0; 40];
        weights.line(NONE, usize::MAX, &mut far, &mut [0.0; 148]).unwrap();
        weights.line(NONE, isize::MAX as usize, &mut far, &mut [0.0; 148]).unwrap();
        assert_eq!(far, [0.0; 40]);
    }
}
