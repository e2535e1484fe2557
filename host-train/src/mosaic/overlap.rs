//! Weights that fall only where tiles overlap.
//!
//! `dem_mosaic` joins DEMs of any shape, so every gap and edge is one. Tiles of one prediction share the scene's gaps and its border:
//! there both of two neighbours would weigh next to nothing, and the better-placed one no more than the other, which leaves a
//! visible step along their seam. Here only edges towards other tiles count (our choice).

use super::weights::{Blend, tile_weights};
use elunar_core::tile::Window;
use std::collections::HashMap;

/// Beyond this distance (and the blur) no edge is felt.
const FAR_PX: usize = 320;

/// The weights of a scene's tiles: nine kinds at the most, each made once.
pub struct OverlapWeights {
    scene: (usize, usize),
    blend: Blend,
    made: HashMap<[bool; 4], Vec<f64>>,
}

impl OverlapWeights {
    /// For tiles of a scene of (rows, columns).
    #[must_use]
    pub fn new(scene: (usize, usize), blend: Blend) -> Self {
        Self { scene, blend, made: HashMap::new() }
    }

    /// Weights of the tile at `window`, all positive, row-major.
    pub fn of(&mut self, window: Window) -> &[f64] {
        let Window { row, col, rows, cols } = window;
        let open = [row == 0, row + rows >= self.scene.0, col == 0, col + cols >= self.scene.1];
        self.made.entry(open).or_insert_with(|| {
            // As if the tile went on far beyond the scene.
            let [top, bottom, left, right] = open.map(|open| if open { FAR_PX } else { 0 });
            let (wide, high) = (left + cols + right, top + rows + bottom);
            let weights = tile_weights(&vec![true; high * wide], high, wide, self.blend);
            let line = |r: usize| &weights[(top + r) * wide + left..][..cols];
            (0..rows).flat_map(|r| line(r).iter().copied()).collect()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_inner_edges_count() {
        let mut weights = OverlapWeights::new((300, 400), Blend::DemMosaic);
        let (rows, cols) = (100, 120);
        let mut at = |row, col| weights.of(Window { row, col, rows, cols }).to_vec();
        let inner = at(50, 60);
        assert_eq!(inner, tile_weights(&vec![true; rows * cols], rows, cols, Blend::DemMosaic));
        let corner = at(0, 0);
        assert!(
            corner[0] > inner[50 * cols + 60],
            "far from every inner edge: {} {}",
            corner[0],
            inner[50 * cols + 60]
        );
        // Towards the neighbour on the right it falls as inside, at the scene's border as everywhere.
        for row in [0, 40] {
            let (edge, top) = (corner[row * cols + cols - 1], corner[cols - 1]);
            assert!((edge / top - 1.0).abs() < 1e-9 && edge < 1e-2 * corner[row * cols], "{row}: {edge} {top}");
        }
        let whole = OverlapWeights::new((100, 120), Blend::Linear).of(Window { row: 0, col: 0, rows, cols }).to_vec();
        assert!(whole.iter().all(|w| *w == whole[0]));
    }
}
