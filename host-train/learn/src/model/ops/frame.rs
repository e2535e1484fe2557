//! How the kernels lay out maps: each channel is one line of numbers, on which a step of the kernel is a step along the line.
//!
//! Pixel (y, x) of image b stands at `at(b, y, x)`; between rows and between images stand as many zeros as the kernel reaches
//! over an edge, so a neighbour (dy, dx) is always `dy * pitch + dx` further on, and one zero serves the row before and the row
//! after it. All images of a batch share a line: small maps make long lines, too.

use rayon::prelude::*;

/// Numbers a kernel may read beyond the last pixel: the widest block of pixels any of them computes at once.
pub(super) const SLACK: usize = 128;

/// Layout of one line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Frame {
    /// Images on the line.
    pub(super) images: usize,
    /// Rows of an image, zeros included.
    pub(super) rows: usize,
    /// Distance between rows, zeros included.
    pub(super) pitch: usize,
    /// Position of the first pixel.
    pub(super) front: usize,
    /// Length of a line, and distance between lines.
    pub(super) length: usize,
}

impl Frame {
    /// For maps of up to `size` rows and columns, and neighbours up to `reach` rows and columns away.
    pub(super) fn new(images: usize, size: [usize; 2], reach: [usize; 2]) -> Self {
        let (rows, pitch) = (size[0] + reach[0], size[1] + reach[1]);
        // Whole vectors before the first pixel: the lines of a gradient are read from there on.
        let front = (reach[0] * pitch + reach[1]).next_multiple_of(16);
        // An odd number of cache lines: lines a power of two apart would evict each other.
        let length = (2 * front + images * rows * pitch + SLACK).div_ceil(16) | 1;
        Self { images, rows, pitch, front, length: 16 * length }
    }

    /// Position of a pixel.
    pub(super) fn at(&self, image: usize, y: usize, x: usize) -> usize {
        self.front + (image * self.rows + y) * self.pitch + x
    }

    /// Position of a neighbour relative to a pixel, from the start of line `line`.
    ///
    /// # Panics
    /// If it lies beyond the reach.
    pub(super) fn neighbour(&self, line: usize, dy: isize, dx: isize) -> usize {
        let ahead = self.front as isize + dy * self.pitch as isize + dx;
        line * self.length + usize::try_from(ahead).expect("neighbour within the frame's reach")
    }

    /// The images of a line as the rows of one: blocks of pixels reach over them, which short rows are glad of.
    ///
    /// # Panics
    /// If images have more than one row.
    pub(super) fn images_as_rows(&self) -> Self {
        assert_eq!(self.rows, 1, "rows of an image");
        Self { images: 1, rows: self.images, ..*self }
    }

    /// From the first pixel's position to beyond the last one's.
    pub(super) fn span(&self) -> usize {
        self.images * self.rows * self.pitch
    }

    /// Fills `lines` line by line: `row(line, image, y, into)` writes the start of a row and returns how much it wrote; the
    /// rest becomes zero. `y` runs from 0 over all rows.
    pub(super) fn fill(&self, lines: &mut [f32], row: impl Fn(usize, usize, usize, &mut [f32]) -> usize + Sync) {
        lines.par_chunks_mut(self.length).enumerate().for_each(|(line, to)| {
            let (front, rest) = to.split_at_mut(self.front);
            let (body, back) = rest.split_at_mut(self.span());
            front.fill(0.0);
            back.fill(0.0);
            for (i, to) in body.chunks_exact_mut(self.pitch).enumerate() {
                let written = row(line, i / self.rows, i % self.rows, to);
                to[written..].fill(0.0);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_neighbour_over_an_edge_is_zero() {
        let frame = Frame::new(2, [3, 4], [1, 2]);
        let mut line = vec![f32::NAN; frame.length];
        frame.fill(&mut line, |_, b, y, to| {
            if y < 3 {
                to[..4].fill((1 + b) as f32);
            }
            if y < 3 { 4 } else { 0 }
        });
        for (b, y, x) in (0..24).map(|i| (i / 12, i / 4 % 3, i % 4)) {
            for (dy, dx) in (0..15).map(|i| (i / 5 - 1, i % 5 - 2)) {
                let inside = (0..3).contains(&(y as isize + dy)) && (0..4).contains(&(x as isize + dx));
                let found = line[frame.at(b, y, x) - frame.front + frame.neighbour(0, dy, dx)];
                assert_eq!(found, if inside { (1 + b) as f32 } else { 0.0 });
            }
        }
    }
}
