//! Computes coarse lines on the image's grid from rows of the coarse DTM.

use super::error::{StripError, lent, whole_line};
use crate::mask::real;
use crate::part::{copy, item, part, part_mut};
use crate::resample::{EDGE_PX, bicubic, continued};
use core::ops::Range;

/// Number of rows that bicubic interpolation reads.
const ROWS: usize = 4;
/// The place of the coarse DTM's posts relative to the strip. Axes are parallel to lines and columns, rows have the order of lines. The
/// centre of the strip's pixel (line, column) is at row `row0 + line * rows_per_line` and column `col0 + column * cols_per_px` of the
/// posts, where (0, 0) is the first post's centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PostGrid {
    /// Number of posts in a row.
    pub cols: usize,
    /// Row of the posts at the strip's first line.
    pub row0: f64,
    /// Rows of posts per line; positive, 0.03 for SLDEM2015 under lines of 2 m.
    pub rows_per_line: f64,
    /// Column of the posts at the strip's first column.
    pub col0: f64,
    /// Columns of posts per pixel.
    pub cols_per_px: f64,
}

impl PostGrid {
    /// Number of columns by which rows are continued on either side.
    pub(crate) const GHOSTS: usize = 2;

    /// Makes a grid of rows of `cols` posts. The first post's centre is at (line, column) `first_px` of the strip, where (0, 0) is the
    /// centre of its first pixel; the others are `spacing_px` pixels apart.
    #[must_use]
    pub fn spaced(cols: usize, first_px: (f64, f64), spacing_px: (f64, f64)) -> Self {
        Self {
            cols,
            row0: -first_px.0 / spacing_px.0,
            rows_per_line: 1.0 / spacing_px.0,
            col0: -first_px.1 / spacing_px.1,
            cols_per_px: 1.0 / spacing_px.1,
        }
    }

    /// Returns an error for a grid that is none.
    pub(super) fn check(&self) -> Result<(), StripError> {
        let numbers = [self.row0, self.rows_per_line, self.col0, self.cols_per_px];
        let legal = self.cols > 0 && numbers.iter().all(|v| v.is_finite()) && self.rows_per_line > 0.0;
        if legal { Ok(()) } else { Err(StripError::Posts) }
    }

    /// Number of samples of a row that is continued on either side.
    pub(super) const fn stride(&self) -> usize {
        self.cols.saturating_add(2 * PostGrid::GHOSTS)
    }

    /// Number of rows that serve so many consecutive lines.
    pub(super) fn rows_for(&self, lines: usize) -> usize {
        (libm::ceil(lines as f64 * self.rows_per_line) as usize).saturating_add(ROWS + 1)
    }

    /// Returns the row at the centre of a line.
    fn row(&self, line: usize) -> f64 {
        self.row0 + line as f64 * self.rows_per_line
    }

    /// Returns the first row that a line needs. Lines above the grid are computed from its first rows.
    pub(super) fn oldest(&self, line: usize) -> usize {
        (libm::floor(self.row(line)) as usize).saturating_sub(1)
    }

    /// Returns whether a line needs no row beyond the first `rows`.
    pub(super) fn is_ready(&self, line: usize, rows: usize) -> bool {
        let row = self.row(line);
        // `as` turns too large numbers into the largest one.
        row < -EDGE_PX || (libm::floor(row) as isize).saturating_add(3) <= rows as isize
    }

    /// Returns the rows that some lines need, of the first `rows`.
    pub(super) fn rows_of(&self, lines: Range<usize>, rows: usize) -> Range<usize> {
        let end = self.oldest(lines.end).saturating_add(ROWS + 1).min(rows);
        self.oldest(lines.start).min(end)..end
    }

    /// Returns a row of posts, continued on either side; voids are NaN.
    pub(super) fn with_ghosts(posts_m: &[f32]) -> impl Iterator<Item = f32> {
        let (last, inner) = (posts_m.len().saturating_sub(1), usize::from(posts_m.len() > 1));
        let at = |col: usize| real(item(posts_m, col));
        let before = move |k: usize| continued(at(0), at(inner), k);
        let after = move |k: usize| continued(at(last), at(last - inner.min(last)), k);
        let left = (1..=PostGrid::GHOSTS).rev().map(before);
        left.chain(posts_m.iter().map(|z| real(*z))).chain((1..=PostGrid::GHOSTS).map(after))
    }

    /// Writes pixels of a line, by their columns, NaN without heights. `rows` rows have come; `kept` returns four samples of one of them, from a
    /// column of the continued row on.
    pub(crate) fn interpolate<'o>(
        &self,
        line: usize,
        rows: usize,
        pixels: impl Iterator<Item = (usize, &'o mut f32)>,
        kept: impl Fn(usize, usize) -> [f32; 4],
    ) {
        let row = self.row(line);
        let above = libm::floor(row);
        let (first, down) = ((above as isize).saturating_sub(1), (row - above) as f32);
        let has_rows = rows > 0 && row >= -EDGE_PX && row <= rows as f64 - 1.0 + EDGE_PX;
        for (col, out) in pixels {
            let at = self.col0 + col as f64 * self.cols_per_px;
            *out = if has_rows && at >= -EDGE_PX && at <= self.cols as f64 - 1.0 + EDGE_PX {
                let left = libm::floor(at);
                // One before the floor, which is at least -1 because of the slack.
                let start = (left as isize - 1 + PostGrid::GHOSTS as isize) as usize;
                let around = core::array::from_fn(|k| four(first + k as isize, rows, |row| kept(row, start)));
                let z = bicubic(&around, down, (at - left) as f32);
                if z.is_finite() { z } else { f32::NAN }
            } else {
                f32::NAN
            };
        }
    }
}

/// Returns four samples of a row, which may be up to two rows beyond the first or the last.
fn four(row: isize, rows: usize, kept: impl Fn(usize) -> [f32; 4]) -> [f32; 4] {
    let last = rows as isize - 1;
    let kept = |row: isize| kept(row.max(0) as usize);
    let beyond = |edge: isize, inner: isize| {
        let (edge_m, inner_m) = (kept(edge), kept(inner));
        let k = row.abs_diff(edge);
        core::array::from_fn(|i| continued(item(&edge_m, i), item(&inner_m, i), k))
    };
    if row < 0 {
        beyond(0, 1.min(last))
    } else if row > last {
        beyond(last, (last - 1).max(0))
    } else {
        kept(row)
    }
}

/// An interpolation of the coarse DTM's rows to lines; four rows are kept. The values are those of [`crate::resample`] on the whole grid,
/// independent of when rows are pushed.
///
/// ```
/// use elunar_core::strip::{PostGrid, Posts};
///
/// // Posts 4 pixels apart; a plane that falls by 1 m from row to row.
/// let mut memory = [0.0; Posts::memory_len(3)];
/// let mut posts = Posts::new(PostGrid::spaced(3, (0.0, 0.0), (4.0, 4.0)), &mut memory)?;
/// let (mut line_m, mut lines) = ([0.0; 9], 0);
/// for row in 0..3 {
///     posts.push_row(&[-row as f32; 3])?;
///     while let Some(line) = posts.line(&mut line_m) {
///         assert_eq!(line_m, [-0.25 * line as f32; 9]);
///         lines += 1;
///     }
/// }
/// // Line 4 lies on row 1. It needs row 3, or `finish`, which says that no row 3 follows.
/// assert_eq!(lines, 4);
/// posts.finish();
/// assert_eq!(posts.line(&mut line_m), Some(4));
/// # Ok::<(), elunar_core::strip::StripError>(())
/// ```
#[derive(Debug)]
pub struct Posts<'m> {
    grid: PostGrid,
    ring: &'m mut [f32],
    rows: usize,
    lines: usize,
    ended: bool,
}

impl<'m> Posts<'m> {
    /// Number of values of memory for rows of `cols` posts.
    #[must_use]
    pub const fn memory_len(cols: usize) -> usize {
        cols.saturating_add(2 * PostGrid::GHOSTS).saturating_mul(ROWS)
    }

    /// Makes the interpolation for a grid, in memory of [`memory_len`](Self::memory_len).
    ///
    /// # Errors
    /// [`StripError::Posts`] for a grid without columns, with a number that is not finite, or whose rows do not advance with lines;
    /// [`StripError::Memory`].
    pub fn new(grid: PostGrid, memory: &'m mut [f32]) -> Result<Self, StripError> {
        grid.check()?;
        let ring = lent(memory, Self::memory_len(grid.cols))?;
        Ok(Self { grid, ring, rows: 0, lines: 0, ended: false })
    }

    /// Takes the next row of posts, metres; a value that is not real ([`crate::mask`]) is a void.
    ///
    /// # Errors
    /// [`StripError::Full`] while the next line still needs the oldest row kept, [`StripError::Ended`], [`StripError::Line`].
    pub fn push_row(&mut self, posts_m: &[f32]) -> Result<(), StripError> {
        whole_line(self.grid.cols, posts_m.len())?;
        if self.ended {
            return Err(StripError::Ended);
        }
        if self.rows >= ROWS && self.grid.oldest(self.lines) <= self.rows - ROWS {
            return Err(StripError::Full);
        }
        let stride = self.grid.stride();
        let line = part_mut(self.ring, self.rows % ROWS * stride, stride);
        line.iter_mut().zip(PostGrid::with_ghosts(posts_m)).for_each(|(to, z)| *to = z);
        self.rows = self.rows.saturating_add(1);
        Ok(())
    }

    /// Ends the rows: lines up to the outer edge of the last row are continued from it, lines beyond are NaN.
    pub fn finish(&mut self) {
        self.ended = true;
    }

    /// Writes the next line, metres, NaN without heights, and returns its number; `None` if it needs another row first. A line has as many
    /// columns as `out_m`.
    pub fn line(&mut self, out_m: &mut [f32]) -> Option<usize> {
        if !self.ended && !self.grid.is_ready(self.lines, self.rows) {
            return None;
        }
        let (ring, stride) = (&*self.ring, self.grid.stride());
        let kept = |row: usize, start: usize| {
            let mut four = [0.0; 4];
            copy(&mut four, part(ring, row % ROWS * stride + start, 4));
            four
        };
        self.grid.interpolate(self.lines, self.rows, out_m.iter_mut().enumerate(), kept);
        let line = self.lines;
        self.lines = line.saturating_add(1);
        Some(line)
    }
}
