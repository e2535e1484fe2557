//! The two outermost rows or columns along one edge of [`super::up2`]. Three small rows become four upsampled ones, and the convolution
//! makes two of them. Across the edge both steps are folded into one kernel; along it they follow each other.
//!
//! All four edges use the same strip, with one axis from the edge inwards ("deep") and one along it. Kernels are rotated accordingly.

use super::correlate::correlate;
use super::frame::Frame;
use super::product::{Area, Taps, multiply};
use super::scratch::Scratch;
use super::smooth::{FAR, NEAR};
use super::up2::Shape;
use rayon::prelude::*;

/// Side of the kernel.
const SIDE: usize = 5;
/// Number of weights of a kernel.
const KERNEL: usize = SIDE * SIDE;
/// Small rows and output rows of a strip.
const SMALL: usize = 3;
const OUT: usize = 2;
/// Least number of kernels for a separate task.
const MIN_KERNELS: usize = 512;
/// Columns that a kernel reads.
const REACH: [isize; SIDE] = [-2, -1, 0, 1, 2];
/// Number of weights of a folded kernel: small rows times columns.
const FOLDED: usize = SMALL * SIDE;

/// Folds one column of a kernel's rows into the weights of each small row for output row 0 and for output row 1.
///
/// Counted from the edge, which is repeated, the upsampled rows are `s0, (3 s0 + s1) / 4, (s0 + 3 s1) / 4, (3 s1 + s2) / 4`. Kernel row r
/// is multiplied with upsampled row r - 2 for output row 0, with r - 1 for output row 1, and with zeros beyond the edge.
#[inline(always)]
fn fold_column([_, b, c, d, e]: [f32; SIDE]) -> [[f32; SMALL]; OUT] {
    let first = [c + NEAR * d + FAR * e, FAR * d + NEAR * e, 0.0];
    let second = [b + NEAR * c + FAR * d, FAR * c + NEAR * (d + e), FAR * e];
    [first, second]
}

/// Applies the transpose of [`fold_column`].
#[inline(always)]
fn unfold_column([[f0, f1, _], [s0, s1, s2]]: [[f32; SMALL]; OUT]) -> [f32; SIDE] {
    let c = f0 + NEAR * s0 + FAR * s1;
    let d = NEAR * (f0 + s1) + FAR * (f1 + s0);
    let e = FAR * (f0 + s2) + NEAR * (f1 + s1);
    [0.0, s0, c, d, e]
}

/// Folds every kernel of `weight`. `at(row, column)` is the index of a row and column in the kernel.
fn fold(weight: &[f32], at: impl Fn(usize, usize) -> usize + Copy + Sync) -> Scratch {
    let kernels = weight.len() / KERNEL;
    let mut folded = Scratch::new(OUT * kernels * FOLDED);
    let (first, second) = folded.split_at_mut(kernels * FOLDED);
    let to = first.par_chunks_exact_mut(FOLDED).zip(second.par_chunks_exact_mut(FOLDED));
    to.zip(weight.par_chunks_exact(KERNEL)).with_min_len(MIN_KERNELS).for_each(|((first, second), kernel)| {
        for x in 0..SIDE {
            let [of_first, of_second] = fold_column(std::array::from_fn(|row| kernel[at(row, x)]));
            for small in 0..SMALL {
                first[small * SIDE + x] = of_first[small];
                second[small * SIDE + x] = of_second[small];
            }
        }
    });
    folded
}

/// Adds the gradient of the folded weights, unfolded, to the gradient of the weights. `at` is as in [`fold`].
fn unfold(folded: &[f32], whole: &mut [f32], at: impl Fn(usize, usize) -> usize + Copy + Sync) {
    let (first, second) = folded.split_at(whole.len() / KERNEL * FOLDED);
    let from = first.par_chunks_exact(FOLDED).zip(second.par_chunks_exact(FOLDED));
    whole.par_chunks_exact_mut(KERNEL).zip(from).with_min_len(MIN_KERNELS).for_each(|(kernel, (first, second))| {
        for x in 0..SIDE {
            let small = |folded: &[f32]| std::array::from_fn(|small| folded[small * SIDE + x]);
            for (row, value) in unfold_column([small(first), small(second)]).into_iter().enumerate() {
                kernel[at(row, x)] += value;
            }
        }
    });
}

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
    /// First columns, without the corners.
    Left,
    /// Last columns, without the corners.
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
    fn length(self, shape: &Shape) -> usize {
        match self {
            Self::Top | Self::Bottom => shape.small[1],
            Self::Left | Self::Right => shape.small[0],
        }
    }

    /// Returns the output pixels along the edge that belong to this edge.
    fn own(self, shape: &Shape) -> std::ops::Range<usize> {
        match self {
            Self::Top | Self::Bottom => 0..2 * self.length(shape),
            Self::Left | Self::Right => 2..2 * self.length(shape) - 2,
        }
    }

    /// Returns the layout: one line per channel and small row, and per output row and channel.
    fn frame(self, shape: &Shape) -> Frame {
        Frame::new(shape.images, [1, 2 * self.length(shape)], [0, SIDE / 2])
    }

    /// Returns the strip, upsampled along the edge, as lines.
    fn input_lines(self, shape: &Shape, frame: &Frame, x: &[f32]) -> Scratch {
        let (length, channels) = (self.length(shape), shape.channels[0]);
        let plane = shape.small[0] * shape.small[1];
        let mut lines = Scratch::new(channels * SMALL * frame.length);
        frame.fill(&mut lines, |line, image, _, to| {
            let map = &x[(image * channels + line / SMALL) * plane..][..plane];
            let small = |along: usize| map[self.index(shape.small, line % SMALL, along)];
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
    fn gradient_lines(self, shape: &Shape, frame: &Frame, gradient: &[f32]) -> Scratch {
        let (outputs, own) = (shape.channels[1], self.own(shape));
        let mut lines = Scratch::new(OUT * outputs * frame.length);
        frame.fill(&mut lines, |line, image, _, to| {
            to[..own.start].fill(0.0);
            for along in own.clone() {
                to[along] = gradient[self.output(shape, image * outputs + line % outputs, line / outputs, along)];
            }
            own.end
        });
        lines
    }

    /// Returns the folded weights `[OUT * outputs, inputs, SMALL, SIDE]`.
    fn fold(self, weight: &[f32]) -> Scratch {
        // One loop per edge, so that the compiler knows the indices of each.
        match self {
            Self::Top => fold(weight, |row, x| Self::Top.index([SIDE; 2], row, x)),
            Self::Bottom => fold(weight, |row, x| Self::Bottom.index([SIDE; 2], row, x)),
            Self::Left => fold(weight, |row, x| Self::Left.index([SIDE; 2], row, x)),
            Self::Right => fold(weight, |row, x| Self::Right.index([SIDE; 2], row, x)),
        }
    }

    /// Adds the gradient of the folded weights, unfolded, to the gradient of the weights.
    fn unfold(self, folded: &[f32], whole: &mut [f32]) {
        match self {
            Self::Top => unfold(folded, whole, |row, x| Self::Top.index([SIDE; 2], row, x)),
            Self::Bottom => unfold(folded, whole, |row, x| Self::Bottom.index([SIDE; 2], row, x)),
            Self::Left => unfold(folded, whole, |row, x| Self::Left.index([SIDE; 2], row, x)),
            Self::Right => unfold(folded, whole, |row, x| Self::Right.index([SIDE; 2], row, x)),
        }
    }

    /// Returns the positions in the input's lines that an output reads, in the order of the folded weights.
    fn shifts(self, shape: &Shape, frame: &Frame) -> Vec<usize> {
        let lines = 0..shape.channels[0] * SMALL;
        lines.flat_map(|line| REACH.map(move |dx| (line, dx))).map(|(line, dx)| frame.neighbour(line, 0, dx)).collect()
    }

    /// Returns the index in the output of a pixel of the strip.
    fn output(self, shape: &Shape, map: usize, deep: usize, along: usize) -> usize {
        let size = shape.small.map(|n| 2 * n);
        map * size[0] * size[1] + self.index(size, deep, along)
    }

    /// Writes this edge's pixels of the output.
    pub(super) fn forward(self, shape: &Shape, x: &[f32], weight: &[f32], out: &mut [f32]) {
        let (frame, outputs) = (self.frame(shape), shape.channels[1]);
        let lines = self.input_lines(shape, &frame, x);
        let (folded, depth) = (self.fold(weight), shape.channels[0] * FOLDED);
        let columns: Vec<usize> = (0..depth).collect();
        let taps = Taps::new(OUT * outputs, self.shifts(shape, &frame), &folded, |m| m * depth, &columns);
        let wide = 2 * self.length(shape);
        let mut strip = Scratch::new(shape.images * OUT * outputs * wide);
        multiply_rows(&taps, &lines, &frame, wide, &mut strip);
        for (i, row) in strip.chunks_exact(wide).enumerate() {
            let (deep, channel, image) = (i / shape.images / outputs, i / shape.images % outputs, i % shape.images);
            for along in self.own(shape) {
                out[self.output(shape, image * outputs + channel, deep, along)] = row[along];
            }
        }
    }

    /// Adds the gradients of input and weight from this edge's pixels of the output.
    pub(super) fn backward(
        self,
        shape: &Shape,
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
            self.unfold(&correlate(&lines, &input, &self.shifts(shape, &frame), &frame), whole);
        }
    }

    fn input_gradient(self, shape: &Shape, frame: &Frame, lines: &[f32], weight: &[f32], whole: &mut [f32]) {
        let ([inputs, outputs], length) = (shape.channels, self.length(shape));
        let folded = self.fold(weight);
        let reads = (0..OUT * outputs).flat_map(|line| REACH.map(move |dx| (line, dx)));
        let shifts = reads.map(|(line, dx)| frame.neighbour(line, 0, -dx)).collect();
        let columns: Vec<usize> = (0..OUT * outputs * SIDE).map(|k| k / SIDE * inputs * FOLDED + k % SIDE).collect();
        // In the folded weights, small rows are consecutive, and so are inputs.
        let taps = Taps::new(inputs * SMALL, shifts, &folded, |m| m * SIDE, &columns);
        let wide = 2 * length;
        let mut up = Scratch::new(shape.images * inputs * SMALL * wide);
        multiply_rows(&taps, lines, frame, wide, &mut up);
        // This is the transpose of the upsampling along the edge.
        let plane = shape.small[0] * shape.small[1];
        for (i, row) in up.chunks_exact(wide).enumerate() {
            let (input, small, image) = (i / shape.images / SMALL, i / shape.images % SMALL, i % shape.images);
            let map = &mut whole[(image * inputs + input) * plane..][..plane];
            for along in 0..length {
                let (left, right) = (row[2 * along], row[2 * along + 1]);
                let before = if along == 0 { left } else { row[2 * along - 1] };
                let after = if along + 1 == length { right } else { row[2 * along + 2] };
                let value = 0.25 * (before + after) + 0.75 * (left + right);
                map[self.index(shape.small, small, along)] += value;
            }
        }
    }
}
