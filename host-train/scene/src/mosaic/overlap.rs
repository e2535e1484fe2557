//! Weights that fall only in the overlap of tiles.
//!
//! `dem_mosaic` joins DEMs of any shape, so weights fall towards every gap and edge. Tiles of one prediction share the scene's gaps and its
//! border. There both neighbours would have almost no weight, and the tile that reaches further would weigh no more than the other. This
//! leaves a visible step along their seam. Here only edges towards other tiles count (our choice, see [`elunar_core::overlap`]).

use elunar_core::overlap::{self, Open};
use elunar_core::tile::{Shape, Window};
use std::collections::HashMap;

/// Name of the weights in the metadata of outputs.
pub const BLEND: &str = "dem-mosaic";

/// The weights of a scene's tiles. There are at most nine kinds; each is computed once.
pub struct TileWeights {
    scene: Shape,
    made: HashMap<Open, Vec<f64>>,
}

impl TileWeights {
    /// Makes the weights for tiles of a scene of this shape.
    #[must_use]
    pub fn new(scene: Shape) -> Self {
        Self { scene, made: HashMap::new() }
    }

    /// Returns the weights of the tile at `window`, all positive, row-major.
    pub fn of(&mut self, window: Window) -> &[f64] {
        let open = Open::of(window, self.scene);
        self.made.entry(open).or_insert_with(|| {
            let (rows, cols) = (window.rows, window.cols);
            let weights = overlap::OverlapWeights::new(window.shape());
            let (mut made, mut scratch) =
                (vec![0.0; rows * cols], vec![0.0; overlap::OverlapWeights::scratch_len(cols)]);
            for (row, line) in made.chunks_exact_mut(cols).enumerate() {
                weights.line(open, row, line, &mut scratch).expect("buffers of these lengths");
            }
            made
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mosaic::WeightRules;

    /// Returns the weights of a tile cut from a larger one that extends far beyond the scene.
    fn cut_from_beyond(Shape { rows, cols }: Shape, open: Open) -> Vec<f64> {
        let [top, bottom, left, right] =
            [open.top, open.bottom, open.left, open.right].map(|open| if open { 320 } else { 0 });
        let (wide, high) = (left + cols + right, top + rows + bottom);
        let weights = WeightRules::default().weights(&vec![true; high * wide], high, wide);
        let line = |r: usize| &weights[(top + r) * wide + left..][..cols];
        (0..rows).flat_map(|r| line(r).iter().copied()).collect()
    }

    #[test]
    fn weights_are_those_of_the_general_rule() {
        let (scene, tile) = (Shape::new(300, 400), Shape::new(70, 90));
        let mut weights = TileWeights::new(scene);
        for (row, col) in [(0, 0), (0, 50), (0, 310), (50, 0), (50, 50), (50, 310), (230, 0), (230, 50), (230, 310)] {
            let window = Window { row, col, rows: tile.rows, cols: tile.cols };
            let expected = cut_from_beyond(tile, Open::of(window, scene));
            // The order of the terms of each sum is the same.
            assert!(weights.of(window) == expected, "{row} {col}");
        }
        let mut whole = TileWeights::new(Shape::new(60, 80));
        let window = Window { row: 0, col: 0, rows: tile.rows, cols: tile.cols };
        assert!(whole.of(window) == cut_from_beyond(tile, Open::of(window, Shape::new(60, 80))));
    }

    #[test]
    fn only_inner_edges_count() {
        let mut weights = TileWeights::new(Shape::new(300, 400));
        let (rows, cols) = (100, 120);
        let mut at = |row, col| weights.of(Window { row, col, rows, cols }).to_vec();
        let inner = at(50, 60);
        assert_eq!(inner, WeightRules::default().weights(&vec![true; rows * cols], rows, cols));
        let corner = at(0, 0);
        assert!(
            corner[0] > inner[50 * cols + 60],
            "far from every inner edge: {} {}",
            corner[0],
            inner[50 * cols + 60]
        );
        // Towards the neighbour on the right, weights fall as inside. At the scene's border, they do not fall.
        for row in [0, 40] {
            let (edge, top) = (corner[row * cols + cols - 1], corner[cols - 1]);
            assert!((edge / top - 1.0).abs() < 1e-9 && edge < 1e-2 * corner[row * cols], "{row}: {edge} {top}");
        }
        let whole = TileWeights::new(Shape::new(100, 120)).of(Window { row: 0, col: 0, rows, cols }).to_vec();
        assert!(whole.iter().all(|w| *w == whole[0]));
    }
}
