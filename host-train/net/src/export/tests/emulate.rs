//! An emulation of the quantised network in f64, from the definitions. The runner is compared with it.
//!
//! It shares only the quantised weights and the codes of every map with the program: no integer multipliers, no fixed-point square root, no
//! exponential table, no cut windows, no packed weights. Each node is computed from the runner's codes of its inputs, so a difference
//! belongs to one operator.

use super::super::build::NORM_EPSILON;
use super::super::codes::Codes;
use super::super::float::gelu;
use super::super::fold::fold;
use super::super::graph::{Activation, ConvInput, Graph, LayerWeights, NodeId, Operation};
use super::super::pack::Filter;
use super::super::pack::IntegerFilter;
use super::super::quantise::{Program, gelu_table, quantise_weights};
use elunar_core::nn::file::{Dtype, Operator};

/// A map as codes (for the output: real values).
pub(crate) type Map = Vec<f64>;

pub(crate) struct Emulator<'a> {
    pub(crate) graph: &'a Graph,
    pub(crate) program: &'a Program,
    /// Codes of all nodes computed so far.
    pub(crate) maps: Vec<Map>,
}

/// A filter or correction on an axis of the small map: its number, and the samples that it reads, with repeated border.
struct Place {
    filter: usize,
    samples: Vec<usize>,
}

impl Place {
    /// Returns all filters and corrections for output `index`. The output depends on five samples of the upsampled map, continued beyond
    /// its border. The number and the side of the samples in the padding determine the number of the correction.
    fn all_of(index: usize, len: usize) -> Vec<Self> {
        let seen = (index as isize - 2)..=(index as isize + 2);
        let before = seen.clone().filter(|p| *p < 0).count();
        let behind = seen.clone().filter(|p| *p >= 2 * len as isize).count();
        let (mut low, mut high) = (f64::MAX, f64::MIN);
        seen.map(|p| (p as f64 + 0.5) / 2.0 - 0.5).for_each(|c| (low, high) = (low.min(c.floor()), high.max(c.ceil())));
        let samples = (low as isize..=high as isize).map(|s| s.clamp(0, len as isize - 1) as usize).collect();
        let mut all = vec![Self { filter: index % 2, samples }];
        match (before, behind) {
            (0, 0) => {}
            (lost, 0) => all.push(Self { filter: 4 - lost, samples: vec![0] }),
            (_, lost) => all.push(Self { filter: 3 + lost, samples: vec![len - 1] }),
        }
        all
    }
}

impl Emulator<'_> {
    /// Computes the codes of node `id` from the codes of its inputs.
    pub(crate) fn node(&self, id: NodeId) -> Map {
        match &self.graph.nodes[id].operation {
            Operation::Image | Operation::Coarse => unreachable!("inputs are given"),
            Operation::Conv { .. } => self.conv(id),
            Operation::LayerNorm { .. } => self.layer_norm(id),
            Operation::Attention { .. } => self.attention(id),
        }
    }

    /// Computes the codes of node `id` upsampled twofold, rounded once.
    pub(crate) fn upsampled(&self, id: NodeId) -> Map {
        let node = &self.graph.nodes[id];
        let mut out = Vec::with_capacity(4 * node.len());
        for (row, col) in (0..2 * node.rows).flat_map(|r| (0..2 * node.cols).map(move |c| (r, c))) {
            out.extend((0..node.channels).map(|k| (self.between(id, row, col, k) + 0.5).floor()));
        }
        out
    }

    /// Computes the code at (row, col) of the upsampled map, before rounding: bilinear, half-pixel centres, border repeated.
    fn between(&self, id: NodeId, row: usize, col: usize, channel: usize) -> f64 {
        let node = &self.graph.nodes[id];
        let at = |r: usize, c: usize| self.maps[id][(r * node.cols + c) * node.channels + channel];
        let axis = |index: usize, len: usize| {
            let centre = ((index as f64 + 0.5) / 2.0 - 0.5).clamp(0.0, (len - 1) as f64);
            (centre.floor() as usize, centre.ceil() as usize, centre.fract())
        };
        let ((r0, r1, fr), (c0, c1, fc)) = (axis(row, node.rows), axis(col, node.cols));
        let top = at(r0, c0) * (1.0 - fc) + at(r0, c1) * fc;
        let bottom = at(r1, c0) * (1.0 - fc) + at(r1, c1) * fc;
        top * (1.0 - fr) + bottom * fr
    }

    fn codes(&self, id: NodeId) -> &Codes {
        &self.program.codes[id]
    }

    /// Returns the real value of a sample.
    fn real(&self, id: NodeId, index: usize) -> f64 {
        let (codes, channels) = (self.codes(id), self.graph.nodes[id].channels);
        (self.maps[id][index] - codes.zero as f64) * codes.scales[index % channels]
    }

    fn encode(&self, id: NodeId, channel: usize, real: f64) -> f64 {
        let codes = self.codes(id);
        ((real / codes.scales[channel] + 0.5).floor() + codes.zero as f64).clamp(codes.lo as f64, codes.hi as f64)
    }

    /// Returns whether the program computes node `id` on the small maps.
    fn folded(&self, id: NodeId) -> bool {
        let makes = |op: &&Operator| op.output() == self.program.tensor_of[id];
        matches!(self.program.operators.iter().find(makes), Some(Operator::Conv(conv)) if conv.fold)
    }

    /// Adds the products of a plain convolution with zero padding, for all outputs of one pixel.
    fn plain_sums(sources: &[Read], filter: &IntegerFilter, (top, left): (isize, isize), sums: &mut [f64]) {
        let mut patch = Vec::new();
        for (row, col) in (0..filter.extent.0).flat_map(|r| (0..filter.extent.1).map(move |c| (r, c))) {
            let (row, col) = (top + row as isize, left + col as isize);
            for source in sources {
                let inside = (0..source.rows as isize).contains(&row) && (0..source.cols as isize).contains(&col);
                let at = if inside { (row as usize * source.cols + col as usize) * source.channels } else { 0 };
                patch.extend((0..source.channels).map(|k| if inside { source.map[at + k] - source.zero } else { 0.0 }));
            }
        }
        multiply(filter, &patch, sums);
    }

    /// Adds the products of a convolution whose filter contains the upsampling, for all outputs of one pixel.
    fn folded_sums(sources: &[Read], filters: &[IntegerFilter], (row, col): (usize, usize), sums: &mut [f64]) {
        let (downs, acrosses) = (Place::all_of(row, sources[0].rows), Place::all_of(col, sources[0].cols));
        for (down, across) in downs.iter().flat_map(|down| acrosses.iter().map(move |across| (down, across))) {
            let filter = &filters[6 * down.filter + across.filter];
            assert_eq!(filter.extent, (down.samples.len(), across.samples.len()), "output {row}, {col}");
            let mut patch = Vec::new();
            for (&r, &c) in down.samples.iter().flat_map(|r| across.samples.iter().map(move |c| (r, c))) {
                for source in sources {
                    let at = (r * source.cols + c) * source.channels;
                    patch.extend(source.map[at..at + source.channels].iter().map(|x| x - source.zero));
                }
            }
            multiply(filter, &patch, sums);
            let bias = sums.iter_mut().zip(&filter.bias);
            bias.for_each(|(sum, b)| *sum += *b as f64);
        }
    }

    fn conv(&self, id: NodeId) -> Map {
        let node = &self.graph.nodes[id];
        let Operation::Conv { sources, kernel, stride, pad, add, activation } = &node.operation else { unreachable!() };
        let folded = self.folded(id);
        let scales: Vec<f64> = sources.iter().flat_map(|s| self.codes(s.node).scales.iter().copied()).collect();
        let filters = filters(kernel, folded);
        let integers = quantise_weights(kernel, &filters, &scales, &self.program.input_means(sources));
        let reads: Vec<Read> = sources.iter().map(|s| self.read(s, folded)).collect();
        let mut out = Vec::with_capacity(node.len());
        for index in 0..node.rows * node.cols {
            let (row, col) = (index / node.cols, index % node.cols);
            let mut sums = vec![0.0; node.channels];
            if folded {
                Self::folded_sums(&reads, &integers.filters, (row, col), &mut sums);
            } else {
                let corner = |at: usize| (at * stride) as isize - *pad as isize;
                Self::plain_sums(&reads, &integers.filters[0], (corner(row), corner(col)), &mut sums);
                sums.iter_mut().zip(&integers.filters[0].bias).for_each(|(sum, b)| *sum += *b as f64);
            }
            for (o, sum) in sums.iter().enumerate() {
                let sample = index * node.channels + o;
                let mut real = sum * integers.scales[o] + add.map_or(0.0, |add| self.real(add, sample));
                if self.codes(id).dtype == Dtype::F32 {
                    out.push(if *activation == Activation::Relu { real.max(0.0) } else { real });
                    continue;
                }
                if *activation == Activation::Gelu {
                    // The index of the table is 8 bits of the sum.
                    let (_, step, zero) = gelu_table(self.codes(id));
                    let code = ((real / step + 0.5).floor() + zero as f64).clamp(0.0, 255.0);
                    real = gelu((code - zero as f64) * step);
                }
                out.push(self.encode(id, o, real));
            }
        }
        out
    }

    /// Returns a source as the convolution reads it. If the filters contain the upsampling, it is the small map.
    fn read(&self, source: &ConvInput, folded: bool) -> Read {
        let (node, zero) = (&self.graph.nodes[source.node], self.codes(source.node).zero as f64);
        let upsampled = source.up && !folded;
        let factor = if upsampled { 2 } else { 1 };
        let map = if upsampled { self.upsampled(source.node) } else { self.maps[source.node].clone() };
        Read { rows: factor * node.rows, cols: factor * node.cols, channels: node.channels, zero, map }
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
        // The padded, shifted map: the pixel of every position (if it is in the map), and its region.
        let edge = |at: usize, len: usize, s: usize| (at + w >= len) as usize + (s > 0 && at + s >= len) as usize;
        let place = |r: usize, c: usize| {
            let (pr, pc) = ((r + shift.0) % tall, (c + shift.1) % wide);
            let pixel = (pr < node.rows && pc < node.cols).then_some(pr * node.cols + pc);
            (pixel, (edge(r, tall, shift.0), edge(c, wide, shift.1)))
        };
        let value = |pixel: Option<usize>, channel: usize| match pixel {
            Some(pixel) => self.real(*input, pixel * 3 * node.channels + channel),
            None => {
                let scale = self.codes(*input).scales[channel];
                (pad[channel] as f64 / scale).round().clamp(-127.0, 127.0) * scale
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

/// A map that a convolution reads.
struct Read {
    rows: usize,
    cols: usize,
    channels: usize,
    zero: f64,
    map: Map,
}

/// Returns the filters before quantisation.
fn filters(kernel: &LayerWeights, folded: bool) -> Vec<Filter> {
    if folded { fold(kernel) } else { vec![Filter::whole(kernel)] }
}

/// Adds a filter's products with a patch, for every output.
fn multiply(filter: &IntegerFilter, patch: &[f64], sums: &mut [f64]) {
    assert_eq!(filter.weights.len(), sums.len() * patch.len());
    for (sum, weights) in sums.iter_mut().zip(filter.weights.chunks_exact(patch.len())) {
        *sum += weights.iter().zip(patch).map(|(w, x)| *w as f64 * x).sum::<f64>();
    }
}
