//! Bilinear upsampling by two followed by a 5x5 convolution with zero padding, as one operator of the small map.
//!
//! Both are linear filters, so they commute: put zeros between the small pixels, convolve, then smooth. The zeros need no products. This
//! leaves 25 products per small pixel, where the plain order has 100, and the smoothing runs over output channels only. The convolution of
//! a map with zeros between its pixels gives four phases. Each is a convolution of the small map with the weights of one parity: 3x3, 3x2,
//! 2x3 and 2x2 of them.
//!
//! The two steps do not commute at the border, where the upsampling repeats the edge but the convolution has zeros beyond it. Two pixels
//! along each border are corrected ([`border`]).

mod border;
mod ends;
mod fold;
mod shape;
mod smooth;

use super::correlate::correlate;
use super::frame::Frame;
use super::product::{Area, Taps, multiply};
use super::scratch::Scratch;
use border::Edge;
use pulp::Arch;
use rayon::prelude::*;
use shape::KERNEL;
pub(super) use shape::{MIN_SIDE, Up2Shape};

/// Per axis and phase: (offset of the small pixel, index of the weight that it is multiplied with).
const TAPS: [&[(isize, usize)]; 2] = [&[(-1, 0), (0, 2), (1, 4)], &[(0, 1), (1, 3)]];

/// The four phases as (row, column).
const PHASES: [[usize; 2]; 4] = [[0, 0], [0, 1], [1, 0], [1, 1]];

/// Returns (dy, dx, position in the kernel) of a phase.
fn taps(phase: [usize; 2]) -> impl Iterator<Item = (isize, isize, usize)> + Clone {
    TAPS[phase[0]].iter().flat_map(move |&(dy, ky)| TAPS[phase[1]].iter().map(move |&(dx, kx)| (dy, dx, 5 * ky + kx)))
}

impl Up2Shape {
    /// Returns the layout of the small map with its edge repeated once around it. Small pixel (y, x) is at (y + 1, x + 1). Neighbours over
    /// the edge fall on the last row and column. Only products with zeros of a gradient read them.
    fn frame(&self) -> Frame {
        Frame::new(self.images, self.small.map(|n| n + 1), [1, 1])
    }

    /// Returns the small map as lines.
    fn input_lines(&self, frame: &Frame, x: &[f32]) -> Scratch {
        let ([channels, _], [rows, cols]) = (self.channels, self.small);
        let mut lines = Scratch::new(channels * frame.length);
        frame.fill(&mut lines, |channel, image, y, to| {
            let y = y.saturating_sub(1).min(rows - 1);
            let row = &x[((image * channels + channel) * rows + y) * cols..][..cols];
            to[1..=cols].copy_from_slice(row);
            (to[0], to[cols + 1]) = (row[0], row[cols - 1]);
            cols + 2
        });
        lines
    }

    /// Returns the gradients of the four phases from the output's gradient, as lines, phase 0 first.
    fn phase_lines(&self, frame: &Frame, gradient: &[f32]) -> Scratch {
        let ([_, channels], [rows, cols], arch) = (self.channels, self.small, Arch::new());
        let mut lines = Scratch::new(4 * channels * frame.length);
        frame.fill(&mut lines, |line, image, y, to| {
            if y == 0 || y > rows {
                return 0;
            }
            let (phase, channel) = (PHASES[line / channels], line % channels);
            let map = &gradient[4 * (image * channels + channel) * rows * cols..][..4 * rows * cols];
            let mut columns = vec![0.0; 2 * cols + 4];
            smooth::transposed_row(arch, map, cols, phase, y - 1, &mut columns, &mut to[1..=cols]);
            to[0] = 0.0;
            cols + 1
        });
        lines
    }
}

/// Maps `x` `[B, I, h, w]` and `weight` `[O, I, 5, 5]` to `[B, O, 2h, 2w]`.
pub(super) fn forward(shape: &Up2Shape, x: &[f32], weight: &[f32]) -> Vec<f32> {
    let ([inputs, outputs], [rows, cols]) = (shape.channels, shape.small);
    let frame = shape.frame();
    let lines = shape.input_lines(&frame, x);
    let plane = rows * cols;
    let mut phases = Scratch::new(shape.lengths()[2]);
    for (phase, out) in PHASES.into_iter().zip(phases.chunks_exact_mut(shape.images * outputs * plane)) {
        let reads = (0..inputs).flat_map(|i| taps(phase).map(move |(dy, dx, k)| (i, dy, dx, k)));
        let kernel: Vec<usize> = reads.clone().map(|(i, _, _, k)| i * KERNEL + k).collect();
        let shifts = reads.map(|(i, dy, dx, _)| frame.neighbour(i, dy, dx)).collect();
        let taps = Taps::new(outputs, shifts, weight, |m| m * inputs * KERNEL, &kernel);
        multiply(&taps, &lines, &frame, Area { origin: [1, 1], size: shape.small }, out);
    }
    let mut out = vec![0.0; shape.lengths()[2]];
    let (phases, arch) = (&*phases, Arch::new());
    out.par_chunks_mut(4 * plane).enumerate().for_each(|(i, map)| {
        let phases = std::array::from_fn(|p| &phases[(p * shape.images * outputs + i) * plane..][..plane]);
        let mut columns = vec![0.0; 3 * cols + 4];
        for (n, row) in map.chunks_exact_mut(2 * cols).enumerate() {
            smooth::row(arch, phases, cols, n, &mut columns, row);
        }
    });
    for edge in Edge::ALL {
        edge.forward(shape, x, weight, &mut out);
    }
    out
}

/// Returns the requested gradients of input and weight, from the output's gradient.
pub(super) fn backward(
    shape: &Up2Shape,
    x: &[f32],
    weight: &[f32],
    gradient: &[f32],
    wanted: [bool; 2],
) -> [Option<Vec<f32>>; 2] {
    let frame = shape.frame();
    let lines = shape.phase_lines(&frame, gradient);
    let mut of_input = wanted[0].then(|| input_gradient(shape, &frame, &lines, weight));
    let mut of_weight = wanted[1].then(|| weight_gradient(shape, &frame, &lines, x));
    for edge in Edge::ALL {
        edge.backward(shape, x, weight, gradient, [of_input.as_deref_mut(), of_weight.as_deref_mut()]);
    }
    [of_input, of_weight]
}

fn input_gradient(shape: &Up2Shape, frame: &Frame, lines: &[f32], weight: &[f32]) -> Vec<f32> {
    let ([inputs, outputs], [rows, cols]) = (shape.channels, shape.small);
    let reads = PHASES.into_iter().enumerate().flat_map(|(p, phase)| {
        (0..outputs).flat_map(move |o| taps(phase).map(move |(dy, dx, k)| (p * outputs + o, -dy, -dx, o, k)))
    });
    let kernel: Vec<usize> = reads.clone().map(|(.., o, k)| o * inputs * KERNEL + k).collect();
    let shifts = reads.map(|(line, dy, dx, ..)| frame.neighbour(line, dy, dx)).collect();
    let taps = Taps::new(inputs, shifts, weight, |m| m * KERNEL, &kernel);
    let wide = cols + 2;
    let mut around = Scratch::new(shape.images * inputs * (rows + 2) * wide);
    multiply(&taps, lines, frame, Area { origin: [0, 0], size: [rows + 2, wide] }, &mut around);
    // Gradients of the repeated edge are added to the edge.
    let mut whole = vec![0.0; shape.lengths()[0]];
    let around = &*around;
    whole.par_chunks_mut(rows * cols).enumerate().for_each(|(i, map)| {
        for (y, from) in around[i * (rows + 2) * wide..][..(rows + 2) * wide].chunks_exact(wide).enumerate() {
            let to = &mut map[y.saturating_sub(1).min(rows - 1) * cols..][..cols];
            to.iter_mut().zip(&from[1..=cols]).for_each(|(to, from)| *to += from);
            to[0] += from[0];
            to[cols - 1] += from[cols + 1];
        }
    });
    whole
}

fn weight_gradient(shape: &Up2Shape, frame: &Frame, lines: &[f32], x: &[f32]) -> Vec<f32> {
    let [inputs, outputs] = shape.channels;
    let input = shape.input_lines(frame, x);
    let mut whole = vec![0.0; shape.lengths()[1]];
    for (phase, gradient) in PHASES.into_iter().zip(lines.chunks_exact(outputs * frame.length)) {
        let reads = (0..inputs).flat_map(|i| taps(phase).map(move |(dy, dx, k)| (i, dy, dx, k)));
        let shifts: Vec<usize> = reads.clone().map(|(i, dy, dx, _)| frame.neighbour(i, dy, dx)).collect();
        let found = correlate(gradient, &input, &shifts, frame);
        for (whole, found) in whole.chunks_exact_mut(inputs * KERNEL).zip(found.chunks_exact(shifts.len())) {
            reads.clone().zip(found).for_each(|((i, _, _, k), value)| whole[i * KERNEL + k] += value);
        }
    }
    whole
}
