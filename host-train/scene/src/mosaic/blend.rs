//! The weighted mean of overlapping tiles, row band by row band.

use elunar_base::{Error, Result};
use std::collections::VecDeque;

/// Sums of one row: weight times height, and weight.
struct Row {
    weighted_m: Vec<f64>,
    weight: Vec<f64>,
}

/// A scene that is joined from tiles in order from top to bottom.
///
/// Only the rows that further tiles can reach are kept, as `f64` sums. Finished rows can be taken at any time, so that a strip of 50,000
/// lines needs memory for one band of tiles. Tiles are added in the order of the calls. The result does not depend on the thread or the
/// time at which a tile was made.
pub struct Mosaic {
    cols: usize,
    rows: usize,
    /// Rows above this row are ignored, because they exist already.
    from: usize,
    /// First row that is not finished.
    first: usize,
    band: VecDeque<Row>,
    finished: Vec<f32>,
}

impl Mosaic {
    /// Makes an empty scene.
    #[must_use]
    pub fn new(rows: usize, cols: usize) -> Self {
        Self::from_row(0, rows, cols)
    }

    /// Makes the scene from row `from` on. The caller must add every tile that reaches these rows.
    #[must_use]
    pub fn from_row(from: usize, rows: usize, cols: usize) -> Self {
        Self { cols, rows, from, first: from, band: VecDeque::new(), finished: vec![] }
    }

    /// Adds a tile of `tile_cols` columns with its upper left pixel at (`row`, `col`). The part beyond the scene is dropped. Pixels of
    /// weight 0 are left out, whatever their height.
    ///
    /// # Errors
    /// [`Error::Input`] if a tile starts above one that was added before, or heights and weights differ in number.
    pub fn add(&mut self, row: usize, col: usize, tile_cols: usize, heights_m: &[f32], weights: &[f64]) -> Result<()> {
        if row < self.first && self.first > self.from || heights_m.len() != weights.len() || tile_cols == 0 {
            let what = format!("row {row}, {} heights, {} weights", heights_m.len(), weights.len());
            return Err(Error::input(format!(
                "mosaic: tiles from row {} downwards, one weight per height expected; {what} found",
                self.first
            )));
        }
        self.finish_above(row);
        let lines = heights_m.chunks_exact(tile_cols).zip(weights.chunks_exact(tile_cols));
        let below = lines.enumerate().take(self.rows.saturating_sub(row)).skip(self.first.saturating_sub(row));
        for (line, (heights_m, weights)) in below {
            let at = row + line - self.first;
            while self.band.len() <= at {
                self.band.push_back(Row { weighted_m: vec![0.0; self.cols], weight: vec![0.0; self.cols] });
            }
            let sums = &mut self.band[at];
            let [weighted_m, weight] =
                [&mut sums.weighted_m, &mut sums.weight].map(|sums| sums.get_mut(col..).unwrap_or_default());
            let sums = weighted_m.iter_mut().zip(weight);
            for ((weighted_m, sum), (&height_m, &weight)) in sums.zip(heights_m.iter().zip(weights)) {
                // Nothing is added for a weight of 0, whatever its height; sums are never -0.
                let counts = weight > 0.0;
                *weighted_m += if counts { weight * f64::from(height_m) } else { 0.0 };
                *sum += if counts { weight } else { 0.0 };
            }
        }
        Ok(())
    }

    /// Takes the rows finished so far, row-major. The first call begins with the scene's first row (or that of
    /// [`from_row`](Self::from_row)). Each later call begins where the one before ended.
    #[must_use]
    pub fn take_finished(&mut self) -> Vec<f32> {
        std::mem::take(&mut self.finished)
    }

    /// Returns the rows that were not taken, row-major; NaN where no tile had weight.
    #[must_use]
    pub fn finish(mut self) -> Vec<f32> {
        self.finish_above(self.rows);
        self.finished
    }

    fn finish_above(&mut self, row: usize) {
        while self.first < row.min(self.rows) {
            match self.band.pop_front() {
                // A pixel without any tile becomes 0 / 0 = NaN.
                Some(sums) => {
                    self.finished.extend(sums.weighted_m.iter().zip(&sums.weight).map(|(z, w)| (z / w) as f32))
                }
                None => self.finished.resize(self.finished.len() + self.cols, f32::NAN),
            }
            self.first += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mosaic::WeightRules;
    use elunar_core::tile::{Shape, Tiling};

    struct Tile {
        row: usize,
        col: usize,
        cols: usize,
        heights_m: Vec<f32>,
        weights: Vec<f64>,
    }

    /// Joins all tiles in one array, without a band.
    fn naive(rows: usize, cols: usize, tiles: &[Tile]) -> Vec<f32> {
        let (mut sum, mut weight) = (vec![0.0; rows * cols], vec![0.0; rows * cols]);
        for Tile { row, col, cols: tile_cols, heights_m, weights } in tiles {
            for i in 0..heights_m.len() {
                let (r, c) = (row + i / tile_cols, col + i % tile_cols);
                if r < rows && c < cols && weights[i] > 0.0 {
                    sum[r * cols + c] += weights[i] * f64::from(heights_m[i]);
                    weight[r * cols + c] += weights[i];
                }
            }
        }
        sum.iter().zip(weight).map(|(s, w)| (s / w) as f32).collect()
    }

    #[test]
    fn the_band_is_the_whole() {
        let (rows, cols, tile) = (61, 47, Shape::new(16, 20));
        let tiles: Vec<_> = Tiling::new(Shape::new(rows, cols), tile, 6)
            .unwrap()
            .iter()
            .enumerate()
            .map(|(k, window)| {
                let heights_m: Vec<f32> = (0..320).map(|i| ((i * 31 + k * 17) % 97) as f32).collect();
                let valid: Vec<bool> = (0..320).map(|i| (i * 13 + k) % 29 > 3).collect();
                let weights = WeightRules::default().weights(&valid, 16, 20);
                Tile { row: window.row, col: window.col, cols: 20, heights_m, weights }
            })
            .collect();
        let mut mosaic = Mosaic::new(rows, cols);
        for tile in &tiles {
            mosaic.add(tile.row, tile.col, tile.cols, &tile.heights_m, &tile.weights).unwrap();
        }
        let (found, expected) = (mosaic.finish(), naive(rows, cols, &tiles));
        let same =
            |a: &[f32], b: &[f32]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
        // In pieces, and started at several rows.
        for from in [0, 1, 16, 37, rows - 1] {
            let (mut mosaic, mut pieces) = (Mosaic::from_row(from, rows, cols), vec![]);
            for tile in tiles.iter().filter(|tile| tile.row + 16 > from) {
                mosaic.add(tile.row, tile.col, tile.cols, &tile.heights_m, &tile.weights).unwrap();
                pieces.extend(mosaic.take_finished());
            }
            pieces.extend(mosaic.finish());
            assert!(same(&pieces, &found[from * cols..]), "from row {from}");
        }
        assert_eq!(found.len(), rows * cols);
        for (found, expected) in found.iter().zip(&expected) {
            assert!(found == expected || (found.is_nan() && expected.is_nan()));
        }
    }

    #[test]
    fn tiles_that_agree_join_without_a_seam() {
        let height = |r: usize, c: usize| -1900.0 + r as f32 * 0.37 - c as f32 * 0.21;
        let mut mosaic = Mosaic::new(40, 70);
        let weights = WeightRules::default().weights(&[true; 600], 20, 30);
        for window in Tiling::new(Shape::new(40, 70), Shape::new(20, 30), 7).unwrap().iter() {
            let tile: Vec<f32> = (0..600).map(|i| height(window.row + i / 30, window.col + i % 30)).collect();
            mosaic.add(window.row, window.col, 30, &tile, &weights).unwrap();
        }
        for (i, z) in mosaic.finish().into_iter().enumerate() {
            assert!((z - height(i / 70, i % 70)).abs() < 1e-3);
        }
    }

    #[test]
    fn matches_numpy_and_scipy() {
        let bytes = include_bytes!("../../../../tests/golden/mosaic/blend.f32");
        let numbers: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect();
        let (tile_px, corners) = (48 * 60, [(0, 0), (10, 30), (22, 7)]);
        let mut mosaic = Mosaic::new(70, 90);
        for ((row, col), heights_m) in corners.into_iter().zip(numbers.chunks_exact(tile_px)) {
            let valid: Vec<bool> = heights_m.iter().map(|z| z.is_finite()).collect();
            mosaic.add(row, col, 60, heights_m, &WeightRules::default().weights(&valid, 48, 60)).unwrap();
        }
        let (found, expected) = (mosaic.finish(), &numbers[3 * tile_px..]);
        assert_eq!((found.len(), expected.len()), (6300, 6300));
        let ulps = |a: f32, b: f32| a.to_bits().abs_diff(b.to_bits());
        for (i, (&a, &b)) in found.iter().zip(expected).enumerate() {
            // Both sum in f64, in different orders. The rounding to f32 may differ.
            assert!((a.is_nan() && b.is_nan()) || ulps(a, b) <= 1, "pixel {i}: {a} instead of {b}");
        }
    }

    #[test]
    fn gaps_and_what_lies_beyond_stay_out() {
        let mut mosaic = Mosaic::new(5, 4);
        mosaic.add(2, 1, 2, &[1.0, f32::NAN, 3.0, 4.0], &[1.0, 0.0, 1.0, 1.0]).unwrap();
        mosaic.add(4, 3, 2, &[7.0, 8.0, 9.0, 9.0], &[1.0; 4]).unwrap();
        assert!(mosaic.add(3, 0, 1, &[1.0], &[1.0]).is_err(), "tiles come from top to bottom");
        let found = mosaic.finish();
        let valid: Vec<(usize, f32)> = found.into_iter().enumerate().filter(|(_, z)| z.is_finite()).collect();
        assert_eq!(valid, [(9, 1.0), (13, 3.0), (14, 4.0), (19, 7.0)]);
    }
}
