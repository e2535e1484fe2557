//! Cuts a scene into the tiles that the network sees.

use core::fmt;

/// Rows of the paper's tile.
pub const TILE_ROWS: usize = 256;

/// Columns of the paper's tile.
pub const TILE_COLS: usize = 320;

/// The paper's tile.
pub const TILE: Shape = Shape::new(TILE_ROWS, TILE_COLS);

/// Pixels by which neighbouring tiles overlap at inference (Sec. V-B: "padding (100 pixels)"); 0 in training.
pub const INFERENCE_OVERLAP_PX: usize = 100;

/// Rows and columns of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Shape {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
}

impl Shape {
    /// Returns the shape with this number of rows and columns.
    #[must_use]
    pub const fn new(rows: usize, cols: usize) -> Self {
        Self { rows, cols }
    }

    /// Number of pixels; `usize::MAX` where the product is larger.
    #[must_use]
    pub const fn pixels(self) -> usize {
        self.rows.saturating_mul(self.cols)
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} x {}", self.rows, self.cols)
    }
}

/// A rectangle of a scene, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// First row.
    pub row: usize,
    /// First column.
    pub col: usize,
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
}

impl Window {
    /// Number of rows and columns.
    #[must_use]
    pub const fn shape(&self) -> Shape {
        Shape::new(self.rows, self.cols)
    }
}

/// The windows that cover a scene: equal windows, row by row, `tile - overlap` apart. The last row and the last column of windows are moved
/// back to end at the scene's edge. So every pixel is covered and no window leaves the scene (our choice; the paper does not mention
/// edges).
///
/// A `Tiling` exists only for a scene that holds at least one tile.
///
/// ```
/// use elunar_core::tile::{Shape, Tiling};
/// let tiling = Tiling::new(Shape::new(500, 320), Shape::new(256, 320), 100)?;
/// let first_rows: Vec<usize> = tiling.iter().map(|w| w.row).collect();
/// assert_eq!(first_rows, [0, 156, 244]);
/// # Ok::<(), elunar_core::tile::TilingError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tiling {
    scene: Shape,
    tile: Shape,
    stride: Shape,
}

impl Tiling {
    /// Covers a scene with tiles that overlap by `overlap_px` pixels.
    ///
    /// # Errors
    /// [`TilingError::Overlap`] if a tile is empty or not larger than the overlap, [`TilingError::SceneTooSmall`] if the scene
    /// is smaller than one tile.
    pub fn new(scene: Shape, tile: Shape, overlap_px: usize) -> Result<Self, TilingError> {
        if overlap_px >= tile.rows || overlap_px >= tile.cols {
            return Err(TilingError::Overlap { overlap_px, tile });
        }
        if scene.rows < tile.rows || scene.cols < tile.cols {
            return Err(TilingError::SceneTooSmall { scene, tile });
        }
        Ok(Self { scene, tile, stride: Shape::new(tile.rows - overlap_px, tile.cols - overlap_px) })
    }

    /// Number of rows and columns of windows.
    pub fn shape(&self) -> Shape {
        let along = |scene: usize, tile: usize, stride: usize| (scene - tile).div_ceil(stride.max(1)).saturating_add(1);
        let Self { scene, tile, stride } = *self;
        Shape::new(along(scene.rows, tile.rows, stride.rows), along(scene.cols, tile.cols, stride.cols))
    }

    /// Distance in rows and columns from one window to the next, except to the last.
    pub fn stride(&self) -> Shape {
        self.stride
    }

    /// Number of windows; at least 1.
    #[allow(clippy::len_without_is_empty)] // a tiling is never empty
    pub fn len(&self) -> usize {
        self.shape().pixels()
    }

    /// Returns window `index`, counted along rows; `None` from [`Self::len`] on.
    pub fn get(&self, index: usize) -> Option<Window> {
        let across = self.shape().cols.max(1);
        if index >= self.len() {
            return None;
        }
        let at = |i: usize, scene: usize, tile: usize, stride: usize| i.saturating_mul(stride).min(scene - tile);
        Some(Window {
            row: at(index / across, self.scene.rows, self.tile.rows, self.stride.rows),
            col: at(index % across, self.scene.cols, self.tile.cols, self.stride.cols),
            rows: self.tile.rows,
            cols: self.tile.cols,
        })
    }

    /// Returns all windows, row by row.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Window> + use<> {
        Windows { tiling: *self, next: 0 }
    }
}

/// The reason why a scene cannot be cut into tiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TilingError {
    /// The scene is smaller than one tile.
    SceneTooSmall {
        /// Scene rows and columns.
        scene: Shape,
        /// Tile rows and columns.
        tile: Shape,
    },
    /// A tile has no pixel, or is not larger than the overlap in both directions.
    Overlap {
        /// The overlap requested, pixels.
        overlap_px: usize,
        /// Tile rows and columns.
        tile: Shape,
    },
}

impl fmt::Display for TilingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::SceneTooSmall { scene, tile } => {
                write!(f, "expected a scene of at least {tile} pixels (rows x columns, one tile), found {scene}",)
            }
            Self::Overlap { overlap_px, tile } => {
                write!(f, "expected an overlap below the tile's {tile} pixels, found {overlap_px}")
            }
        }
    }
}

impl core::error::Error for TilingError {}

struct Windows {
    tiling: Tiling,
    next: usize,
}

impl Iterator for Windows {
    type Item = Window;

    fn next(&mut self) -> Option<Window> {
        let window = self.tiling.get(self.next)?;
        self.next += 1;
        Some(window)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.tiling.len() - self.next;
        (left, Some(left))
    }
}

impl ExactSizeIterator for Windows {}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_scene_of_one_tile_has_one_window() {
        let tiling = Tiling::new(TILE, TILE, INFERENCE_OVERLAP_PX).unwrap();
        assert_eq!(tiling.iter().len(), 1);
        assert_eq!(tiling.get(0), Some(Window { row: 0, col: 0, rows: 256, cols: 320 }));
        assert_eq!(tiling.get(1), None);
    }

    #[test]
    fn refuses_small_scenes_and_overlaps_as_wide_as_the_tile() {
        let (scene, tile) = (Shape::new(255, 320), TILE);
        assert_eq!(Tiling::new(scene, tile, 100), Err(TilingError::SceneTooSmall { scene, tile }));
        let narrow = Shape::new(256, 319);
        assert_eq!(Tiling::new(narrow, tile, 100), Err(TilingError::SceneTooSmall { scene: narrow, tile }));
        assert_eq!(Tiling::new(Shape::new(999, 999), tile, 256), Err(TilingError::Overlap { overlap_px: 256, tile }));
        let endless = Tiling::new(Shape::new(usize::MAX, usize::MAX), Shape::new(2, 2), 1).unwrap();
        assert_eq!(endless.get(usize::MAX - 1).map(|w| w.row), Some(1));
        assert_eq!(
            Tiling::new(Shape::new(9, 9), Shape::new(0, 4), 0),
            Err(TilingError::Overlap { overlap_px: 0, tile: Shape::new(0, 4) })
        );
    }

    #[test]
    fn messages_are_one_line_and_name_expected_and_found() {
        for text in [
            TilingError::SceneTooSmall { scene: Shape::new(9, 9), tile: TILE }.to_string(),
            TilingError::Overlap { overlap_px: 400, tile: TILE }.to_string(),
        ] {
            assert!(text.starts_with("expected") && text.contains("found") && !text.contains('\n'), "{text}");
        }
    }

    proptest! {
        #[test]
        fn every_pixel_is_covered_and_no_window_leaves_the_scene(
            tile in (1usize..9, 1usize..9), more in (0usize..30, 0usize..30), overlap in 0usize..8,
        ) {
            let (tile, scene) = (Shape::new(tile.0, tile.1), Shape::new(tile.0 + more.0, tile.1 + more.1));
            let overlap = overlap.min(tile.rows - 1).min(tile.cols - 1);
            let tiling = Tiling::new(scene, tile, overlap).unwrap();
            let mut covered = vec![false; scene.pixels()];
            let mut count = 0;
            for w in tiling.iter() {
                prop_assert!(w.row + w.rows <= scene.rows && w.col + w.cols <= scene.cols);
                prop_assert_eq!(w.shape(), tile);
                for r in w.row..w.row + w.rows {
                    covered[r * scene.cols + w.col..][..w.cols].fill(true);
                }
                count += 1;
            }
            prop_assert!(covered.iter().all(|&c| c));
            prop_assert_eq!(count, tiling.len());
        }

        #[test]
        fn neighbours_overlap_by_at_least_what_was_asked(rows in 40usize..300, overlap in 0usize..30) {
            let tiling = Tiling::new(Shape::new(rows, 40), Shape::new(40, 40), overlap).unwrap();
            let starts: Vec<usize> = tiling.iter().map(|w| w.row).collect();
            for pair in starts.windows(2) {
                prop_assert!(pair[1] > pair[0] && pair[0] + 40 - pair[1] >= overlap);
            }
        }
    }
}
