//! Real weights and ranges to integers: codes of every map, weights, multipliers, tables.
//!
//! Maps have one scale per channel where nothing forbids it: the scale of an input channel becomes part of the weights that
//! read it, so it costs nothing. A layer norm needs one scale for all channels, attention one per head.

use super::build::NORM_EPSILON;
use super::calibrate::Range;
use super::compile::Precision;
use super::float::gelu;
use super::graph::{Activation, Graph, Kernel, Node, NodeId, Operation, Source};
use crate::{Error, Result};
use elunar_core::nn::format::NONE;
use elunar_core::nn::kernels::padded;
use elunar_core::nn::{self, Dtype, MAX_ADD_SHIFT, MEAN_FRACTION_BITS, NORM_FRACTION_BITS, Operator, Tensor};
use elunar_core::quant::lut::{CODE_TABLE_LEN, LOGIT_BITS};
use elunar_core::quant::params::{multiplier, shift_for};
use elunar_core::quant::{MULTIPLIER_LIMIT, SHIFT_LIMIT};

/// 16-bit maps keep this much room above what calibration saw; 8-bit maps have none to spare.
const HEADROOM_16: f64 = 1.25;
/// A channel's range is taken as at least this share of the widest channel's: calibration sees few tiles.
const RANGE_FLOOR: f64 = 1.0 / 32.0;
/// Accumulators are planned up to here, leaving room for the bias and for rounded weights.
const ACCUMULATOR_LIMIT: f64 = 0.9 * i32::MAX as f64;
/// GELU of anything below is 0 within a code step.
const GELU_FLOOR: f64 = -4.0;
/// The smallest value GELU takes.
const GELU_MINIMUM: f64 = -0.170;

/// How a map's numbers are written down: value = (code - zero) * scale of its channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Codes {
    /// Sample type.
    pub dtype: Dtype,
    /// Code of 0.
    pub zero: i32,
    /// Smallest code.
    pub lo: i32,
    /// Largest code.
    pub hi: i32,
    /// Real value of one step, per channel.
    pub scales: Vec<f64>,
}

/// The quantised network, tensors not placed yet.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    /// Tensors; the first ones are the inputs.
    pub tensors: Vec<Tensor>,
    /// Operators in order.
    pub operators: Vec<Operator>,
    /// Weights, biases, multipliers, tables.
    pub constants: Vec<u8>,
    /// Tensor that holds each node's map as codes (for the output: as f32).
    pub tensor_of: Vec<u32>,
    /// Codes of each node's map; the output's are those of its f32 tensor.
    pub codes: Vec<Codes>,
    /// Mean of each node's map over the calibration tiles, per channel.
    pub means: Vec<Vec<f64>>,
    /// The coarse DTM as f32, or NONE.
    pub coarse_f32: u32,
}

impl Program {
    /// Means of a convolution's input channels.
    pub(crate) fn input_means(&self, sources: &[Source]) -> Vec<f64> {
        sources.iter().flat_map(|s| self.means[s.node].iter().copied()).collect()
    }
}

/// Quantises a graph.
///
/// # Errors
/// [`Error::Usage`] naming the operator whose sums cannot be kept within 32 bits or whose scales are out of range.
pub fn quantise(graph: &Graph, ranges: &[Range], nr: f32, precision: Precision) -> Result<Program> {
    let codes = (0..graph.nodes.len()).map(|id| codes_of(graph, id, &ranges[id], nr, precision)).collect();
    let mut q = Quantiser {
        graph,
        exp_table: None,
        program: Program {
            tensors: Vec::new(),
            operators: Vec::new(),
            constants: Vec::new(),
            tensor_of: Vec::new(),
            codes,
            means: ranges.iter().map(|range| range.mean.clone()).collect(),
            coarse_f32: NONE,
        },
    };
    for id in 0..graph.nodes.len() {
        q.node(id)?;
    }
    Ok(q.program)
}

/// Which scales a map may have.
#[derive(Clone, Copy, PartialEq)]
enum Freedom {
    Channel,
    Group(usize),
    Tensor,
}

fn freedom(graph: &Graph, id: NodeId) -> Freedom {
    let node = &graph.nodes[id];
    if matches!(&node.operation, Operation::Conv { activation: Activation::Gelu, .. }) {
        return Freedom::Tensor; // one table for all channels
    }
    let mut freedom = match &node.operation {
        Operation::Attention { heads, .. } => Freedom::Group(node.channels / heads),
        _ => Freedom::Channel,
    };
    for user in graph.users(id) {
        match &user.operation {
            Operation::LayerNorm { .. } => return Freedom::Tensor,
            Operation::Attention { heads, .. } => freedom = Freedom::Group(node.channels / (3 * heads)),
            _ => {}
        }
    }
    freedom
}

/// The largest code that keeps every user's sums within 32 bits.
fn largest_code(graph: &Graph, id: NodeId) -> i32 {
    let limits = graph.users(id).map(|user| match &user.operation {
        Operation::Conv { sources, kernel, .. } if sources.iter().any(|s| s.node == id) => {
            ACCUMULATOR_LIMIT / (127 * kernel.side * kernel.side * kernel.input) as f64
        }
        Operation::Attention { heads, window, .. } => {
            let size = graph.nodes[id].channels / (3 * heads);
            let logits = (ACCUMULATOR_LIMIT / size as f64).sqrt();
            logits.min(ACCUMULATOR_LIMIT / (i16::MAX as usize * window * window) as f64)
        }
        _ => i16::MAX as f64,
    });
    limits.fold(i16::MAX as f64, f64::min) as i32
}

fn codes_of(graph: &Graph, id: NodeId, range: &Range, nr: f32, precision: Precision) -> Codes {
    let node = &graph.nodes[id];
    let full = i16::MAX as i32;
    match &node.operation {
        Operation::Image => {
            return Codes { dtype: Dtype::I16, zero: 0, lo: 0, hi: full, scales: vec![1.0 / full as f64] };
        }
        // A little beyond [0, NR] on both sides: rounding must not clamp.
        Operation::Coarse => {
            let scales = vec![(nr as f64 * 1.02 / full as f64) as f32 as f64];
            return Codes { dtype: Dtype::I16, zero: 0, lo: -full, hi: full, scales };
        }
        _ => {}
    }
    if id == graph.output() {
        return Codes { dtype: Dtype::F32, zero: 0, lo: 0, hi: 0, scales: vec![1.0] };
    }
    let activation = match &node.operation {
        Operation::Conv { activation, .. } => *activation,
        _ => Activation::None,
    };
    let feeds_norm = graph.users(id).any(|user| matches!(user.operation, Operation::LayerNorm { .. }));
    let wide = match precision {
        Precision::Int8 => feeds_norm,
        Precision::Mixed => feeds_norm || node.precise,
        Precision::Int16 => true,
    };
    let magnitude = channel_magnitudes(range, freedom(graph, id));
    if activation == Activation::Gelu {
        let top = magnitude[0].max(-2.0 * GELU_MINIMUM);
        let scale = (top - GELU_MINIMUM) / 255.0;
        let zero = (-GELU_MINIMUM / scale).ceil() as i32;
        return Codes { dtype: Dtype::U8, zero, lo: 0, hi: 255, scales: vec![scale; node.channels] };
    }
    let limit = largest_code(graph, id);
    let relu = activation == Activation::Relu;
    if wide && limit > 255 {
        let scales = magnitude.iter().map(|m| m * HEADROOM_16 / limit as f64).collect();
        return Codes { dtype: Dtype::I16, zero: 0, lo: if relu { 0 } else { -limit }, hi: limit, scales };
    }
    let (zero, steps) = if relu { (0, 255.0) } else { (128, 127.0) };
    Codes { dtype: Dtype::U8, zero, lo: 0, hi: 255, scales: magnitude.iter().map(|m| m / steps).collect() }
}

/// Largest absolute value that each channel's scale must reach.
fn channel_magnitudes(range: &Range, freedom: Freedom) -> Vec<f64> {
    let mut magnitude = range.magnitude();
    let widest = magnitude.iter().copied().fold(0.0, f64::max);
    let widest = if widest > 0.0 { widest } else { 1.0 };
    let group = match freedom {
        Freedom::Channel => 1,
        Freedom::Group(size) => size,
        Freedom::Tensor => magnitude.len(),
    };
    for channels in magnitude.chunks_mut(group) {
        let largest = channels.iter().copied().fold(widest * RANGE_FLOOR, f64::max);
        channels.fill(largest);
    }
    magnitude
}

struct Quantiser<'a> {
    graph: &'a Graph,
    program: Program,
    exp_table: Option<(usize, usize)>,
}

impl Quantiser<'_> {
    fn node(&mut self, id: NodeId) -> Result<()> {
        let node = &self.graph.nodes[id];
        let tensor = self.tensor(node, &self.program.codes[id].clone());
        self.program.tensor_of.push(tensor);
        let fail = |what: &str| Error::usage(format!("export: {}: {what}", node.name));
        let operator = match &node.operation {
            Operation::Image => return Ok(()),
            Operation::Coarse => {
                let read_as_float =
                    self.graph.nodes.last().is_some_and(
                        |head| matches!(head.operation, Operation::Conv { add: Some(add), .. } if add == id),
                    );
                if read_as_float {
                    let codes = Codes { dtype: Dtype::F32, zero: 0, lo: 0, hi: 0, scales: vec![1.0] };
                    self.program.coarse_f32 = self.tensor(node, &codes);
                }
                return Ok(());
            }
            Operation::Conv { sources, kernel, stride, pad, add, activation } => {
                let form = Form { stride: *stride, pad: *pad, add: *add, activation: *activation };
                self.conv(id, sources, kernel, form)
            }
            Operation::LayerNorm { input, merge, gain, bias } => self.layer_norm(id, *input, *merge, gain, bias),
            Operation::Attention { .. } => self.attention(id),
        };
        self.program.operators.push(operator.ok_or_else(|| fail("scales are out of the range of 30-bit multipliers"))?);
        Ok(())
    }

    fn tensor(&mut self, node: &Node, codes: &Codes) -> u32 {
        self.program.tensors.push(Tensor {
            dtype: codes.dtype,
            rows: node.rows,
            cols: node.cols,
            channels: node.channels,
            offset: 0,
            zero: codes.zero,
            lo: codes.lo,
            hi: codes.hi,
            scale: codes.scales[0] as f32,
        });
        self.program.tensors.len() as u32 - 1
    }

    fn constant(&mut self, bytes: impl IntoIterator<Item = u8>) -> usize {
        // Eight-byte alignment: not needed by the runner, welcome to people with hex editors.
        self.program.constants.resize(self.program.constants.len().next_multiple_of(8), 0);
        let offset = self.program.constants.len();
        self.program.constants.extend(bytes);
        offset
    }

    fn words(&mut self, values: impl IntoIterator<Item = i32>) -> usize {
        self.constant(values.into_iter().flat_map(|v| v.to_le_bytes()))
    }

    fn halves(&mut self, values: impl IntoIterator<Item = i16>) -> usize {
        self.constant(values.into_iter().flat_map(|v| v.to_le_bytes()))
    }

    /// Real value of one step of each input channel as the convolution reads it, and each source's rounding shift.
    fn read_scales(&self, sources: &[Source], kernel: &Kernel) -> (Vec<f64>, Vec<nn::Source>) {
        let limit = (ACCUMULATOR_LIMIT / (127 * kernel.side * kernel.side * kernel.input) as f64).min(i16::MAX as f64);
        let (mut scales, mut read) = (Vec::new(), Vec::new());
        for source in sources {
            let codes = &self.program.codes[source.node];
            let magnitude = (codes.hi - codes.zero).max(codes.zero - codes.lo);
            // Enlargement is exact in sixteenths; drop only what the accumulator cannot take.
            let shift = (0..4).find(|s| ((magnitude * 16 + 15) >> s) as f64 <= limit).unwrap_or(4);
            let step = if source.up { (1 << shift) as f64 / 16.0 } else { 1.0 };
            scales.extend(codes.scales.iter().map(|s| s * step));
            let tensor = self.program.tensor_of[source.node];
            read.push(nn::Source { tensor, up: source.up, shift: if source.up { shift } else { 0 } });
        }
        (scales, read)
    }

    fn conv(&mut self, id: NodeId, sources: &[Source], kernel: &Kernel, form: Form) -> Option<Operator> {
        let (read_scales, read) = self.read_scales(sources, kernel);
        let integers = quantise_weights(kernel, &read_scales, &self.program.input_means(sources));
        let segment = padded(kernel.side * kernel.input);
        let mut packed = Vec::with_capacity(kernel.output * kernel.side * segment);
        for row in integers.weights.chunks_exact(kernel.side * kernel.input) {
            packed.extend(row.iter().map(|&w| w as u8));
            packed.resize(packed.len().next_multiple_of(segment), 0);
        }
        let weights = self.constant(packed);
        let bias = self.words(integers.bias.iter().copied());
        let codes = self.program.codes[id].clone();
        let float = codes.dtype == Dtype::F32;
        let mut conv = nn::Conv {
            out: self.program.tensor_of[id],
            first: read[0],
            second: read.get(1).copied(),
            kernel_rows: kernel.side,
            kernel_cols: kernel.side,
            stride: form.stride,
            pad: form.pad,
            weights,
            bias,
            multipliers: 0,
            shift: 0,
            add: form.add.map(|add| if float { self.program.coarse_f32 } else { self.program.tensor_of[add] }),
            add_multipliers: 0,
            add_shift: 0,
            table: None,
            table_zero: 0,
            relu: float && form.activation == Activation::Relu,
        };
        if float {
            conv.multipliers = self.constant(integers.scales.iter().flat_map(|s| (*s as f32).to_le_bytes()));
            return Some(Operator::Conv(conv));
        }
        let mut out_scales = codes.scales.clone();
        if form.activation == Activation::Gelu {
            let (table, step, zero) = gelu_table(&codes);
            out_scales.fill(step);
            (conv.table, conv.table_zero) = (Some(self.constant(table)), zero);
        }
        let ratios: Vec<f64> = integers.scales.iter().zip(&out_scales).map(|(s, out)| s / out).collect();
        let added: Option<Vec<f64>> = form
            .add
            .map(|add| self.program.codes[add].scales.iter().zip(&out_scales).map(|(s, out)| s / out).collect());
        conv.shift = shift_for(largest(&ratios))?;
        if let Some(added) = &added {
            let room = MULTIPLIER_LIMIT as f64 * (1u64 << MAX_ADD_SHIFT) as f64;
            conv.shift = (1..=conv.shift).rev().find(|s| largest(added) * (1u64 << s) as f64 <= room)?;
            let whole = largest(added) * (1u64 << conv.shift) as f64;
            conv.add_shift = (0..=MAX_ADD_SHIFT).find(|s| whole / (1u64 << s) as f64 <= MULTIPLIER_LIMIT as f64)?;
            let step = (1u64 << conv.add_shift) as f64;
            conv.add_multipliers = self.words(added.iter().map(|r| multiplier(r / step, conv.shift)));
        }
        conv.multipliers = self.words(ratios.iter().map(|r| multiplier(*r, conv.shift)));
        Some(Operator::Conv(conv))
    }

    fn layer_norm(&mut self, id: NodeId, input: NodeId, merge: usize, gain: &[f32], bias: &[f32]) -> Option<Operator> {
        let (out, scale) = (self.program.codes[id].clone(), self.program.codes[input].scales[0]);
        let unit = (1u64 << NORM_FRACTION_BITS) as f64;
        let gains: Vec<f64> = gain.iter().zip(&out.scales).map(|(g, s)| *g as f64 / (s * unit)).collect();
        let biases: Vec<f64> = bias.iter().zip(&out.scales).map(|(b, s)| *b as f64 / s).collect();
        // The bias is kept to 2^59 with its shift.
        let room = |s: &u32| largest(&biases) * (1u64 << s) as f64 <= (1u64 << 59) as f64;
        let shift = (1..=shift_for(largest(&gains).max(1e-30))?.min(SHIFT_LIMIT)).rev().find(room)?;
        let squared_channels = (gain.len() * gain.len()) as f64;
        let epsilon = (squared_channels * NORM_EPSILON / (scale * scale)).round().clamp(1.0, (1u64 << 56) as f64);
        let whole = (1u64 << shift) as f64;
        let norm = nn::LayerNorm {
            out: self.program.tensor_of[id],
            input: self.program.tensor_of[input],
            merge,
            gains: self.words(gains.iter().map(|g| multiplier(*g, shift))),
            biases: self.constant(biases.iter().flat_map(|b| ((b * whole).round() as i64).to_le_bytes())),
            shift,
            epsilon: epsilon as i64,
        };
        Some(Operator::LayerNorm(norm))
    }

    fn attention(&mut self, id: NodeId) -> Option<Operator> {
        let Operation::Attention { input, heads, window, shift, position_bias, pad } = &self.graph.nodes[id].operation
        else {
            return None;
        };
        let (codes, out) = (self.program.codes[*input].clone(), self.program.codes[id].clone());
        let channels = out.scales.len();
        let size = channels / heads;
        let scale = |part: usize, head: usize| codes.scales[part * channels + head * size];
        let unit = (1u64 << LOGIT_BITS) as f64;
        let logits: Vec<f64> =
            (0..*heads).map(|h| scale(0, h) * scale(1, h) * (size as f64).powf(-0.5) * unit).collect();
        let mean_unit = (1u64 << MEAN_FRACTION_BITS) as f64;
        let means: Vec<f64> = (0..*heads).map(|h| scale(2, h) / (out.scales[h * size] * mean_unit)).collect();
        let (logit_shift, mean_shift) = (shift_for(largest(&logits))?, shift_for(largest(&means))?);
        let limit = largest_code(self.graph, *input) as f64;
        let pad_code = |c: usize| (pad[c] as f64 / codes.scales[c]).round().clamp(-limit, limit) as i16;
        let table = position_bias.len() / heads;
        let bias = (0..*heads).flat_map(|h| (0..table).map(move |i| position_bias[i * heads + h]));
        let bias: Vec<i16> = bias.map(|b| (b as f64 * unit).round().clamp(-32767.0, 32767.0) as i16).collect();
        let (exp_table, exp_len) = self.exp_table();
        let attention = nn::Attention {
            out: self.program.tensor_of[id],
            input: self.program.tensor_of[*input],
            heads: *heads,
            window: *window,
            shift_rows: shift.0,
            shift_cols: shift.1,
            pad_codes: self.halves((0..3 * channels).map(pad_code)),
            logit_multipliers: self.words(logits.iter().map(|r| multiplier(*r, logit_shift))),
            logit_shift,
            position_bias: self.halves(bias),
            exp_table,
            exp_len,
            multipliers: self.words(means.iter().map(|r| multiplier(*r, mean_shift))),
            shift: mean_shift,
        };
        Some(Operator::Attention(attention))
    }

    /// One table for the whole network, up to the distance where the exponential rounds to 0.
    fn exp_table(&mut self) -> (usize, usize) {
        if let Some(table) = self.exp_table {
            return table;
        }
        let unit = (1u64 << LOGIT_BITS) as f64;
        let entry = |d: usize| (i16::MAX as f64 * (-(d as f64) / unit).exp()).round() as i16;
        let entries: Vec<i16> = (0..).map(entry).take_while(|e| *e > 0).collect();
        let table = (self.halves(entries.iter().copied()), entries.len());
        self.exp_table = Some(table);
        table
    }
}

/// The part of a convolution that is not weights.
#[derive(Clone, Copy)]
struct Form {
    stride: usize,
    pad: usize,
    add: Option<NodeId>,
    activation: Activation,
}

/// Symmetric i8 weights with one scale per output channel, and the bias in steps of the accumulator.
pub(crate) struct Integers {
    /// `[output][side][side][input]`.
    pub(crate) weights: Vec<i8>,
    /// `[output]`.
    pub(crate) bias: Vec<i32>,
    /// Real value of one step of the accumulator, `[output]`.
    pub(crate) scales: Vec<f64>,
}

/// `read_scales`: real value of one step of each input channel; `means`: the channels' means. What rounding the weights does to
/// the mean of the output, the bias takes back.
pub(crate) fn quantise_weights(kernel: &Kernel, read_scales: &[f64], means: &[f64]) -> Integers {
    let taps = kernel.side * kernel.side * kernel.input;
    let mut out = Integers { weights: Vec::with_capacity(taps * kernel.output), bias: Vec::new(), scales: Vec::new() };
    for (filter, bias) in kernel.weights.chunks_exact(taps).zip(&kernel.bias) {
        let real: Vec<f64> =
            filter.iter().enumerate().map(|(i, w)| *w as f64 * read_scales[i % kernel.input]).collect();
        // The bias must fit as well, with room for the sum beside it.
        let scale = (largest(&real) / 127.0).max(bias.abs() as f64 / (1u64 << 26) as f64).max(1e-18);
        let mut shift_of_mean = 0.0;
        for (i, w) in real.iter().enumerate() {
            let rounded = (w / scale).round();
            shift_of_mean += (rounded * scale - w) / read_scales[i % kernel.input] * means[i % kernel.input];
            out.weights.push(rounded as i8);
        }
        out.bias.push(((*bias as f64 - shift_of_mean) / scale).round() as i32);
        out.scales.push(scale);
    }
    out
}

/// Table from intermediate code to GELU's code, with the intermediate step and zero.
pub(crate) fn gelu_table(codes: &Codes) -> (Vec<u8>, f64, i32) {
    let top = (codes.hi - codes.zero) as f64 * codes.scales[0];
    let step = (top - GELU_MINIMUM - GELU_FLOOR) / (CODE_TABLE_LEN - 1) as f64;
    let zero = (-GELU_FLOOR / step).round() as i32;
    let entry = |code: usize| {
        let y = gelu((code as i32 - zero) as f64 * step) / codes.scales[0];
        ((y + 0.5).floor() as i32 + codes.zero).clamp(codes.lo, codes.hi) as u8
    };
    ((0..CODE_TABLE_LEN).map(entry).collect(), step, zero)
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m, v| m.max(v.abs()))
}
