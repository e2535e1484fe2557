//! Layout of maps for the kernels. Each channel is one line of numbers, so that a step of the kernel is a step along the line.
//!
//! Pixel (y, x) of image b is at `at(b, y, x)`. Between rows and between images there are as many zeros as the kernel reads beyond an edge.
//! So a neighbour (dy, dx) is always at distance `dy * pitch + dx`, and one zero serves the row before and the row after it. All images of
//! a batch share a line, so that small maps also make long lines.

use rayon::prelude::*;

/// Number of values that a kernel may read beyond the last pixel: the widest block of pixels that any kernel computes at once.
pub(super) const SLACK: usize = 128;

/// Layout of one line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Frame {
    /// Number of images on the line.
    pub(super) images: usize,
    /// Number of rows of an image, with zeros.
    pub(super) rows: usize,
    /// Distance between rows, with zeros.
    pub(super) pitch: usize,
    /// Position of the first pixel.
    pub(super) front: usize,
    /// Length of a line, and distance between lines.
    pub(super) length: usize,
}

impl Frame {
    /// Makes the layout for maps of up to `size` rows and columns, and neighbours up to `reach` rows and columns away.
    pub(super) fn new(images: usize, size: [usize; 2], reach: [usize; 2]) -> Self {
        let (rows, pitch) = (size[0] + reach[0], size[1] + reach[1]);
        // Whole vectors before the first pixel, because the lines of a gradient are read from there on.
        let front = (reach[0] * pitch + reach[1]).next_multiple_of(16);
        // An odd number of cache lines, because lines at distances of a power of two would evict each other.
        let length = (2 * front + images * rows * pitch + SLACK).div_ceil(16) | 1;
        Self { images, rows, pitch, front, length: 16 * length }
    }

    /// Returns the position of a pixel.
    pub(super) fn at(&self, image: usize, y: usize, x: usize) -> usize {
        self.front + (image * self.rows + y) * self.pitch + x
    }

    /// Returns the position of a neighbour relative to a pixel, from the start of line `line`.
    ///
    /// # Panics
    /// If the neighbour lies beyond the reach.
    pub(super) fn neighbour(&self, line: usize, dy: isize, dx: isize) -> usize {
        let ahead = self.front as isize + dy * self.pitch as isize + dx;
        line * self.length + usize::try_from(ahead).expect("neighbour within the frame's reach")
    }

    /// Returns a layout with the images of a line as the rows of one image. Blocks of pixels then extend over several short rows.
    ///
    /// # Panics
    /// If images have more than one row.
    pub(super) fn images_as_rows(&self) -> Self {
        assert_eq!(self.rows, 1, "rows of an image");
        Self { images: 1, rows: self.images, ..*self }
    }

    /// Returns the distance from the first pixel to the position beyond the last one.
    pub(super) fn span(&self) -> usize {
        self.images * self.rows * self.pitch
    }

    /// Fills `lines` line by line. `row(line, image, y, into)` writes the start of a row and returns the number of values written; the rest
    /// becomes zero. `y` runs from 0 over all rows.
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
