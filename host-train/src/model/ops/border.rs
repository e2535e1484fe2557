//! The two outermost rows or columns along one edge of [`super::up2`]: three small rows make four upsampled ones, which the
//! convolution turns into two. Across the edge both steps are folded into one kernel; along it they follow each other.
//!
//! All four edges are the same strip, seen from the edge inwards ("deep") and along it; kernels turn with it.

use super::correlate::correlate;
use super::frame::Frame;
use super::product::{Area, Taps, multiply};
use super::scratch::Scratch;
use super::up2::Shape;
use pulp::Arch;
use rayon::prelude::*;

/// Side of the kernel.
const SIDE: usize = 5;
/// Numbers of a kernel.
const KERNEL: usize = SIDE * SIDE;
/// Small rows, upsampled rows and output rows of a strip.
const SMALL: usize = 3;
const UP: usize = 4;
const OUT: usize = 2;
/// Kernels of a task.
const TOGETHER: usize = 512;
/// A kernel's row with what makes it a whole vector.
const WIDE: usize = 8;
/// Columns a kernel reaches.
const REACH: [isize; SIDE] = [-2, -1, 0, 1, 2];
/// Numbers of a folded kernel: small rows by columns.
const FOLDED: usize = SMALL * SIDE;

/// `DEEP[u][s]`: share of small row s in upsampled row u, counted from the edge, which is repeated.
const DEEP: [[f32; SMALL]; UP] = [[1.0, 0.0, 0.0], [0.75, 0.25, 0.0], [0.25, 0.75, 0.0], [0.0, 0.75, 0.25]];

/// `SHARES[out][small][row]`: what kernel row `row` contributes to output row `out` per unit of small row `small`, in all columns alike.
const SHARES: [[[f32; SIDE]; SMALL]; OUT] = {
    let mut shares = [[[0.0; SIDE]; SMALL]; OUT];
    let mut i = 0;
    while i < OUT * SMALL * SIDE {
        let (out, small, row) = (i / SIDE / SMALL, i / SIDE % SMALL, i % SIDE);
        // The kernel's middle row meets upsampled row `out`.
        if out + row >= SIDE / 2 && out + row - SIDE / 2 < UP {
            shares[out][small][row] = DEEP[out + row - SIDE / 2][small];
        }
        i += 1;
    }
    shares
};

/// Writes `[outputs, images, columns]` of lines whose images have one row each.
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
    /// All of them.
    pub(super) const ALL: [Self; 4] = [Self::Top, Self::Bottom, Self::Left, Self::Right];

    /// Index into a map (or kernel) of `size` of what is `deep` from the edge and at `along` it.
    fn index(self, [rows, cols]: [usize; 2], deep: usize, along: usize) -> usize {
        match self {
            Self::Top => deep * cols + along,
            Self::Bottom => (rows - 1 - deep) * cols + along,
            Self::Left => along * cols + deep,
            Self::Right => along * cols + cols - 1 - deep,
        }
    }

    /// Small pixels along the edge.
    fn length(self, shape: &Shape) -> usize {
        match self {
            Self::Top | Self::Bottom => shape.small[1],
            Self::Left | Self::Right => shape.small[0],
        }
    }

    /// Output pixels along the edge that are this edge's.
    fn own(self, shape: &Shape) -> std::ops::Range<usize> {
        match self {
            Self::Top | Self::Bottom => 0..2 * self.length(shape),
            Self::Left | Self::Right => 2..2 * self.length(shape) - 2,
        }
    }

    /// One line per channel and small row, and per output row and channel.
    fn frame(self, shape: &Shape) -> Frame {
        Frame::new(shape.images, [1, 2 * self.length(shape)], [0, SIDE / 2])
    }

    /// The strip, upsampled along the edge, as lines.
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

    /// The gradient of this edge's pixels of the output as lines.
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

    /// Where the numbers of the turned kernel stand in the kernel.
    fn turned(self) -> [usize; KERNEL] {
        std::array::from_fn(|k| self.index([SIDE; 2], k / SIDE, k % SIDE))
    }

    /// The folded weights `[OUT * outputs, inputs, SMALL, SIDE]`.
    fn fold(self, weight: &[f32]) -> Scratch {
        let (turned, kernels, arch) = (self.turned(), weight.len() / KERNEL, Arch::new());
        let mut folded = Scratch::new(OUT * kernels * FOLDED);
        let (first, second) = folded.split_at_mut(kernels * FOLDED);
        let to = first.par_chunks_mut(TOGETHER * FOLDED).zip(second.par_chunks_mut(TOGETHER * FOLDED));
        to.zip(weight.par_chunks(TOGETHER * KERNEL)).for_each(|((first, second), weight)| {
            let to = first.chunks_exact_mut(FOLDED).zip(second.chunks_exact_mut(FOLDED));
            arch.dispatch(|| {
                for ((first, second), kernel) in to.zip(weight.chunks_exact(KERNEL)) {
                    let mut rows = [0.0; KERNEL + WIDE];
                    rows.iter_mut().zip(turned).for_each(|(to, k)| *to = kernel[k]);
                    for (to, shares) in [first, second].into_iter().zip(&SHARES) {
                        for (to, shares) in to.chunks_exact_mut(SIDE).zip(shares) {
                            let mut sums = [0.0; WIDE];
                            for (row, share) in shares.iter().enumerate() {
                                let row = &rows[row * SIDE..][..WIDE];
                                sums.iter_mut().zip(row).for_each(|(sum, from)| *sum += share * from);
                            }
                            to.copy_from_slice(&sums[..SIDE]);
                        }
                    }
                }
            });
        });
        folded
    }

    /// Adds to the gradient of the weights what that of the folded weights says.
    fn unfold(self, folded: &[f32], whole: &mut [f32]) {
        let (turned, kernels, arch) = (self.turned(), whole.len() / KERNEL, Arch::new());
        let (first, second) = folded.split_at(kernels * FOLDED);
        let from = first.par_chunks(TOGETHER * FOLDED).zip(second.par_chunks(TOGETHER * FOLDED));
        whole.par_chunks_mut(TOGETHER * KERNEL).zip(from).for_each(|(whole, (first, second))| {
            let from = first.chunks_exact(FOLDED).zip(second.chunks_exact(FOLDED));
            arch.dispatch(|| {
                for (kernel, (first, second)) in whole.chunks_exact_mut(KERNEL).zip(from) {
                    let mut rows = [[0.0; WIDE]; SIDE];
                    for (from, shares) in [first, second].into_iter().zip(&SHARES) {
                        for (from, shares) in from.chunks_exact(SIDE).zip(shares) {
                            let mut small = [0.0; WIDE];
                            small[..SIDE].copy_from_slice(from);
                            for (row, share) in rows.iter_mut().zip(shares) {
                                row.iter_mut().zip(small).for_each(|(sum, from)| *sum += share * from);
                            }
                        }
                    }
                    for (k, &to) in turned.iter().enumerate() {
                        kernel[to] += rows[k / SIDE][k % SIDE];
                    }
                }
            });
        });
    }

    /// Where an output reads the input's lines, in the order of the folded weights.
    fn shifts(self, shape: &Shape, frame: &Frame) -> Vec<usize> {
        let lines = 0..shape.channels[0] * SMALL;
        lines.flat_map(|line| REACH.map(move |dx| (line, dx))).map(|(line, dx)| frame.neighbour(line, 0, dx)).collect()
    }

    /// Index into the output of a pixel of the strip.
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

    /// Adds what this edge's pixels of the output say about input and weight.
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
        // Small rows follow each other in the folded weights, and so do inputs.
        let taps = Taps::new(inputs * SMALL, shifts, &folded, |m| m * SIDE, &columns);
        let wide = 2 * length;
        let mut up = Scratch::new(shape.images * inputs * SMALL * wide);
        multiply_rows(&taps, lines, frame, wide, &mut up);
        // The transpose of the upsampling along the edge.
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
