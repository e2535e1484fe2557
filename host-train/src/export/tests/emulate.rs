//! The quantised network once more, in f64 and from the definitions: the twin that the runner is held against.
//!
//! It shares the quantised weights and the codes of every map with the program, and nothing else: no integer multipliers, no
//! fixed-point square root, no exponential table. Each node is computed from the codes of its inputs as the runner left them,
//! so a difference points at one operator.

use super::super::build::NORM_EPSILON;
use super::super::float::gelu;
use super::super::graph::{Activation, Graph, NodeId, Operation, Source};
use super::super::quantise::{Codes, Program, gelu_table, quantise_weights};
use elunar_core::nn::Dtype;

/// A map as codes (for the output: real values).
pub(crate) type Map = Vec<f64>;

pub(crate) struct Emulator<'a> {
    pub(crate) graph: &'a Graph,
    pub(crate) program: &'a Program,
    /// Codes of every node so far.
    pub(crate) maps: Vec<Map>,
    /// The coarse DTM as given, for a residual head.
    pub(crate) coarse: Vec<f32>,
}

impl Emulator<'_> {
    /// Codes of node `id` from those of its inputs.
    pub(crate) fn node(&self, id: NodeId) -> Map {
        match &self.graph.nodes[id].operation {
            Operation::Image | Operation::Coarse => unreachable!("inputs are given"),
            Operation::Conv { .. } => self.conv(id),
            Operation::LayerNorm { .. } => self.layer_norm(id),
            Operation::Attention { .. } => self.attention(id),
        }
    }

    fn codes(&self, id: NodeId) -> &Codes {
        &self.program.codes[id]
    }

    /// Real value of a sample.
    fn real(&self, id: NodeId, index: usize) -> f64 {
        let (codes, channels) = (self.codes(id), self.graph.nodes[id].channels);
        (self.maps[id][index] - codes.zero as f64) * codes.scales[index % channels]
    }

    fn encode(&self, id: NodeId, channel: usize, real: f64) -> f64 {
        let codes = self.codes(id);
        ((real / codes.scales[channel] + 0.5).floor() + codes.zero as f64).clamp(codes.lo as f64, codes.hi as f64)
    }

    /// What a convolution reads at (row, col) of its input, in code steps of sixteenths where enlarged, zero outside.
    fn read(&self, source: &Source, shift: u32, row: isize, col: isize, channel: usize) -> f64 {
        let node = &self.graph.nodes[source.node];
        let factor = if source.up { 2 } else { 1 };
        if row < 0 || col < 0 || row >= (node.rows * factor) as isize || col >= (node.cols * factor) as isize {
            return 0.0;
        }
        let zero = self.codes(source.node).zero as f64;
        let at = |r: usize, c: usize| self.maps[source.node][(r * node.cols + c) * node.channels + channel] - zero;
        if !source.up {
            return at(row as usize, col as usize);
        }
        let axis = |index: isize, len: usize| {
            let centre = ((index as f64 + 0.5) / 2.0 - 0.5).clamp(0.0, (len - 1) as f64);
            (centre.floor() as usize, centre.ceil() as usize, centre.fract())
        };
        let ((r0, r1, fr), (c0, c1, fc)) = (axis(row, node.rows), axis(col, node.cols));
        let top = at(r0, c0) * (1.0 - fc) + at(r0, c1) * fc;
        let bottom = at(r1, c0) * (1.0 - fc) + at(r1, c1) * fc;
        let step = (1u32 << shift) as f64;
        ((top * (1.0 - fr) + bottom * fr) * 16.0 / step + if shift == 0 { 0.0 } else { 0.5 }).floor()
    }

    fn conv(&self, id: NodeId) -> Map {
        let node = &self.graph.nodes[id];
        let Operation::Conv { sources, kernel, stride, pad, add, activation } = &node.operation else { unreachable!() };
        let operator = id - (self.graph.nodes.len() - self.program.operators.len());
        let elunar_core::nn::Operator::Conv(record) = self.program.operators[operator] else { unreachable!() };
        let shifts: Vec<u32> = record.sources().map(|s| s.shift).collect();
        let steps: Vec<f64> = sources
            .iter()
            .zip(&shifts)
            .flat_map(|(s, shift)| {
                let step = if s.up { (1u32 << shift) as f64 / 16.0 } else { 1.0 };
                self.codes(s.node).scales.iter().map(move |scale| scale * step)
            })
            .collect();
        let integers = quantise_weights(kernel, &steps, &self.program.input_means(sources));
        let mut out = Vec::with_capacity(node.len());
        for index in 0..node.rows * node.cols {
            let (row, col) = (index / node.cols, index % node.cols);
            let mut patch = Vec::with_capacity(kernel.side * kernel.side * kernel.input);
            for k in 0..kernel.side * kernel.side {
                let r = (row * stride + k / kernel.side) as isize - *pad as isize;
                let c = (col * stride + k % kernel.side) as isize - *pad as isize;
                for (source, shift) in sources.iter().zip(&shifts) {
                    patch.extend(
                        (0..self.graph.nodes[source.node].channels).map(|i| self.read(source, *shift, r, c, i)),
                    );
                }
            }
            for (o, filter) in integers.weights.chunks_exact(patch.len()).enumerate() {
                let sum: f64 = filter.iter().zip(&patch).map(|(w, x)| *w as f64 * x).sum();
                let mut real = (sum + integers.bias[o] as f64) * integers.scales[o];
                let sample = index * node.channels + o;
                if self.codes(id).dtype == Dtype::F32 {
                    real += add.map_or(0.0, |_| self.coarse[sample] as f64);
                    out.push(if *activation == Activation::Relu { real.max(0.0) } else { real });
                    continue;
                }
                real += add.map_or(0.0, |add| self.real(add, sample));
                if *activation == Activation::Gelu {
                    // The table is entered with 8 bits of the sum.
                    let (_, step, zero) = gelu_table(self.codes(id));
                    let code = ((real / step + 0.5).floor() + zero as f64).clamp(0.0, 255.0);
                    real = gelu((code - zero as f64) * step);
                }
                out.push(self.encode(id, o, real));
            }
        }
        out
    }

    fn layer_norm(&self, id: NodeId) -> Map {
        let node = &self.graph.nodes[id];
        let Operation::LayerNorm { input, merge, gain, bias } = &node.operation else { unreachable!() };
        let from = &self.graph.nodes[*input];
        let mut out = Vec::with_capacity(node.len());
        for pixel in 0..node.rows * node.cols {
            let (row, col) = (pixel / node.cols * merge, pixel % node.cols * merge);
            let x: Vec<f64> = (0..node.channels)
                .map(|c| {
                    let place = c / from.channels;
                    let (r, q) = (row + place % merge, col + place / merge);
                    self.real(*input, (r * from.cols + q) * from.channels + c % from.channels)
                })
                .collect();
            let mean = x.iter().sum::<f64>() / x.len() as f64;
            let variance = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / x.len() as f64;
            for (c, v) in x.iter().enumerate() {
                let y = (v - mean) / (variance + NORM_EPSILON).sqrt() * gain[c] as f64 + bias[c] as f64;
                out.push(self.encode(id, c, y));
            }
        }
        out
    }

    fn attention(&self, id: NodeId) -> Map {
        let node = &self.graph.nodes[id];
        let Operation::Attention { input, heads, window, shift, position_bias, pad } = &node.operation else {
            unreachable!()
        };
        let (w, size) = (*window, node.channels / heads);
        let (tall, wide) = (node.rows.div_ceil(w) * w, node.cols.div_ceil(w) * w);
        // The padded, shifted map: for every place its pixel (if real) and its region.
        let edge = |at: usize, len: usize, s: usize| (at + w >= len) as usize + (s > 0 && at + s >= len) as usize;
        let place = |r: usize, c: usize| {
            let (pr, pc) = ((r + shift.0) % tall, (c + shift.1) % wide);
            let pixel = (pr < node.rows && pc < node.cols).then_some(pr * node.cols + pc);
            (pixel, (edge(r, tall, shift.0), edge(c, wide, shift.1)))
        };
        let value = |pixel: Option<usize>, channel: usize| match pixel {
            Some(pixel) => self.real(*input, pixel * 3 * node.channels + channel),
            None => {
                (pad[channel] as f64 / self.codes(*input).scales[channel]).round() * self.codes(*input).scales[channel]
            }
        };
        let mut out = vec![0.0; node.len()];
        for (r, c) in (0..tall).flat_map(|r| (0..wide).map(move |c| (r, c))) {
            let (Some(pixel), region) = place(r, c) else { continue };
            let (top, left) = (r / w * w, c / w * w);
            for head in 0..*heads {
                let mut weighted = vec![0.0; size];
                let mut total = 0.0;
                let mut logits = Vec::new();
                for (kr, kc) in (0..w).flat_map(|a| (0..w).map(move |b| (a, b))) {
                    let (key, other) = place(top + kr, left + kc);
                    let dot: f64 = (0..size)
                        .map(|i| value(Some(pixel), head * size + i) * value(key, node.channels + head * size + i))
                        .sum();
                    let relative = (r - top + w - 1 - kr) * (2 * w - 1) + (c - left + w - 1 - kc);
                    let mask = if other == region { 0.0 } else { -100.0 };
                    let logit = dot / (size as f64).sqrt() + position_bias[relative * heads + head] as f64 + mask;
                    logits.push((logit, key));
                }
                let largest = logits.iter().map(|l| l.0).fold(f64::MIN, f64::max);
                for (logit, key) in logits {
                    let e = (logit - largest).exp();
                    total += e;
                    for (i, sum) in weighted.iter_mut().enumerate() {
                        *sum += e * value(key, 2 * node.channels + head * size + i);
                    }
                }
                for (i, sum) in weighted.iter().enumerate() {
                    let channel = head * size + i;
                    out[pixel * node.channels + channel] = self.encode(id, channel, sum / total);
                }
            }
        }
        out
    }
}
