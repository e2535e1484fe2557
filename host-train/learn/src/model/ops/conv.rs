//! Convolutions on slices: forward, and the gradients of input and weight.
//!
//! A convolution with stride s equals s x s convolutions of stride 1, each on the pixels of one phase (y mod s, x mod s). Every channel
//! becomes s x s lines, and each weight reads the line of its phase.

use super::correlate::correlate;
use super::frame::Frame;
use super::product::{Area, Taps, multiply};
use super::scratch::Scratch;
use rayon::prelude::*;

/// Shape of a convolution. Outside the input there are zeros as far as the output needs them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ConvShape {
    /// Images.
    pub(super) images: usize,
    /// Channels in and out.
    pub(super) channels: [usize; 2],
    /// Input rows and columns.
    pub(super) input: [usize; 2],
    /// Output rows and columns.
    pub(super) output: [usize; 2],
    /// Kernel rows and columns.
    pub(super) kernel: [usize; 2],
    /// Stride, of rows and columns alike.
    pub(super) stride: usize,
    /// Rows above and columns left of the input that the first output pixel reads.
    pub(super) padding: [usize; 2],
}

impl ConvShape {
    /// Returns the number of values of the input, the weight and the output.
    pub(super) fn lengths(&self) -> [usize; 3] {
        let area = |[rows, cols]: [usize; 2]| rows * cols;
        let [input, output] = self.channels;
        let [x, y] = [self.images * input * area(self.input), self.images * output * area(self.output)];
        [x, input * output * area(self.kernel), y]
    }

    /// Returns phase and distance, in pixels of that phase, of kernel position k along an axis.
    fn tap(&self, axis: usize, k: usize) -> (usize, isize) {
        let (t, s) = (k as isize - self.padding[axis] as isize, self.stride as isize);
        (t.rem_euclid(s) as usize, t.div_euclid(s))
    }

    /// Returns the size of a phase of the input.
    fn phase(&self, phase: [usize; 2]) -> [usize; 2] {
        std::array::from_fn(|i| self.input[i].saturating_sub(phase[i]).div_ceil(self.stride))
    }

    fn frame(&self) -> Frame {
        let reach = |axis| {
            (0..self.kernel[axis]).map(|k| self.tap(axis, k).1.unsigned_abs()).max().expect("a kernel has a side")
        };
        let whole = self.phase([0, 0]);
        let size = std::array::from_fn(|i| whole[i].max(self.output[i]));
        Frame::new(self.images, size, [reach(0), reach(1)])
    }

    /// Returns the kernel positions (row, column).
    fn positions(&self) -> impl Iterator<Item = (usize, usize)> + Clone {
        let cols = self.kernel[1];
        (0..self.kernel[0]).flat_map(move |y| (0..cols).map(move |x| (y, x)))
    }

    /// Returns the positions in the input's lines that the weights of one output read, in the weights' order.
    fn input_shifts(&self, frame: &Frame) -> Vec<usize> {
        let s = self.stride;
        let shift = |channel: usize, (ky, kx): (usize, usize)| {
            let ((py, dy), (px, dx)) = (self.tap(0, ky), self.tap(1, kx));
            frame.neighbour((channel * s + py) * s + px, dy, dx)
        };
        (0..self.channels[0]).flat_map(|c| self.positions().map(move |at| shift(c, at))).collect()
    }

    /// Returns the input as lines, one per channel and phase.
    fn input_lines(&self, frame: &Frame, x: &[f32]) -> Scratch {
        let ([channels, _], [rows, cols], s) = (self.channels, self.input, self.stride);
        let mut lines = Scratch::new(channels * s * s * frame.length);
        frame.fill(&mut lines, |line, image, y, to| {
            let (channel, py, px) = (line / (s * s), line / s % s, line % s);
            if y * s + py >= rows {
                return 0;
            }
            let row = &x[((image * channels + channel) * rows + y * s + py) * cols..][..cols];
            if s == 1 {
                to[..cols].copy_from_slice(row);
                return cols;
            }
            let picked = row.iter().skip(px).step_by(s);
            to.iter_mut().zip(picked).map(|(to, from)| *to = *from).count()
        });
        lines
    }

    /// Returns the gradient of the output as lines.
    fn gradient_lines(&self, frame: &Frame, gradient: &[f32]) -> Scratch {
        let ([_, channels], [rows, cols]) = (self.channels, self.output);
        let mut lines = Scratch::new(channels * frame.length);
        frame.fill(&mut lines, |channel, image, y, to| {
            if y >= rows {
                return 0;
            }
            to[..cols].copy_from_slice(&gradient[((image * channels + channel) * rows + y) * cols..][..cols]);
            cols
        });
        lines
    }
}

/// Maps `x` `[B, I, H, W]` and `weight` `[O, I, kh, kw]` to `[B, O, H', W']`.
pub(super) fn forward(shape: &ConvShape, x: &[f32], weight: &[f32]) -> Vec<f32> {
    let frame = shape.frame();
    let lines = shape.input_lines(&frame, x);
    let shifts = shape.input_shifts(&frame);
    let depth = shifts.len();
    let columns: Vec<usize> = (0..depth).collect();
    let taps = Taps::new(shape.channels[1], shifts, weight, |m| m * depth, &columns);
    let mut out = vec![0.0; shape.lengths()[2]];
    multiply(&taps, &lines, &frame, Area { origin: [0, 0], size: shape.output }, &mut out);
    out
}

/// Returns the requested gradients of input and weight, from the output's gradient.
pub(super) fn backward(
    shape: &ConvShape,
    x: &[f32],
    weight: &[f32],
    gradient: &[f32],
    wanted: [bool; 2],
) -> [Option<Vec<f32>>; 2] {
    let frame = shape.frame();
    let lines = shape.gradient_lines(&frame, gradient);
    let of_input = wanted[0].then(|| input_gradient(shape, &frame, &lines, weight));
    let of_weight = wanted[1].then(|| {
        let input = shape.input_lines(&frame, x);
        correlate(&lines, &input, &shape.input_shifts(&frame), &frame)
    });
    [of_input, of_weight]
}

fn input_gradient(shape: &ConvShape, frame: &Frame, lines: &[f32], weight: &[f32]) -> Vec<f32> {
    let ([inputs, outputs], s) = (shape.channels, shape.stride);
    let kernel = shape.kernel[0] * shape.kernel[1];
    let mut whole = vec![0.0; shape.lengths()[0]];
    for (py, px) in (0..s * s).map(|phase| (phase / s, phase % s)) {
        // The weights that read this phase, and the first pixel that each wrote to.
        let taps: Vec<(usize, usize, usize)> = (0..outputs)
            .flat_map(|o| shape.positions().map(move |(ky, kx)| (o, ky, kx)))
            .filter(|&(_, ky, kx)| (shape.tap(0, ky).0, shape.tap(1, kx).0) == (py, px))
            .collect();
        let shifts = taps.iter().map(|&(o, ky, kx)| frame.neighbour(o, -shape.tap(0, ky).1, -shape.tap(1, kx).1));
        let columns = taps.iter().map(|&(o, ky, kx)| o * inputs * kernel + ky * shape.kernel[1] + kx);
        let columns: Vec<usize> = columns.collect();
        let packed = Taps::new(inputs, shifts.collect(), weight, |m| m * kernel, &columns);
        let size = shape.phase([py, px]);
        let area = Area { origin: [0, 0], size };
        if s == 1 {
            multiply(&packed, lines, frame, area, &mut whole);
            continue;
        }
        let mut part = Scratch::new(shape.images * inputs * size[0] * size[1]);
        multiply(&packed, lines, frame, area, &mut part);
        let [rows, cols] = shape.input;
        whole.par_chunks_mut(rows * cols).enumerate().for_each(|(plane, to)| {
            let from = &part[plane * size[0] * size[1]..][..size[0] * size[1]];
            for (from, y) in from.chunks_exact(size[1].max(1)).zip((py..rows).step_by(s)) {
                to[y * cols..][..cols].iter_mut().skip(px).step_by(s).zip(from).for_each(|(to, from)| *to = *from);
            }
        });
    }
    whole
}
