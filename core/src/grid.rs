//! A borrowed rectangle of pixels: rows, columns and the distance between rows.

use crate::error::{LengthError, same_length};
use crate::tile::Window;

/// A borrowed, read-only image. Row `r` starts at sample `r * stride` and has `cols` samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridView<'a, T> {
    samples: &'a [T],
    rows: usize,
    cols: usize,
    stride: usize,
}

impl<'a, T: Copy> GridView<'a, T> {
    /// Views `samples` as a dense image of `rows * cols` samples.
    ///
    /// # Errors
    /// [`LengthError`] if `samples` has another length.
    pub fn new(samples: &'a [T], rows: usize, cols: usize) -> Result<Self, LengthError> {
        same_length(rows.saturating_mul(cols), samples.len())?;
        let rows = if cols == 0 { 0 } else { rows }; // so that no loop runs over empty rows
        Ok(Self { samples, rows, cols, stride: cols })
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// Returns the sample at `row`, `col`; `None` outside.
    pub fn get(&self, row: usize, col: usize) -> Option<T> {
        self.row(row).get(col).copied()
    }

    /// Returns the samples of one row; an empty slice outside.
    pub fn row(&self, row: usize) -> &'a [T] {
        if row >= self.rows {
            return &[];
        }
        self.samples.get(row * self.stride..row * self.stride + self.cols).unwrap_or(&[])
    }

    /// Returns the part of the image inside `window`, without copying; `None` if the window leaves the image.
    ///
    /// ```
    /// use elunar_core::{grid::GridView, tile::Window};
    /// let pixels = [0, 1, 2, 3, 4, 5, 6, 7, 8];
    /// let image = GridView::new(&pixels, 3, 3)?;
    /// let corner = image.window(Window { row: 1, col: 1, rows: 2, cols: 2 }).unwrap();
    /// assert_eq!(corner.row(0), [4, 5]);
    /// assert_eq!(corner.row(1), [7, 8]);
    /// # Ok::<(), elunar_core::error::LengthError>(())
    /// ```
    pub fn window(&self, window: Window) -> Option<Self> {
        let Window { row, col, rows, cols } = window;
        if row.checked_add(rows)? > self.rows || col.checked_add(cols)? > self.cols {
            return None;
        }
        let samples = if rows == 0 || cols == 0 { &[] } else { self.samples.get(row * self.stride + col..)? };
        Some(Self { samples, rows, cols, stride: self.stride })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn rejects_a_wrong_length_and_an_overflowing_shape() {
        assert_eq!(GridView::new(&[1, 2, 3], 2, 2), Err(LengthError { expected: 4, found: 3 }));
        assert!(GridView::new(&[0u8; 4], usize::MAX, 2).is_err());
        assert_eq!(GridView::<u8>::new(&[], usize::MAX, 0).unwrap().rows(), 0);
    }

    #[test]
    fn windows_at_and_beyond_the_edge() {
        let pixels = [0u8; 12];
        let grid = GridView::new(&pixels, 3, 4).unwrap();
        assert!(grid.window(Window { row: 0, col: 0, rows: 3, cols: 4 }).is_some());
        assert!(grid.window(Window { row: 3, col: 4, rows: 0, cols: 0 }).is_some());
        assert!(grid.window(Window { row: 1, col: 0, rows: 3, cols: 1 }).is_none());
        assert!(grid.window(Window { row: 0, col: 2, rows: 1, cols: 3 }).is_none());
        assert!(grid.window(Window { row: usize::MAX, col: 0, rows: 2, cols: 1 }).is_none());
        assert_eq!(grid.get(2, 3), Some(0));
        assert_eq!(grid.get(3, 0), None);
    }

    proptest! {
        #[test]
        fn a_window_of_a_window_holds_the_same_pixels(r in 0usize..4, c in 0usize..5, h in 0usize..5, w in 0usize..5) {
            let pixels: Vec<usize> = (0..8 * 9).collect();
            let outer = GridView::new(&pixels, 8, 9).unwrap();
            if let Some(inner) = outer.window(Window { row: r, col: c, rows: h, cols: w }) {
                for (i, j) in (0..h).flat_map(|i| (0..w).map(move |j| (i, j))) {
                    prop_assert_eq!(inner.get(i, j), Some((r + i) * 9 + c + j));
                    prop_assert_eq!(inner.row(i)[j], (r + i) * 9 + c + j);
                }
            } else {
                prop_assert!(r + h > 8 || c + w > 9);
            }
        }
    }
}
