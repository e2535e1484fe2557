//! The operator graph on real numbers. It shows that the graph equals the network, and it measures the maps for calibration.

use super::build::NORM_EPSILON;
use super::graph::{Activation, ConvInput, Graph, LayerWeights, Node, NodeId, Operation};
use rayon::prelude::*;

/// Returns x Φ(x) exactly. The reference uses the error function, not the tanh approximation.
pub fn gelu(x: f64) -> f64 {
    0.5 * x * (1.0 + libm::erf(x * std::f64::consts::FRAC_1_SQRT_2))
}

/// Computes every node's map `[rows, cols, channels]`, in the order of the nodes. `image` and `coarse` hold one sample per pixel.
///
/// # Panics
/// If an input's length is not rows * cols of the graph.
pub fn run(graph: &Graph, image: &[f32], coarse: &[f32]) -> Vec<Vec<f32>> {
    let mut maps: Vec<Vec<f32>> = Vec::with_capacity(graph.nodes.len());
    for node in &graph.nodes {
        let map = match &node.operation {
            Operation::Image => image.to_vec(),
            Operation::Coarse => coarse.to_vec(),
            _ => compute(graph, node, &|id| &maps[id]),
        };
        assert_eq!(map.len(), node.len(), "{}", node.name);
        maps.push(map);
    }
    maps
}

/// Function from a node's number to its map.
pub(crate) type NodeMaps<'f, 'm> = &'f (dyn Fn(NodeId) -> &'m [f32] + Sync);

/// Computes the map of a node that is not an input.
pub(crate) fn compute(graph: &Graph, node: &Node, maps: NodeMaps<'_, '_>) -> Vec<f32> {
    match &node.operation {
        Operation::Image | Operation::Coarse => Vec::new(),
        Operation::Conv { sources, kernel, stride, pad, add, activation } => {
            let mut map = conv(&gather(graph, maps, sources, *pad), kernel, *stride, node);
            finish(&mut map, add.map(maps), *activation);
            map
        }
        Operation::LayerNorm { input, merge, gain, bias } => {
            layer_norm(maps(*input), &graph.nodes[*input], *merge, gain, bias, node)
        }
        Operation::Attention { input, heads, window, shift, position_bias, pad } => {
            let view = Attend { qkv: maps(*input), heads: *heads, window: *window, shift: *shift, position_bias, pad };
            view.run(node)
        }
    }
}

/// Rows, columns, channels and samples of a padded input.
struct Input {
    cols: usize,
    channels: usize,
    samples: Vec<f32>,
}

/// Joins the channels of the sources, upsampled where requested, with a border of zeros.
fn gather(graph: &Graph, maps: NodeMaps<'_, '_>, sources: &[ConvInput], pad: usize) -> Input {
    let first = &graph.nodes[sources[0].node];
    let factor = if sources[0].up { 2 } else { 1 };
    let (rows, cols) = (first.rows * factor, first.cols * factor);
    let channels = sources.iter().map(|s| graph.nodes[s.node].channels).sum();
    let width = cols + 2 * pad;
    let mut samples = vec![0.0; (rows + 2 * pad) * width * channels];
    samples.par_chunks_exact_mut(width * channels).enumerate().for_each(|(padded_row, line)| {
        let Some(row) = padded_row.checked_sub(pad).filter(|row| *row < rows) else { return };
        for (col, pixel) in line[pad * channels..(pad + cols) * channels].chunks_exact_mut(channels).enumerate() {
            let mut at = 0;
            for source in sources {
                let (node, map) = (&graph.nodes[source.node], maps(source.node));
                let read = |r: usize, c: usize, k: usize| map[(r * node.cols + c) * node.channels + k];
                for k in 0..node.channels {
                    pixel[at + k] =
                        if source.up { upsample(row, col, node, |r, c| read(r, c, k)) } else { read(row, col, k) };
                }
                at += node.channels;
            }
        }
    });
    Input { cols: width, channels, samples }
}

/// Interpolates bilinearly at half-pixel centres; the border is repeated.
fn upsample(row: usize, col: usize, node: &Node, read: impl Fn(usize, usize) -> f32) -> f32 {
    let axis = |index: usize, len: usize| {
        let centre = ((index as f32 + 0.5) / 2.0 - 0.5).max(0.0);
        let low = centre as usize;
        (low, (low + 1).min(len - 1), centre - low as f32)
    };
    let ((r0, r1, fr), (c0, c1, fc)) = (axis(row, node.rows), axis(col, node.cols));
    let top = read(r0, c0) * (1.0 - fc) + read(r0, c1) * fc;
    let bottom = read(r1, c0) * (1.0 - fc) + read(r1, c1) * fc;
    top * (1.0 - fr) + bottom * fr
}

fn conv(input: &Input, kernel: &LayerWeights, stride: usize, node: &Node) -> Vec<f32> {
    let taps = kernel.side * kernel.side * kernel.input;
    // `[tap][output]`, so that the inner loop runs over contiguous outputs.
    let mut weights = vec![0.0; taps * kernel.output];
    for (o, filter) in kernel.weights.chunks_exact(taps).enumerate() {
        filter.iter().enumerate().for_each(|(tap, w)| weights[tap * kernel.output + o] = *w);
    }
    let mut map = vec![0.0; node.len()];
    map.par_chunks_exact_mut(node.cols * kernel.output).enumerate().for_each(|(row, line)| {
        for (col, sums) in line.chunks_exact_mut(kernel.output).enumerate() {
            sums.copy_from_slice(&kernel.bias);
            let mut tap = 0;
            for k in 0..kernel.side {
                let start = ((row * stride + k) * input.cols + col * stride) * input.channels;
                for &x in &input.samples[start..start + kernel.side * input.channels] {
                    let w = &weights[tap * kernel.output..(tap + 1) * kernel.output];
                    sums.iter_mut().zip(w).for_each(|(sum, w)| *sum += x * w);
                    tap += 1;
                }
            }
        }
    });
    map
}

pub(crate) fn finish(map: &mut [f32], add: Option<&[f32]>, activation: Activation) {
    if let Some(add) = add {
        map.iter_mut().zip(add).for_each(|(v, a)| *v += a);
    }
    match activation {
        Activation::None => {}
        Activation::Relu => map.iter_mut().for_each(|v| *v = v.max(0.0)),
        Activation::Gelu => map.par_iter_mut().for_each(|v| *v = gelu(*v as f64) as f32),
    }
}

fn layer_norm(map: &[f32], input: &Node, merge: usize, gain: &[f32], bias: &[f32], node: &Node) -> Vec<f32> {
    let mut out = vec![0.0; node.len()];
    out.par_chunks_exact_mut(node.channels).enumerate().for_each(|(pixel, y)| {
        let (row, col) = (pixel / node.cols * merge, pixel % node.cols * merge);
        for place in 0..merge * merge {
            let from = ((row + place % merge) * input.cols + col + place / merge) * input.channels;
            y[place * input.channels..][..input.channels].copy_from_slice(&map[from..from + input.channels]);
        }
        let n = y.len() as f64;
        let mean = y.iter().map(|&v| v as f64).sum::<f64>() / n;
        let variance = y.iter().map(|&v| (v as f64 - mean).powi(2)).sum::<f64>() / n;
        let inverse = 1.0 / (variance + NORM_EPSILON).sqrt();
        for (c, v) in y.iter_mut().enumerate() {
            *v = ((*v as f64 - mean) * inverse) as f32 * gain[c] + bias[c];
        }
    });
    out
}

/// Window attention on one map.
struct Attend<'a> {
    qkv: &'a [f32],
    heads: usize,
    window: usize,
    shift: (usize, usize),
    position_bias: &'a [f32],
    pad: &'a [f32],
}

impl Attend<'_> {
    fn run(&self, node: &Node) -> Vec<f32> {
        let w = self.window;
        let (down, across) = (node.rows.div_ceil(w), node.cols.div_ceil(w));
        let windows: Vec<Vec<(usize, Vec<f32>)>> =
            (0..down * across).into_par_iter().map(|i| self.one(node, i / across * w, i % across * w)).collect();
        let mut out = vec![0.0; node.len()];
        for (pixel, values) in windows.into_iter().flatten() {
            out[pixel * node.channels..(pixel + 1) * node.channels].copy_from_slice(&values);
        }
        out
    }

    /// Computes the window whose first token is at (`row`, `col`) of the shifted map. Returns pixel and values of each token inside the
    /// map.
    fn one(&self, node: &Node, row: usize, col: usize) -> Vec<(usize, Vec<f32>)> {
        let (w, channels) = (self.window, node.channels);
        let (padded_rows, padded_cols) = (node.rows.div_ceil(w) * w, node.cols.div_ceil(w) * w);
        let band =
            |at: usize, len: usize, shift: usize| if at < len - w { 0 } else { 1 + (at >= len - shift) as usize };
        let tokens: Vec<(usize, Option<usize>)> = (0..w * w)
            .map(|t| {
                let (r, c) = (row + t / w, col + t % w);
                let region = 3 * band(r, padded_rows, self.shift.0) + band(c, padded_cols, self.shift.1);
                let (r, c) = ((r + self.shift.0) % padded_rows, (c + self.shift.1) % padded_cols);
                (region, (r < node.rows && c < node.cols).then_some(r * node.cols + c))
            })
            .collect();
        let read = |t: usize| {
            tokens[t].1.map_or(self.pad, |pixel| &self.qkv[3 * channels * pixel..3 * channels * (pixel + 1)])
        };
        let mut out = Vec::new();
        for (query, (region, pixel)) in tokens.iter().enumerate() {
            let Some(pixel) = pixel else { continue };
            let mut values = vec![0.0; channels];
            for head in 0..self.heads {
                self.attend(query, *region, head, &tokens, &read, &mut values);
            }
            out.push((*pixel, values));
        }
        out
    }

    fn attend<'m>(
        &self,
        query: usize,
        region: usize,
        head: usize,
        tokens: &[(usize, Option<usize>)],
        read: &impl Fn(usize) -> &'m [f32],
        values: &mut [f32],
    ) {
        let (w, channels) = (self.window, values.len());
        let size = channels / self.heads;
        let part = |t: usize, p: usize| &read(t)[p * channels + head * size..][..size];
        let scale = (size as f32).powf(-0.5);
        let mut logits: Vec<f32> = (0..tokens.len())
            .map(|key| {
                let dot: f32 = part(query, 0).iter().zip(part(key, 1)).map(|(q, k)| q * scale * k).sum();
                let (dr, dc) = (query / w + w - 1 - key / w, query % w + w - 1 - key % w);
                let mask = if tokens[key].0 == region { 0.0 } else { -100.0 };
                dot + self.position_bias[(dr * (2 * w - 1) + dc) * self.heads + head] + mask
            })
            .collect();
        let largest = logits.iter().copied().fold(f32::MIN, f32::max);
        logits.iter_mut().for_each(|l| *l = (*l - largest).exp());
        let sum: f32 = logits.iter().sum();
        for (key, e) in logits.iter().enumerate() {
            let out = &mut values[head * size..(head + 1) * size];
            out.iter_mut().zip(part(key, 2)).for_each(|(o, v)| *o += e / sum * v);
        }
    }
}
