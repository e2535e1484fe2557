//! A coarse DTM as posts with their grid, read as samples of the image's grid.
//!
//! The values are those of [`crate::resample`], bit for bit those of [`crate::strip::Posts`] and of the ground's alignment of two rasters.

use crate::part::item;
use crate::resample::continued;
use crate::samples::Samples;
use crate::strip::PostGrid;
use crate::tile::Shape;

/// Coarse heights at posts, as samples of a tile: each is interpolated when it is read.
///
/// ```
/// use elunar_core::posts::PostMap;
/// use elunar_core::samples::Samples;
/// use elunar_core::strip::PostGrid;
/// use elunar_core::tile::Shape;
///
/// // Three rows of three posts, 4 pixels apart; a plane that falls by 1 m from row to row.
/// let posts_m = [0.0, 0.0, 0.0, -1.0, -1.0, -1.0, -2.0, -2.0, -2.0];
/// let tile = Shape::new(9, 9);
/// let map = PostMap::new(&posts_m, PostGrid::spaced(3, (0.0, 0.0), (4.0, 4.0)), tile).ok_or("no grid")?;
/// assert_eq!((map.len(), map.at(0), map.at(6 * 9 + 5)), (81, 0.0, -1.5));
/// # Ok::<(), &'static str>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PostMap<'p> {
    posts_m: &'p [f32],
    rows: usize,
    grid: PostGrid,
    tile: Shape,
}

impl<'p> PostMap<'p> {
    /// Makes the samples of a tile from posts, row-major, metres; a value that is not real ([`crate::mask`]) is a void. Rows and columns of
    /// `grid` may advance or go back. `None` if the posts are not whole rows of at least one post, or a number of the grid is not finite.
    #[must_use]
    pub fn new(posts_m: &'p [f32], grid: PostGrid, tile: Shape) -> Option<Self> {
        let rows = posts_m.len().checked_div(grid.cols)?;
        let numbers = [grid.row0, grid.rows_per_line, grid.col0, grid.cols_per_px];
        let legal =
            rows > 0 && rows.checked_mul(grid.cols) == Some(posts_m.len()) && numbers.iter().all(|v| v.is_finite());
        legal.then_some(Self { posts_m, rows, grid, tile })
    }

    /// Returns whether any post is real.
    #[must_use]
    pub fn has_posts(&self) -> bool {
        self.posts_m.iter().any(|z| crate::mask::is_real(*z))
    }

    /// Returns a post of a row that exists; the row is continued from its outermost two posts.
    fn post(&self, row: usize, col: isize) -> f32 {
        let kept = |col: isize| crate::mask::real(item(self.posts_m, row * self.grid.cols + col as usize));
        let last = self.grid.cols as isize - 1;
        match col {
            ..0 => continued(kept(0), kept(1.min(last)), col.unsigned_abs()),
            _ if col > last => continued(kept(last), kept((last - 1).max(0)), col.abs_diff(last)),
            _ => kept(col),
        }
    }
}

impl Samples for PostMap<'_> {
    fn len(&self) -> usize {
        self.tile.pixels()
    }

    fn at(&self, index: usize) -> f32 {
        let mut sample = [f32::NAN];
        if index < self.len() {
            self.read(index, &mut sample);
        }
        sample[0]
    }

    fn read(&self, first: usize, out: &mut [f32]) {
        let cols = self.tile.cols.max(1);
        let kept = |row: usize, start: usize| {
            core::array::from_fn(|i| self.post(row, (start + i) as isize - PostGrid::GHOSTS as isize))
        };
        self.grid.interpolate(first / cols, self.rows, (first % cols..).zip(out), kept);
    }

    fn work(&self) -> u64 {
        WORK
    }
}

/// Cost of an interpolation, about that of so many multiply-accumulates.
pub(crate) const WORK: u64 = 300;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strip::Posts;

    const TILE: Shape = Shape::new(12, 17);

    /// Posts with voids.
    fn posts(rows: usize, cols: usize, salt: usize) -> Vec<f32> {
        let noise = |i: usize| (i * 2_654_435_761 + salt * 40_503) >> 7 & 0xFFFF;
        let height = |i: usize| if noise(i) % 23 == 0 { -3.4e38 } else { noise(i) as f32 / 256.0 };
        (0..rows * cols).map(height).collect()
    }

    /// Lines of posts that are pushed row by row.
    fn lines(posts_m: &[f32], grid: PostGrid) -> Vec<f32> {
        let mut memory = vec![0.0; Posts::memory_len(grid.cols)];
        let mut made = Posts::new(grid, &mut memory).unwrap();
        let (mut rows, mut out, mut line) = (posts_m.chunks(grid.cols), Vec::new(), vec![0.0; TILE.cols]);
        for _ in 0..TILE.rows {
            while made.line(&mut line).is_none() {
                match rows.next() {
                    Some(row) => made.push_row(row).unwrap(),
                    None => made.finish(),
                }
            }
            out.extend_from_slice(&line);
        }
        out
    }

    #[test]
    fn posts_at_once_are_those_row_by_row() {
        let mut voids = 0;
        for (salt, first, spacing) in [
            (1, (0.0, 0.0), (4.0, 4.0)),
            (2, (-3.3, -7.9), (5.5, 4.25)),
            (3, (2.5, 3.0), (1.0, 1.0)),
            (4, (-1.0, -1.0), (30.0, 29.61)),
            (5, (5.0, 6.0), (0.7, 3.0)),
        ] {
            for (rows, cols) in [(1, 1), (2, 1), (1, 3), (4, 5), (9, 8)] {
                let (posts_m, grid) = (posts(rows, cols, salt), PostGrid::spaced(cols, first, spacing));
                let map = PostMap::new(&posts_m, grid, TILE).unwrap();
                let expected = lines(&posts_m, grid);
                let mut found = vec![0.0; TILE.pixels()];
                found.chunks_mut(TILE.cols).enumerate().for_each(|(row, out)| map.read(row * TILE.cols, out));
                let same =
                    |i: usize| found[i].to_bits() == expected[i].to_bits() || found[i].is_nan() && expected[i].is_nan();
                assert!((0..TILE.pixels()).all(same), "{salt} {rows} x {cols}");
                assert!((0..TILE.pixels()).all(|i| map.at(i).to_bits() == found[i].to_bits()));
                voids += found.iter().filter(|z| z.is_nan()).count();
            }
        }
        assert!(voids > 500 && voids < 25 * TILE.pixels() - 500, "{voids}");
    }

    #[test]
    fn rows_may_go_back() {
        let posts_m = posts(6, 5, 9);
        let turned: Vec<f32> = posts_m.chunks(5).rev().flatten().copied().collect();
        let grid = PostGrid { cols: 5, row0: 0.25, rows_per_line: 0.5, col0: 0.5, cols_per_px: 0.25 };
        let back = PostGrid { row0: 5.0 - grid.row0, rows_per_line: -grid.rows_per_line, ..grid };
        let (map, other) = (PostMap::new(&posts_m, grid, TILE).unwrap(), PostMap::new(&turned, back, TILE).unwrap());
        for i in 0..TILE.pixels() {
            assert!((map.at(i) - other.at(i)).abs() < 1e-3 || map.at(i).is_nan() && other.at(i).is_nan(), "{i}");
        }
        assert!(map.has_posts() && map.at(TILE.pixels()).is_nan());
    }

    #[test]
    fn grids_that_are_none_are_refused() {
        let grid = PostGrid { cols: 2, row0: 0.0, rows_per_line: 0.1, col0: 0.0, cols_per_px: 0.1 };
        assert!(PostMap::new(&[1.0; 6], grid, TILE).is_some());
        assert!(!PostMap::new(&[f32::NAN; 6], grid, TILE).unwrap().has_posts());
        for (len, grid) in [
            (0, grid),
            (5, grid),
            (6, PostGrid { cols: 0, ..grid }),
            (6, PostGrid { row0: f64::NAN, ..grid }),
            (6, PostGrid { rows_per_line: f64::INFINITY, ..grid }),
            (6, PostGrid { col0: f64::NEG_INFINITY, ..grid }),
            (6, PostGrid { cols_per_px: f64::NAN, ..grid }),
        ] {
            assert_eq!(PostMap::new(&[1.0; 6][..len], grid, TILE), None, "{len} {grid:?}");
        }
        // A grid far away, and one whose places are not finite, have no samples there.
        for far in [1e300, -1e300, f64::MAX] {
            let map = PostMap::new(&[1.0; 6], PostGrid { row0: far, cols_per_px: far, ..grid }, TILE).unwrap();
            assert!((0..TILE.pixels()).all(|i| map.at(i).is_nan()));
        }
    }
}
