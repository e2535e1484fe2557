//! The expected errors of the tiles of a strip, and of a line of it.

use super::ring::{Ring, RingShape, put_floats};
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

/// A ring of rows of tiles: a line for each tile.
#[derive(Debug)]
pub(super) struct Expected<'m>(pub(super) Ring<'m>);

impl Expected<'_> {
    /// Number of sums of a pixel.
    pub(super) const SUMS: usize = 4;
    const BYTES: usize = 4 * ExpectedErrors::VALUES;

    /// Returns the size of the ring: rows of tiles that can reach one line, with the last row, which is moved back, and the row in progress.
    pub(super) fn shape(tiling: &Tiling, tile: Shape) -> Option<RingShape> {
        let rows = tile.rows.div_ceil(tiling.stride().rows.max(1)).saturating_add(2);
        Some(RingShape { lines: rows.checked_mul(tiling.shape().cols)?, line_bytes: Self::BYTES })
    }

    /// Stores those of a tile.
    pub(super) fn keep(&mut self, index: usize, errors: &ExpectedErrors) {
        self.0.write(index, |bytes| put_floats(bytes, errors.to_values()));
    }

    /// Returns those of a tile that reaches a line not yet returned, and whether they are lost since the last call.
    pub(super) fn get(&mut self, index: usize) -> (ExpectedErrors, u64) {
        let lost = self.0.check(index, 0..Self::BYTES);
        let line = self.0.line(index);
        let values = core::array::from_fn(|k| line.float(k));
        (if line.is_lost(0) { ExpectedErrors::UNKNOWN } else { ExpectedErrors::from_values(values) }, lost)
    }
}

/// Returns the errors in the order of sums.
pub(super) fn parts(errors: Errors) -> [f32; Expected::SUMS] {
    [errors.height_m, errors.slope, errors.explained, errors.dark]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::overlap::{Open, OverlapWeights};
    use crate::photoclinometry::Origin;
    use crate::strip::blend::Blend;
    use crate::strip::cut::Cut;

    /// Two tiles side by side: under both a line has the mean of theirs by the tiles' weights, elsewhere the one tile's. The first pixel is dark, the
    /// last has no height.
    #[test]
    fn a_line_has_the_weighted_means_of_its_tiles() {
        let (tile, cols, row) = (Shape::new(6, 8), 13, 2);
        let scene = Shape::new(tile.rows, cols);
        let cut = Cut { scene, tiling: Tiling::new(scene, tile, 3).unwrap() };
        let of_tiles = [[2.0, 0.25, 0.5, 8.0, 0.75, 10.0], [6.0, 0.125, 1.0, 9.0, 0.5, 20.0]];
        let shape = Expected::shape(&cut.tiling, tile).unwrap();
        let mut memory = vec![0; shape.bytes().unwrap()];
        let mut errors = Expected(Ring::cut(&mut memory, shape).0);
        for (index, values) in of_tiles.into_iter().enumerate() {
            errors.keep(index, &ExpectedErrors::from_values(values));
        }
        let mut aside = vec![0.0; Blend::aside_len(cols, tile, true)];
        let none = RingShape { lines: 0, line_bytes: 0 };
        let mut blend = Blend {
            means: Ring::cut(&mut [], none).0,
            aside: &mut aside,
            weights: OverlapWeights::new(tile),
            tile,
            cols,
        };
        let image: Vec<f32> = (0..cols).map(|col| if col == 0 { 5.0 } else { 100.0 }).collect();
        let heights_m: Vec<f32> = (0..cols).map(|col| if col + 1 == cols { f32::NAN } else { 1.0 }).collect();
        let (mut height_m, mut slope, mut origin) = (vec![0.0; cols], vec![0.0; cols], vec![0; cols]);
        let out = LineErrors { height_m: &mut height_m, slope: &mut slope, origin: &mut origin };
        assert_eq!(blend.expected(&cut, row, &&image[..], &heights_m, &mut errors, out), 0);

        let (mut weights, mut scratch) = (vec![0.0; tile.cols], vec![0.0; OverlapWeights::scratch_len(tile.cols)]);
        let mut sums = vec![[0.0; 5]; cols];
        for (window, values) in cut.tiling.iter().zip(of_tiles) {
            OverlapWeights::new(tile).line(Open::of(window, scene), row, &mut weights, &mut scratch).unwrap();
            for (i, weight) in weights.iter().enumerate() {
                let [lit_m, lit, explained, dark_m, dark, _] = values.map(f64::from);
                let is_dark = window.col + i == 0;
                let of_pixel = if is_dark { [dark_m, dark, 0.0, 1.0] } else { [lit_m, lit, explained, 0.0] };
                let sums = &mut sums[window.col + i];
                sums[4] += weight;
                sums.iter_mut().zip(of_pixel).for_each(|(sum, v)| *sum += weight * v);
            }
        }
        let both = (0..cols).filter(|&col| height_m[col] > 2.0 && height_m[col] < 6.0).count();
        assert!(both >= 3, "{both} pixels under both tiles");
        for col in 0..cols {
            if heights_m[col].is_nan() {
                assert!(height_m[col].is_nan() && slope[col].is_nan());
                continue;
            }
            let [of_height, of_slope, explained, dark] = [0, 1, 2, 3].map(|k| (sums[col][k] / sums[col][4]) as f32);
            let near = |a: f32, b: f32| (a - b).abs() < 1e-5;
            assert!(
                near(height_m[col], of_height) && near(slope[col], of_slope),
                "{col}: {} {of_height}",
                height_m[col]
            );
            assert_eq!(origin[col], Origin::of(explained, dark) as u8, "{col}");
        }
    }
}
