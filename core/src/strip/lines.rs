//! The lines kept: rings of the image and of the coarse DTM, from which tiles are cut.

use super::posts::PostGrid;
use super::ring::{PIECE, Ring, put_floats};
use crate::mask::real;
use crate::part::{copy, head_mut};
use crate::pixels::{PixelForm, PixelFormat};
use crate::samples::Samples;
use crate::tile::{Shape, Window};

/// Image and coarse DTM of the last lines.
#[derive(Debug)]
pub(super) struct Lines<'m> {
    pub(super) image: Ring<'m>,
    /// Lines of coarse heights as floats, or rows of posts with those by which they are continued.
    pub(super) coarse: Ring<'m>,
    pub(super) form: PixelForm,
    pub(super) posts: Option<PostGrid>,
    pub(super) cols: usize,
}

/// How much of a strip is known: lines, and rows of posts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    pub(super) lines: usize,
    pub(super) post_rows: usize,
}

impl Lines<'_> {
    /// Stores line `row` of the image.
    pub(super) fn keep(&mut self, row: usize, image: &[u8]) {
        self.image.write(row, |bytes| copy(bytes, image));
    }

    /// Stores line `row` of coarse heights.
    pub(super) fn keep_coarse(&mut self, row: usize, coarse_m: &[f32]) {
        self.coarse.write(row, |bytes| put_floats(bytes, coarse_m.iter().map(|z| real(*z))));
    }

    /// Stores row `row` of posts.
    pub(super) fn keep_posts(&mut self, row: usize, posts_m: &[f32]) {
        self.coarse.write(row, |bytes| put_floats(bytes, PostGrid::with_ghosts(posts_m)));
    }

    /// Compares what a tile takes of the image, and of the coarse DTM if `with_coarse`, with its checksums. Returns the number of pieces that
    /// are lost since the last time.
    pub(super) fn check(&mut self, window: Window, known: Known, with_coarse: bool) -> u64 {
        let end = window.row.saturating_add(window.rows).min(known.lines);
        let last = window.col.saturating_add(window.cols).min(self.cols);
        let bytes = |format: PixelFormat| format.row_bytes(window.col)..format.row_bytes(last);
        let (image, floats) = (bytes(self.form.format), bytes(PixelFormat::F32));
        let mut lost = (window.row..end).map(|row| self.image.check(row, image.clone())).sum();
        if with_coarse {
            let (rows, range) = match &self.posts {
                Some(grid) => (grid.rows_of(window.row..end, known.post_rows), 0..usize::MAX),
                None => (window.row..end, floats),
            };
            lost += rows.map(|row| self.coarse.check(row, range.clone())).sum::<u64>();
        }
        lost
    }

    /// Number of bytes that [`Self::check`] compares, about.
    pub(super) fn check_bytes(&self, window: Window) -> usize {
        window.rows * (self.form.format.row_bytes(window.cols) + PIECE)
    }

    /// Returns image and coarse heights of a tile. Beyond its last line and column the strip repeats them.
    pub(super) fn tile(&self, window: Window, known: Known) -> (RingTile<'_>, CoarseTile<'_>) {
        let (rows, cols) = (known.lines, self.cols);
        let place = Place { window, rows, cols };
        let coarse = match &self.posts {
            Some(grid) => CoarseTile::Posts { ring: &self.coarse, grid, rows: known.post_rows, place },
            None => CoarseTile::Lines(RingTile { ring: &self.coarse, form: PixelForm::F32, place }),
        };
        (RingTile { ring: &self.image, form: self.form, place }, coarse)
    }

    /// Returns line `row` of the image.
    pub(super) fn line(&self, row: usize) -> RingTile<'_> {
        let window = Window { row, col: 0, rows: 1, cols: self.cols };
        let place = Place { window, rows: usize::MAX, cols: self.cols };
        RingTile { ring: &self.image, form: self.form, place }
    }
}

/// The place of a tile in a strip.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    window: Window,
    /// Lines and columns of the strip.
    rows: usize,
    cols: usize,
}

impl Place {
    /// Returns line and column of a sample, which may be beyond the last column.
    fn of(&self, index: usize) -> (usize, usize) {
        let (row, col) = (index / self.window.cols.max(1), index % self.window.cols.max(1));
        (self.window.row.saturating_add(row).min(self.rows.saturating_sub(1)), self.window.col.saturating_add(col))
    }
}

/// The samples of a tile in a ring of pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct RingTile<'m> {
    ring: &'m Ring<'m>,
    form: PixelForm,
    place: Place,
}

impl Samples for RingTile<'_> {
    fn len(&self) -> usize {
        self.place.window.shape().pixels()
    }

    fn at(&self, index: usize) -> f32 {
        let mut sample = [f32::NAN];
        self.read(index, &mut sample);
        sample[0]
    }

    fn read(&self, first: usize, out: &mut [f32]) {
        let ((row, col), cols) = (self.place.of(first), self.place.cols);
        let line = self.ring.line(row);
        let pixels = self.form.pixels(line.bytes, Shape::new(1, cols));
        let inside = out.len().min(cols.saturating_sub(col));
        pixels.read(col, head_mut(out, inside));
        let byte = |col: usize| self.form.format.row_bytes(col.saturating_add(1)).saturating_sub(1);
        let (from, to) = (byte(col) / PIECE, byte(col.saturating_add(inside)) / PIECE);
        if (from..=to).any(|piece| piece * PIECE < line.bytes.len() && line.is_lost(piece * PIECE)) {
            let lost = |col: &usize| line.is_lost(byte(*col));
            out.iter_mut().zip(col..col + inside).filter(|(_, col)| lost(col)).for_each(|(v, _)| *v = f32::NAN);
        }
        if inside < out.len() {
            let last = cols.saturating_sub(1);
            let beyond = if line.is_lost(byte(last)) { f32::NAN } else { pixels.at(last) };
            out.iter_mut().skip(inside).for_each(|v| *v = beyond);
        }
    }
}

/// The coarse heights of a tile.
#[derive(Debug, Clone, Copy)]
pub(super) enum CoarseTile<'m> {
    Lines(RingTile<'m>),
    /// From posts, of which `rows` rows have come.
    Posts {
        ring: &'m Ring<'m>,
        grid: &'m PostGrid,
        rows: usize,
        place: Place,
    },
}

impl Samples for CoarseTile<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Lines(tile) => tile.len(),
            Self::Posts { place, .. } => place.window.shape().pixels(),
        }
    }

    fn at(&self, index: usize) -> f32 {
        let mut sample = [f32::NAN];
        self.read(index, &mut sample);
        sample[0]
    }

    fn read(&self, first: usize, out: &mut [f32]) {
        match *self {
            Self::Lines(tile) => tile.read(first, out),
            Self::Posts { ring, grid, rows, place } => {
                let (row, col) = place.of(first);
                let last = place.cols.saturating_sub(1);
                let kept = |row: usize, start: usize| {
                    let line = ring.line(row);
                    core::array::from_fn(|k| line.float(start + k))
                };
                grid.interpolate(row, rows, (col..).map(|col| col.min(last)).zip(out), kept);
            }
        }
    }

    fn work(&self) -> u64 {
        if let Self::Posts { .. } = self { crate::posts::WORK } else { 0 }
    }
}
