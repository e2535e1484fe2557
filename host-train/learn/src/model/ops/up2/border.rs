//! What the two outermost rows or columns along one edge of the upsampled map need besides the smoothed phases.
//!
//! The smoothing takes phases beyond the edge as zero, where in truth the edge is repeated. The convolution has zeros beyond the edge of
//! the upsampled map, where the smoothed phases repeat it. Both differences depend on the outermost small row alone: upsampled along the
//! edge, it is convolved with one folded kernel for each of the two output rows, and the result is added.
//!
//! All four edges use the same strip, with one axis from the edge inwards ("deep") and one along it. Kernels are rotated accordingly. At
//! the corners, strips along two edges meet. So those along rows leave out what belongs to both ([`super::ends`]).

use super::super::correlate::correlate;
use super::super::frame::Frame;
use super::super::product::{Area, Taps, multiply};
use super::super::scratch::Scratch;
use super::ends;
use super::fold::{FIRST, LAST, OUT, fold, unfold};
use super::shape::{SIDE, Up2Shape};

/// Columns that a kernel reads.
const REACH: [isize; SIDE] = [-2, -1, 0, 1, 2];

/// Writes `[outputs, images, columns]` from lines whose images have one row each.
fn multiply_rows(taps: &Taps, lines: &[f32], frame: &Frame, cols: usize, out: &mut [f32]) {
    multiply(taps, lines, &frame.images_as_rows(), Area { origin: [0, 0], size: [frame.images, cols] }, out);
}

/// An edge of the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Edge {
    /// First rows.
    Top,
    /// Last rows.
    Bottom,
    /// First columns.
    Left,
    /// Last columns.
    Right,
}

impl Edge {
    /// All edges.
    pub(super) const ALL: [Self; 4] = [Self::Top, Self::Bottom, Self::Left, Self::Right];

    /// Returns the index in a map (or kernel) of `size` of the value `deep` from the edge, at `along` it.
    #[inline(always)]
    fn index(self, [rows, cols]: [usize; 2], deep: usize, along: usize) -> usize {
        match self {
            Self::Top => deep * cols + along,
            Self::Bottom => (rows - 1 - deep) * cols + along,
            Self::Left => along * cols + deep,
            Self::Right => along * cols + cols - 1 - deep,
        }
    }

    /// Returns the number of small pixels along the edge.
    fn length(self, shape: &Up2Shape) -> usize {
        match self {
            Self::Top | Self::Bottom => shape.small[1],
            Self::Left | Self::Right => shape.small[0],
        }
    }

    /// Returns whether the edge is along rows.
    fn along_rows(self) -> bool {
        matches!(self, Self::Top | Self::Bottom)
    }

    /// Returns the layout: one line per channel, and per output row and channel.
    fn frame(self, shape: &Up2Shape) -> Frame {
        Frame::new(shape.images, [1, 2 * self.length(shape)], [0, SIDE / 2])
    }

    /// Returns the strip, upsampled along the edge, as lines.
    fn input_lines(self, shape: &Up2Shape, frame: &Frame, x: &[f32]) -> Scratch {
        let (length, channels) = (self.length(shape), shape.channels[0]);
        let plane = shape.small[0] * shape.small[1];
        let mut lines = Scratch::new(channels * frame.length);
        frame.fill(&mut lines, |channel, image, _, to| {
            let map = &x[(image * channels + channel) * plane..][..plane];
            let small = |along: usize| map[self.index(shape.small, 0, along)];
            let (mut before, mut here) = (small(0), small(0));
            for (along, pair) in to[..2 * length].chunks_exact_mut(2).enumerate() {
                let after = small((along + 1).min(length - 1));
                pair[0] = 0.25 * before + 0.75 * here;
                pair[1] = 0.75 * here + 0.25 * after;
                (before, here) = (here, after);
            }
            2 * length
        });
        lines
    }

    /// Returns the gradient of this edge's output pixels as lines.
    fn gradient_lines(self, shape: &Up2Shape, frame: &Frame, gradient: &[f32]) -> Scratch {
        let (outputs, wide) = (shape.channels[1], 2 * self.length(shape));
        let mut lines = Scratch::new(OUT * outputs * frame.length);
        frame.fill(&mut lines, |line, image, _, to| {
            for (along, to) in to[..wide].iter_mut().enumerate() {
                *to = gradient[self.output(shape, image * outputs + line % outputs, line / outputs, along)];
            }
            wide
        });
        lines
    }

    /// Returns the folded weights `[OUT * outputs, inputs, SIDE]`.
    fn fold(self, weight: &[f32]) -> Scratch {
        // One loop per edge, so that the compiler knows the indices of each.
        match self {
            Self::Top => fold(weight, &FIRST, |row, x| Self::Top.index([SIDE; 2], row, x)),
            Self::Bottom => fold(weight, &LAST, |row, x| Self::Bottom.index([SIDE; 2], row, x)),
            Self::Left => fold(weight, &FIRST, |row, x| Self::Left.index([SIDE; 2], row, x)),
            Self::Right => fold(weight, &LAST, |row, x| Self::Right.index([SIDE; 2], row, x)),
        }
    }

    /// Adds the gradient of the folded weights, unfolded, to the gradient of the weights.
    fn unfold(self, folded: &[f32], whole: &mut [f32]) {
        match self {
            Self::Top => unfold(folded, whole, &FIRST, |row, x| Self::Top.index([SIDE; 2], row, x)),
            Self::Bottom => unfold(folded, whole, &LAST, |row, x| Self::Bottom.index([SIDE; 2], row, x)),
            Self::Left => unfold(folded, whole, &FIRST, |row, x| Self::Left.index([SIDE; 2], row, x)),
            Self::Right => unfold(folded, whole, &LAST, |row, x| Self::Right.index([SIDE; 2], row, x)),
        }
    }

    /// Returns the small pixels at the strip's ends, `[ends, channels, images]`.
    fn corners(self, shape: &Up2Shape, x: &[f32]) -> Vec<f32> {
        let (plane, [_, last]) = (shape.small[0] * shape.small[1], shape.small.map(|n| n - 1));
        let corner = |along| {
            let at = self.index(shape.small, 0, along);
            let maps = move |channel| (0..shape.images).map(move |image| image * shape.channels[0] + channel);
            (0..shape.channels[0]).flat_map(maps).map(move |map| x[map * plane + at])
        };
        [0, last].into_iter().flat_map(corner).collect()
    }

    /// Returns the positions in the input's lines that an output reads, in the order of the folded weights.
    fn shifts(self, shape: &Up2Shape, frame: &Frame) -> Vec<usize> {
        let lines = 0..shape.channels[0];
        lines.flat_map(|line| REACH.map(move |dx| (line, dx))).map(|(line, dx)| frame.neighbour(line, 0, dx)).collect()
    }

    /// Returns the index in the output of a pixel of the strip.
    fn output(self, shape: &Up2Shape, map: usize, deep: usize, along: usize) -> usize {
        let size = shape.small.map(|n| 2 * n);
        map * size[0] * size[1] + self.index(size, deep, along)
    }

    /// Adds this edge's part to the output.
    pub(super) fn forward(self, shape: &Up2Shape, x: &[f32], weight: &[f32], out: &mut [f32]) {
        let (frame, outputs) = (self.frame(shape), shape.channels[1]);
        let lines = self.input_lines(shape, &frame, x);
        let (folded, depth) = (self.fold(weight), shape.channels[0] * SIDE);
        let columns: Vec<usize> = (0..depth).collect();
        let taps = Taps::new(OUT * outputs, self.shifts(shape, &frame), &folded, |m| m * depth, &columns);
        let wide = 2 * self.length(shape);
        let mut strip = Scratch::new(shape.images * OUT * outputs * wide);
        multiply_rows(&taps, &lines, &frame, wide, &mut strip);
        if self.along_rows() {
            ends::forward(&self.corners(shape, x), &folded, shape, &mut strip);
        }
        for (i, row) in strip.chunks_exact(wide).enumerate() {
            let (deep, channel, image) = (i / shape.images / outputs, i / shape.images % outputs, i % shape.images);
            for (along, value) in row.iter().enumerate() {
                out[self.output(shape, image * outputs + channel, deep, along)] += value;
            }
        }
    }

    /// Adds the gradients of input and weight from this edge's pixels of the output.
    pub(super) fn backward(
        self,
        shape: &Up2Shape,
        x: &[f32],
        weight: &[f32],
        gradient: &[f32],
        [of_input, of_weight]: [Option<&mut [f32]>; 2],
    ) {
        let frame = self.frame(shape);
        let lines = self.gradient_lines(shape, &frame, gradient);
        if let Some(whole) = of_input {
            self.input_gradient(shape, &frame, &lines, weight, whole);
        }
        if let Some(whole) = of_weight {
            let input = self.input_lines(shape, &frame, x);
            let mut folded = correlate(&lines, &input, &self.shifts(shape, &frame), &frame);
            if self.along_rows() {
                let slope = ends::Slope::new(shape, &frame, &lines);
                slope.of_weight(&self.corners(shape, x), shape, &mut folded);
            }
            self.unfold(&folded, whole);
        }
    }

    fn input_gradient(self, shape: &Up2Shape, frame: &Frame, lines: &[f32], weight: &[f32], whole: &mut [f32]) {
        let ([inputs, outputs], length) = (shape.channels, self.length(shape));
        let folded = self.fold(weight);
        let reads = (0..OUT * outputs).flat_map(|line| REACH.map(move |dx| (line, dx)));
        let shifts = reads.map(|(line, dx)| frame.neighbour(line, 0, -dx)).collect();
        let columns: Vec<usize> = (0..OUT * outputs * SIDE).map(|k| k / SIDE * inputs * SIDE + k % SIDE).collect();
        let taps = Taps::new(inputs, shifts, &folded, |m| m * SIDE, &columns);
        let wide = 2 * length;
        let mut up = Scratch::new(shape.images * inputs * wide);
        multiply_rows(&taps, lines, frame, wide, &mut up);
        // This is the transpose of the upsampling along the edge.
        let plane = shape.small[0] * shape.small[1];
        for (i, row) in up.chunks_exact(wide).enumerate() {
            let map = &mut whole[(i % shape.images * inputs + i / shape.images) * plane..][..plane];
            for along in 0..length {
                let (left, right) = (row[2 * along], row[2 * along + 1]);
                let before = if along == 0 { left } else { row[2 * along - 1] };
                let after = if along + 1 == length { right } else { row[2 * along + 2] };
                let value = 0.25 * (before + after) + 0.75 * (left + right);
                map[self.index(shape.small, 0, along)] += value;
            }
        }
        if self.along_rows() {
            let slope = ends::Slope::new(shape, frame, lines);
            let corners = slope.of_corners(&folded, shape);
            for (i, value) in corners.iter().enumerate() {
                let (end, input, image) = (i / shape.images / inputs, i / shape.images % inputs, i % shape.images);
                let at = self.index(shape.small, 0, end * (length - 1));
                whole[(image * inputs + input) * plane + at] += value;
            }
        }
    }
}
