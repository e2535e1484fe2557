//! Quantisation: from real weights and ranges to codes of every map, integer weights, multipliers, tables.
//!
//! A map has one scale per channel if possible. The scale of an input channel becomes part of the weights that read it, so it costs
//! nothing. A layer norm needs one scale for all channels, attention needs one per head.

use super::build::NORM_EPSILON;
use super::calibrate::Range;
use super::codes::{Codes, GELU_MINIMUM, codes_of};
use super::float::gelu;
use super::fold::fold;
use super::graph::{Activation, ConvInput, Graph, LayerWeights, Node, NodeId, Operation};
use super::pack::{Filter, IntegerFilter, Integers, pack};
use elunar_base::{Error, Result};
use elunar_core::nn::file::{
    self, Dtype, Edge, MAX_ADD_SHIFT, MEAN_FRACTION_BITS, NORM_FRACTION_BITS, Operator, Tensor,
};
use elunar_core::quant::lut::{CODE_TABLE_LEN, EXP_COARSE, EXP_FINE, LOGIT_BITS};
use elunar_core::quant::params::{multiplier, shift_for};
use elunar_core::quant::{MULTIPLIER_LIMIT, SHIFT_LIMIT};
use std::collections::HashMap;

/// Number of columns of the output map that are computed together. It is the number of channels of the narrowest panel.
const COLUMNS_AT_ONCE: usize = 8;
/// With at least this many bytes of weights, rows are computed in blocks. The second constant is the number of pixels in a block.
const BLOCK_WEIGHT_BYTES: usize = 1 << 20;
const BLOCK_PIXELS: usize = 80;
/// End of the name of an operator that upsamples, in every model file. It must not change, so that the same weights give the same bytes.
pub const UPSAMPLED: &str = ".enlarged";

/// Number of rows of the smallest map whose upsampling is folded into the convolution after it.
const FOLD_ROWS: usize = 16;
/// Number of weights of all filters and corrections of a folded 5x5 convolution, per input and output channel.
const FOLDED_TAPS: usize = 12 * 12;
/// Below this value, GELU is 0 within a code step.
const GELU_FLOOR: f64 = -4.0;

/// The quantised network, before its tensors are placed.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    /// Tensors; the first ones are the inputs.
    pub tensors: Vec<Tensor>,
    /// Operators in order.
    pub operators: Vec<Operator>,
    /// Name of each operator: the name of the node that it makes, or of which it computes a part.
    pub names: Vec<String>,
    /// Weights, biases, multipliers, tables.
    pub constants: Vec<u8>,
    /// Tensor with the codes of each node's map (for the output: with its f32 samples).
    pub tensor_of: Vec<u32>,
    /// Codes of each node's map. For the output, they describe its f32 tensor.
    pub codes: Vec<Codes>,
    /// Mean of each node's map over the calibration tiles, per channel.
    pub means: Vec<Vec<f64>>,
}

impl Program {
    /// Returns the means of a convolution's input channels.
    pub(crate) fn input_means(&self, sources: &[ConvInput]) -> Vec<f64> {
        sources.iter().flat_map(|s| self.means[s.node].iter().copied()).collect()
    }
}

/// Quantises a graph. `wide` says for every node whether its map keeps 16 bits, if it can (see [`can_widen`]).
///
/// # Errors
/// [`Error::Input`] with the name of the operator whose sums exceed 32 bits or whose scales are out of range.
pub fn quantise(graph: &Graph, ranges: &[Range], coarse_limit: f32, wide: &[bool]) -> Result<Program> {
    let codes = (0..graph.nodes.len()).map(|id| codes_of(graph, id, &ranges[id], coarse_limit, wide[id])).collect();
    let mut q = Quantiser {
        graph,
        exp_table: None,
        upsampled: HashMap::new(),
        program: Program {
            tensors: Vec::new(),
            operators: Vec::new(),
            names: Vec::new(),
            constants: Vec::new(),
            tensor_of: Vec::new(),
            codes,
            means: ranges.iter().map(|range| range.mean.clone()).collect(),
        },
    };
    for id in 0..graph.nodes.len() {
        q.node(id)?;
    }
    set_margins(&mut q.program.tensors, &q.program.operators);
    Ok(q.program)
}

struct Quantiser<'a> {
    graph: &'a Graph,
    program: Program,
    exp_table: Option<usize>,
    /// Upsampled tensors by node.
    upsampled: HashMap<NodeId, u32>,
}

impl Quantiser<'_> {
    fn node(&mut self, id: NodeId) -> Result<()> {
        let node = &self.graph.nodes[id];
        let tensor = self.tensor(node, &self.program.codes[id].clone());
        self.program.tensor_of.push(tensor);
        let fail = |what: &str| Error::input(format!("export: {}: {what}", node.name));
        let operator = match &node.operation {
            Operation::Image | Operation::Coarse => return Ok(()),
            Operation::Conv { sources, kernel, stride, pad, add, activation } => {
                let form = Form { stride: *stride, pad: *pad, add: *add, activation: *activation };
                self.conv(id, sources, kernel, form)
            }
            Operation::LayerNorm { input, merge, gain, bias } => self.layer_norm(id, *input, *merge, gain, bias),
            Operation::Attention { .. } => self.attention(id),
        };
        let operator = operator.ok_or_else(|| fail("scales are out of the range of 30-bit multipliers"))?;
        self.push(operator, &node.name);
        Ok(())
    }

    fn tensor(&mut self, node: &Node, codes: &Codes) -> u32 {
        self.program.tensors.push(Tensor {
            sums: 0,
            dtype: codes.dtype,
            rows: node.rows,
            cols: node.cols,
            channels: node.channels,
            offset: 0,
            zero: codes.zero,
            lo: codes.lo,
            hi: codes.hi,
            scale: codes.scales[0] as f32,
            ring: node.rows,
            pitch: 0,
            margin: 0,
            edge: Edge::Zero,
        });
        self.program.tensors.len() as u32 - 1
    }

    fn push(&mut self, operator: Operator, name: &str) {
        self.program.operators.push(operator);
        self.program.names.push(name.into());
    }

    /// Returns the tensor of a node upsampled twofold. It is made once.
    fn upsampled(&mut self, node: NodeId) -> u32 {
        if let Some(&tensor) = self.upsampled.get(&node) {
            return tensor;
        }
        let input = self.program.tensor_of[node];
        let small = self.program.tensors[input as usize];
        self.program.tensors.push(Tensor { rows: 2 * small.rows, cols: 2 * small.cols, ring: 2 * small.rows, ..small });
        let out = self.program.tensors.len() as u32 - 1;
        let name = format!("{}{UPSAMPLED}", self.graph.nodes[node].name);
        self.push(Operator::Upsample2(file::Upsample2 { out, input }), &name);
        self.upsampled.insert(node, out);
        out
    }

    /// Returns the number of columns of the one-channel output that are computed as channels of one pixel. Panels have at least
    /// [`COLUMNS_AT_ONCE`] channels. The result has the same bytes.
    fn columns_at_once(&mut self, id: NodeId, kernel: &LayerWeights, form: Form) -> usize {
        let out = &mut self.program.tensors[self.program.tensor_of[id] as usize];
        let fits = out.cols.is_multiple_of(COLUMNS_AT_ONCE) && kernel.side + COLUMNS_AT_ONCE - 1 <= file::MAX_KERNEL;
        if out.channels != 1 || form.stride != 1 || !fits {
            return 1;
        }
        (out.cols, out.channels) = (out.cols / COLUMNS_AT_ONCE, COLUMNS_AT_ONCE);
        COLUMNS_AT_ONCE
    }

    fn constant(&mut self, bytes: impl IntoIterator<Item = u8>) -> usize {
        // Alignment to eight bytes makes the file easier to read in a hex editor. The runner does not need it.
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

    #[expect(clippy::too_many_lines, reason = "every field of the record, in its order")]
    fn conv(&mut self, id: NodeId, sources: &[ConvInput], kernel: &LayerWeights, form: Form) -> Option<Operator> {
        let read_scales: Vec<f64> =
            sources.iter().flat_map(|s| self.program.codes[s.node].scales.iter().copied()).collect();
        let folds = folds(self.graph, &self.graph.nodes[id]);
        let beside =
            if self.program.codes[id].dtype == Dtype::F32 { self.columns_at_once(id, kernel, form) } else { 1 };
        let widened;
        let (kernel, filters) = if beside > 1 {
            widened = side_by_side(kernel, beside);
            (&widened.0, vec![widened.1.clone()])
        } else if folds {
            (kernel, fold(kernel))
        } else {
            (kernel, vec![Filter::whole(kernel)])
        };
        let integers = quantise_weights(kernel, &filters, &read_scales, &self.program.input_means(sources));
        let read: Vec<u32> = sources
            .iter()
            .map(|s| if s.up && !folds { self.upsampled(s.node) } else { self.program.tensor_of[s.node] })
            .collect();
        let tensors: Vec<Tensor> = read.iter().map(|&t| self.program.tensors[t as usize]).collect();
        let packed = pack(&integers, kernel.output, &tensors);
        let weight_bytes = packed.weights.len();
        let weights = self.constant(packed.weights);
        let bias = self.words(packed.bias);
        let codes = self.program.codes[id].clone();
        let float = codes.dtype == Dtype::F32;
        let mut conv = file::Conv {
            out: self.program.tensor_of[id],
            first: read[0],
            second: read.get(1).copied(),
            block: if folds {
                // Four filters of 16 taps. The corrections are used at the border only.
                block(weight_bytes * 4 * 16 / FOLDED_TAPS, tensors[0].cols)
            } else {
                block(weight_bytes, self.graph.nodes[id].cols)
            },
            fold: folds,
            kernel_rows: kernel.side,
            kernel_cols: kernel.side + beside - 1,
            stride: form.stride,
            stride_cols: form.stride * beside,
            pad: form.pad,
            weights,
            bias,
            multipliers: 0,
            shift: 0,
            add: form.add.map(|add| self.program.tensor_of[add]),
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
        // The bias with its shift is limited to 2^59.
        let room = |s: &u32| largest(&biases) * (1u64 << s) as f64 <= (1u64 << 59) as f64;
        let shift = (1..=shift_for(largest(&gains).max(1e-30))?.min(SHIFT_LIMIT)).rev().find(room)?;
        let squared_channels = (gain.len() * gain.len()) as f64;
        let epsilon = (squared_channels * NORM_EPSILON / (scale * scale)).round().clamp(1.0, (1u64 << 56) as f64);
        let whole = (1u64 << shift) as f64;
        let norm = file::LayerNorm {
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
        let pad_code = |c: usize| (pad[c] as f64 / codes.scales[c]).round().clamp(-127.0, 127.0) as i32 + codes.zero;
        let table = position_bias.len() / heads;
        // The reference counts query minus key; this program counts key minus query.
        let bias = (0..*heads).flat_map(|h| (0..table).rev().map(move |i| position_bias[i * heads + h]));
        let bias: Vec<i16> = bias.map(|b| (b as f64 * unit).round().clamp(-32767.0, 32767.0) as i16).collect();
        let exp_table = self.exp_table();
        let attention = file::Attention {
            out: self.program.tensor_of[id],
            input: self.program.tensor_of[*input],
            heads: *heads,
            window: *window,
            shift_rows: shift.0,
            shift_cols: shift.1,
            pad_codes: self.constant((0..3 * channels).map(|c| pad_code(c) as u8)),
            logit_multipliers: self.words(logits.iter().map(|r| multiplier(*r, logit_shift))),
            logit_shift,
            position_bias: self.halves(bias),
            exp_table,
            multipliers: self.words(means.iter().map(|r| multiplier(*r, mean_shift))),
            shift: mean_shift,
        };
        Some(Operator::Attention(attention))
    }

    /// Returns the offset of the exponential's tables. The whole network shares them.
    fn exp_table(&mut self) -> usize {
        if let Some(table) = self.exp_table {
            return table;
        }
        let unit = (1u64 << LOGIT_BITS) as f64;
        let entry = |d: usize| (i16::MAX as f64 * (-(d as f64) / unit).exp()).round() as i16;
        let coarse = (0..EXP_COARSE).map(|i| entry(i * EXP_FINE));
        let table = self.halves(coarse.chain((0..EXP_FINE).map(entry)));
        self.exp_table = Some(table);
        table
    }
}

/// Returns whether the upsampling before a convolution is folded into its weights. The weights grow 6-fold, so it is done only if many
/// pixels share them (our choice: small maps of 16 rows or more). No source may need a different margin.
pub(crate) fn folds(graph: &Graph, node: &Node) -> bool {
    let Operation::Conv { sources, kernel, stride, pad, .. } = &node.operation else { return false };
    let padded_elsewhere = |id: NodeId| {
        graph.users(id).any(|user| match &user.operation {
            Operation::Conv { sources, pad, .. } => *pad > 0 && sources.iter().any(|s| s.node == id && !s.up),
            _ => false,
        })
    };
    (kernel.side, *stride, *pad) == (5, 1, 2)
        && sources.iter().all(|s| s.up && graph.nodes[s.node].rows >= FOLD_ROWS && !padded_elsewhere(s.node))
}

/// Returns the number of output rows per step (when folded, rows of the small map). It is more than one if a row of `cols` pixels is short
/// and the weights exceed a second-level cache.
fn block(weight_bytes: usize, cols: usize) -> usize {
    if weight_bytes < BLOCK_WEIGHT_BYTES { 1 } else { (BLOCK_PIXELS / cols).clamp(1, file::MAX_BLOCK) }
}

/// Converts a filter with one output into one with `columns` outputs, each one column to the right of the one before.
fn side_by_side(kernel: &LayerWeights, columns: usize) -> (LayerWeights, Filter) {
    let (side, input, wide) = (kernel.side, kernel.input, kernel.side + columns - 1);
    let mut weights = vec![0.0; columns * side * wide * input];
    for shift in 0..columns {
        for row in 0..side {
            let to = ((shift * side + row) * wide + shift) * input;
            let from = &kernel.weights[row * side * input..(row + 1) * side * input];
            weights[to..to + from.len()].iter_mut().zip(from).for_each(|(to, from)| *to = *from as f64);
        }
    }
    let bias = vec![kernel.bias[0]; columns];
    (
        LayerWeights { output: columns, bias, ..kernel.clone() },
        Filter { extent: (side, wide), weights, correction: false },
    )
}

/// Properties of a convolution apart from its weights.
#[derive(Clone, Copy)]
struct Form {
    stride: usize,
    pad: usize,
    add: Option<NodeId>,
    activation: Activation,
}

/// Quantises weights. `read_scales` is the real value of one step of each input channel; `means` are the channels' means. Rounding of the
/// weights changes the mean of the output, and the bias compensates for this.
pub(crate) fn quantise_weights(
    kernel: &LayerWeights,
    filters: &[Filter],
    read_scales: &[f64],
    means: &[f64],
) -> Integers {
    let real = |filter: &Filter, o: usize| -> Vec<f64> {
        let taps = filter.weights.len() / kernel.output;
        let weights = &filter.weights[o * taps..(o + 1) * taps];
        weights.iter().enumerate().map(|(i, w)| w * read_scales[i % kernel.input]).collect()
    };
    let scale = |o: usize| {
        let widest = filters.iter().map(|f| largest(&real(f, o))).fold(0.0, f64::max);
        // The bias must fit as well, together with the sum.
        (widest / 127.0).max(kernel.bias[o].abs() as f64 / (1u64 << 26) as f64).max(1e-18)
    };
    let scales: Vec<f64> = (0..kernel.output).map(scale).collect();
    let round = |filter: &Filter| {
        let mut out = IntegerFilter { extent: filter.extent, weights: Vec::new(), bias: Vec::new() };
        for (o, scale) in scales.iter().enumerate() {
            let mut shift_of_mean = 0.0;
            for (i, w) in real(filter, o).iter().enumerate() {
                let rounded = (w / scale).round().clamp(-127.0, 127.0);
                shift_of_mean += (rounded * scale - w) / read_scales[i % kernel.input] * means[i % kernel.input];
                out.weights.push(rounded as i8);
            }
            let bias = if filter.correction { 0.0 } else { kernel.bias[o] as f64 };
            out.bias.push(((bias - shift_of_mean) / scale).round() as i32);
        }
        out
    };
    Integers { filters: filters.iter().map(round).collect(), scales }
}

/// Sets margins as wide as the widest padding of a tensor's readers, or two repeated columns for a folded upsampling.
fn set_margins(tensors: &mut [Tensor], operators: &[Operator]) {
    for operator in operators {
        let Operator::Conv(conv) = operator else { continue };
        for source in conv.sources() {
            let t = &mut tensors[source as usize];
            if conv.fold {
                (t.margin, t.edge) = (2, Edge::Nearest);
            } else {
                t.margin = t.margin.max(conv.pad);
            }
        }
    }
}

/// Returns the table from intermediate code to GELU's code, with the intermediate step and zero.
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
