//! The program: records of operators and of the schedule, as the file holds them and as the runner uses them.
//!
//! A program is a list of operators over tensors at fixed arena offsets, and a schedule that says in which order their rows are
//! made: an operator may run a few rows ahead of its reader, so that only those rows need memory. Four operators carry the whole
//! network and its ablations: a convolution that reads two tensors side by side (so concatenation costs nothing), adds another
//! tensor, clamps and maps through a table, and can contain the bilinear enlargement before it; the enlargement by itself; a
//! layer norm that can gather 2x2 neighbours (patch merging); and window attention.

use super::error::OperatorFault;
use super::format::{NONE, i64_at, seal_record, sealed, u32_at};
use super::sum::seal;
pub use super::tensor::{Dtype, Edge, MAX_MARGIN, TENSOR_BYTES, Tensor};
use core::ops::Range;

/// Bytes of an operator record.
pub const OPERATOR_BYTES: usize = 96;
/// Bytes of an entry of the schedule.
pub const ENTRY_BYTES: usize = 8;
const KIND_CONV: u32 = 1;
const KIND_LAYER_NORM: u32 = 2;
const KIND_ATTENTION: u32 = 3;
const KIND_ENLARGE: u32 = 4;

/// Largest left shift of an added tensor: i16 times `2^30` times `2^15` stays below `2^60`.
pub const MAX_ADD_SHIFT: u32 = 15;

/// `count` steps of one operator, from step `first` on. An operator's steps run once each, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Which operator.
    pub operator: usize,
    /// Its first step.
    pub first: usize,
    /// Number of steps.
    pub count: usize,
}

impl Entry {
    /// Reads an entry; `None` if its seal is broken.
    #[inline]
    pub fn decode(bytes: &[u8; ENTRY_BYTES]) -> Option<Self> {
        let [a, b, c, d, e, f, g, h] = *bytes;
        let halves = [[a, b], [c, d], [e, f]].map(u16::from_le_bytes);
        let [operator, first, count] = halves.map(usize::from);
        (Self::seal(halves) == u16::from_le_bytes([g, h])).then_some(Self { operator, first, count })
    }

    /// Writes the last of the four numbers of an entry's bytes.
    pub(super) fn seal_record(bytes: &mut [u8; ENTRY_BYTES]) {
        let [a, b, c, d, e, f, ..] = *bytes;
        let [g, h] = Self::seal([[a, b], [c, d], [e, f]].map(u16::from_le_bytes)).to_le_bytes();
        *bytes = [a, b, c, d, e, f, g, h];
    }

    /// The last of its four numbers, from the others.
    fn seal(halves: [u16; 3]) -> u16 {
        let whole = seal(halves.map(u32::from));
        (whole ^ whole >> 16) as u16
    }

    /// The entry's bytes. Each number is below 65536.
    pub fn encode(&self) -> [u8; ENTRY_BYTES] {
        let mut bytes = [0; ENTRY_BYTES];
        let halves = [self.operator, self.first, self.count].map(|v| v as u16);
        let all = halves.into_iter().chain([Self::seal(halves)]);
        bytes.as_chunks_mut::<2>().0.iter_mut().zip(all).for_each(|(b, v)| *b = v.to_le_bytes());
        bytes
    }
}

/// Convolution over the sources' channels side by side, then requantised.
///
/// `code = clamp(zero + (acc*M[o] + (r*A[o] << add_shift) + half) >> shift)` with `acc = bias[o] + Σ code*w`, `r` the added tensor's
/// value; or through a table; or, if the output is F32, `acc * m[o] + r * scale` in floats. The bias contains `-Σ zero*w`, and for a
/// 16-bit source `-32768 Σ w`, so that kernels multiply codes as they are.
///
/// Weights are i8, not -128, `[panel][variant][source][kernel row][group][channel of the panel][4]`: a group is four
/// consecutive samples of a kernel row (`kernel columns * channels`, filled up with zeros), a panel some output channels
/// (see [`super::panels`]), filled up with zeros.
///
/// With `fold` the operator is "enlarge twofold by bilinear interpolation, then convolve 5x5 with zero padding", computed on the
/// small map: a row of the small map gives two rows of the output, and every output phase has a filter of its own ([`Phase`]). A pixel
/// whose row or column has a correction adds up to four variants, weights and biases: (filter, filter), (correction, filter),
/// (filter, correction), (correction, correction).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conv {
    /// Output tensor.
    pub out: u32,
    /// First source.
    pub first: u32,
    /// Second source; its channels follow the first's.
    pub second: Option<u32>,
    /// Kernel rows (5 with `fold`).
    pub kernel_rows: usize,
    /// Kernel columns (5 with `fold`).
    pub kernel_cols: usize,
    /// Input rows from one output row to the next (1 with `fold`).
    pub stride: usize,
    /// Input columns from one output pixel to the next (1 with `fold`). With several columns of a one-channel map as channels of one
    /// pixel, it is their number.
    pub stride_cols: usize,
    /// Zero padding on all four sides (2 with `fold`).
    pub pad: usize,
    /// Output rows per step (with `fold`, rows of the small map): with several, weights that no cache holds are fetched once for all
    /// of them.
    pub block: usize,
    /// Twofold enlargement contained in the weights.
    pub fold: bool,
    /// Constants: i8 weights.
    pub weights: usize,
    /// Constants: i32 `[variant][out]`.
    pub bias: usize,
    /// Constants: i32 multipliers `[out]`, or f32 scales `[out]` if the output is F32.
    pub multipliers: usize,
    /// Right shift after the multiplication.
    pub shift: u32,
    /// Tensor added before rounding.
    pub add: Option<u32>,
    /// Constants: i32 multipliers `[out]` of the added tensor (not used with an F32 output).
    pub add_multipliers: usize,
    /// Left shift of the added tensor's product, at most [`MAX_ADD_SHIFT`].
    pub add_shift: u32,
    /// Constants: 256 output codes by clamped intermediate code.
    pub table: Option<usize>,
    /// With a table: the intermediate code that stands for 0.
    pub table_zero: i32,
    /// With an F32 output: negative results become 0 (the paper's last ReLU).
    pub relu: bool,
}

/// What one output row (or column) of a folded convolution reads of the small map.
///
/// The enlarged map's sample 2i is 3/4 of sample i and 1/4 of its predecessor, sample 2i+1 is 3/4 of i and 1/4 of its successor.
/// Five of them are four samples of the small map, its border repeated. So even outputs have one filter and odd ones another. At
/// the border they see the border sample where the 5x5 convolution has its zero padding: the two outermost outputs on each side
/// take that off again by a correction of one tap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Phase {
    /// Number of the filter: 0 for even, 1 for odd outputs.
    pub filter: usize,
    /// First of its [`PHASE_TAPS`] samples of the small map; outside it the border repeats.
    pub first: isize,
    /// For the two outermost outputs on each side: number of the correction, 2..[`PHASES`], and the border sample.
    pub correction: Option<(usize, usize)>,
}

/// Filters and corrections along one axis of a folded convolution.
pub const PHASES: usize = 6;
/// Filters, corrections of columns, of rows, and of both: no pixel needs more than one set of each kind.
pub(crate) const VARIANT_KINDS: usize = 4;
/// Samples of the small map that each of them reads.
pub const PHASE_TAPS: [usize; PHASES] = [4, 4, 1, 1, 1, 1];

impl Phase {
    /// Of output `index` on a small map of `len` samples, at least 4.
    #[inline]
    pub const fn of(index: usize, len: usize) -> Self {
        let filter = index % 2;
        let correction = match index {
            0 | 1 => Some((2 + filter, 0)),
            _ if index + 2 >= 2 * len => Some((4 + filter, len - 1)),
            _ => None,
        };
        Self { filter, first: (index / 2 + filter) as isize - 2, correction }
    }
}

/// Twofold bilinear enlargement with half-pixel centres and repeated border:
/// `code = (9a + 3b + 3c + d + 8) >> 4`. Input and output have the same codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Enlarge {
    /// Output tensor, twice the rows and columns.
    pub out: u32,
    /// Input tensor.
    pub input: u32,
}

/// Layer norm over channels, per pixel.
///
/// With sum S, V = C·Σx² − S² and d = C·x − S: `y = d / √(V + C²ε)`, in integers; then
/// `code = clamp(zero + (y*G[c] + B[c] + half) >> shift)` with y in 16 fraction bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LayerNorm {
    /// Output tensor.
    pub out: u32,
    /// Input tensor.
    pub input: u32,
    /// 1, or 2 to gather the 2x2 neighbours (rows fastest: 00, 10, 01, 11) into four times the channels first.
    pub merge: usize,
    /// Constants: i32 `[channels]`.
    pub gains: usize,
    /// Constants: i64 `[channels]`.
    pub biases: usize,
    /// Right shift after gain and bias.
    pub shift: u32,
    /// C²ε in squared input code steps, at least 1.
    pub epsilon: i64,
}

/// Attention inside shifted windows (Swin): softmax(q·k/√d + relative position bias) · v.
///
/// The cyclic shift of the paper brings pixels together that are no neighbours and then masks them; the same is to cut the map
/// at `shift`, `shift + window`, ... into windows of which the outer ones are smaller. The input holds q, k, v side by side, each
/// `heads * head channels`, u8 with zero 128. The map is thought to be filled up to whole windows at the right and bottom; there q, k
/// and v are `pad_codes` (the projection's bias, as the padding is zero behind the norm), and count like others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attention {
    /// Output tensor, `[rows, cols, heads * head channels]`.
    pub out: u32,
    /// Input tensor.
    pub input: u32,
    /// Heads.
    pub heads: usize,
    /// Window side.
    pub window: usize,
    /// Where the first cut lies, rows; below `window`.
    pub shift_rows: usize,
    /// The same in columns.
    pub shift_cols: usize,
    /// Constants: u8 `[input channels]`, code of the padding.
    pub pad_codes: usize,
    /// Constants: i32 `[heads]`, q·k to logit.
    pub logit_multipliers: usize,
    /// Right shift of the logits.
    pub logit_shift: u32,
    /// Constants: i16 `[heads][(2 window - 1)²]`, in logits, by key row minus query row and key column minus query column.
    pub position_bias: usize,
    /// Constants: the exponential's two tables, i16, one behind the other (see [`crate::quant::lut::exp_lookup`]).
    pub exp_table: usize,
    /// Constants: i32 `[heads]`, mean of v to output code.
    pub multipliers: usize,
    /// Right shift of the output.
    pub shift: u32,
}

impl Attention {
    /// The pieces into which an axis of `len` pixels is cut: of the axis filled up to whole windows, piece `index`.
    #[inline]
    pub const fn piece(&self, len: usize, shift: usize, index: usize) -> (usize, usize) {
        let whole = len.div_ceil(at_least_one(self.window)) * self.window;
        let start = if shift == 0 || index == 0 { index * self.window } else { shift + (index - 1) * self.window };
        let end = if shift == 0 { start + self.window } else { shift + index * self.window };
        (start, if end < whole { end } else { whole })
    }

    /// Number of pieces that contain pixels of the map.
    pub const fn pieces(&self, len: usize, shift: usize) -> usize {
        let window = at_least_one(self.window);
        if shift == 0 { len.div_ceil(window) } else { 1 + (len - min(shift, len)).div_ceil(window) }
    }
}

const fn at_least_one(n: usize) -> usize {
    if n == 0 { 1 } else { n }
}

const fn min(a: usize, b: usize) -> usize {
    if a < b { a } else { b }
}

/// One operator of the program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Operator {
    /// Convolution, or a linear layer as 1x1.
    Conv(Conv),
    /// Layer norm or patch merging.
    LayerNorm(LayerNorm),
    /// Window attention.
    Attention(Attention),
    /// Bilinear enlargement.
    Enlarge(Enlarge),
}

impl Operator {
    /// Reads a record.
    ///
    /// # Errors
    /// [`OperatorFault::Kind`] for an unknown kind, [`OperatorFault::Seal`] for a broken seal.
    pub fn decode(record: &[u8]) -> Result<Self, OperatorFault> {
        if !sealed(record) {
            return Err(OperatorFault::Seal);
        }
        let word = |i: usize| u32_at(record, 4 * i);
        let size = |i: usize| word(i) as usize;
        let option = |i: usize| Some(word(i)).filter(|&v| v != NONE);
        Ok(match word(0) {
            KIND_CONV => Self::Conv(Conv {
                out: word(1),
                first: word(2),
                second: option(3),
                kernel_rows: size(4),
                kernel_cols: size(5),
                stride: size(6),
                pad: size(7),
                fold: word(8) != 0,
                weights: size(9),
                bias: size(10),
                multipliers: size(11),
                shift: word(12),
                add: option(13),
                add_multipliers: size(14),
                add_shift: word(15),
                table: option(16).map(|v| v as usize),
                table_zero: word(17) as i32,
                relu: word(18) != 0,
                stride_cols: size(19),
                block: size(20),
            }),
            KIND_LAYER_NORM => Self::LayerNorm(LayerNorm {
                out: word(1),
                input: word(2),
                merge: size(3),
                gains: size(4),
                biases: size(5),
                shift: word(6),
                epsilon: i64_at(record, 32),
            }),
            KIND_ATTENTION => Self::Attention(Attention {
                out: word(1),
                input: word(2),
                heads: size(3),
                window: size(4),
                shift_rows: size(5),
                shift_cols: size(6),
                pad_codes: size(7),
                logit_multipliers: size(8),
                logit_shift: word(9),
                position_bias: size(10),
                exp_table: size(11),
                multipliers: size(12),
                shift: word(13),
            }),
            KIND_ENLARGE => Self::Enlarge(Enlarge { out: word(1), input: word(2) }),
            _ => return Err(OperatorFault::Kind),
        })
    }

    /// The record's bytes.
    pub fn encode(&self) -> [u8; OPERATOR_BYTES] {
        let mut words = [0u32; OPERATOR_BYTES / 4];
        let none = |v: Option<u32>| v.unwrap_or(NONE);
        let fields: [u32; 21] = match self {
            Self::Conv(c) => [
                KIND_CONV,
                c.out,
                c.first,
                none(c.second),
                c.kernel_rows as u32,
                c.kernel_cols as u32,
                c.stride as u32,
                c.pad as u32,
                c.fold as u32,
                c.weights as u32,
                c.bias as u32,
                c.multipliers as u32,
                c.shift,
                none(c.add),
                c.add_multipliers as u32,
                c.add_shift,
                none(c.table.map(|v| v as u32)),
                c.table_zero as u32,
                c.relu as u32,
                c.stride_cols as u32,
                c.block as u32,
            ],
            Self::LayerNorm(n) => {
                let (low, high) = (n.epsilon as u32, (n.epsilon >> 32) as u32);
                let head = [KIND_LAYER_NORM, n.out, n.input, n.merge as u32, n.gains as u32, n.biases as u32, n.shift];
                filled(&[&head[..], &[0, low, high]])
            }
            Self::Attention(a) => filled(&[&[
                KIND_ATTENTION,
                a.out,
                a.input,
                a.heads as u32,
                a.window as u32,
                a.shift_rows as u32,
                a.shift_cols as u32,
                a.pad_codes as u32,
                a.logit_multipliers as u32,
                a.logit_shift,
                a.position_bias as u32,
                a.exp_table as u32,
                a.multipliers as u32,
                a.shift,
            ]]),
            Self::Enlarge(e) => filled(&[&[KIND_ENLARGE, e.out, e.input]]),
        };
        words.iter_mut().zip(fields).for_each(|(word, field)| *word = field);
        let mut record = [0; OPERATOR_BYTES];
        record.as_chunks_mut::<4>().0.iter_mut().zip(words).for_each(|(bytes, word)| *bytes = word.to_le_bytes());
        seal_record(&mut record);
        record
    }

    /// The tensor it writes.
    pub const fn output(&self) -> u32 {
        match self {
            Self::Conv(c) => c.out,
            Self::LayerNorm(n) => n.out,
            Self::Attention(a) => a.out,
            Self::Enlarge(e) => e.out,
        }
    }

    /// The tensors it reads, the added one last.
    pub fn inputs(&self) -> [Option<u32>; 3] {
        match self {
            Self::Conv(c) => [Some(c.first), c.second, c.add],
            Self::LayerNorm(n) => [Some(n.input), None, None],
            Self::Attention(a) => [Some(a.input), None, None],
            Self::Enlarge(e) => [Some(e.input), None, None],
        }
    }

    /// One word for reports.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Conv(c) if c.fold => "up-conv",
            Self::Conv(_) => "conv",
            Self::LayerNorm(n) if n.merge == 2 => "merge-norm",
            Self::LayerNorm(_) => "layer-norm",
            Self::Attention(_) => "attention",
            Self::Enlarge(_) => "enlarge",
        }
    }

    /// Steps of this operator that make all of `out`: a step is one output row or a block of them; two for an enlargement, or twice a
    /// block for one that a convolution contains; a row of windows for an attention.
    #[inline]
    pub const fn steps(&self, out: &Tensor) -> usize {
        match self {
            Self::Enlarge(_) => out.rows / 2,
            Self::Conv(c) => out.rows.div_ceil(at_least_one(c.step_rows())),
            Self::LayerNorm(_) => out.rows,
            Self::Attention(a) => a.pieces(out.rows, a.shift_rows),
        }
    }

    /// Rows of `out` that exist after the first `steps` steps.
    #[inline]
    pub const fn rows_after(&self, out: &Tensor, steps: usize) -> usize {
        match self {
            Self::Enlarge(_) => 2 * steps,
            Self::Conv(c) => min(c.step_rows() * steps, out.rows),
            Self::LayerNorm(_) => steps,
            Self::Attention(_) if steps == 0 => 0,
            Self::Attention(a) => min(a.piece(out.rows, a.shift_rows, steps - 1).1, out.rows),
        }
    }

    /// Rows of input `slot` (see [`Self::inputs`], of `rows` rows) that step `step` reads; empty if it reads padding only.
    pub fn rows_read(&self, out: &Tensor, slot: usize, rows: usize, step: usize) -> Range<usize> {
        match self {
            Self::Conv(_) if slot == 2 => self.rows_after(out, step)..self.rows_after(out, step + 1),
            Self::Conv(c) if c.fold => {
                let block = c.step_rows() / 2;
                (block * step).saturating_sub(2)..min(block * (step + 1) + 2, rows)
            }
            Self::Conv(c) => {
                let made = self.rows_after(out, step)..self.rows_after(out, step + 1);
                let first = (made.start * c.stride).saturating_sub(c.pad);
                let end = (made.end.saturating_sub(1) * c.stride + c.kernel_rows).saturating_sub(c.pad);
                first..min(end, rows).max(first)
            }
            Self::LayerNorm(n) => n.merge * step..n.merge * (step + 1),
            Self::Attention(_) => self.rows_after(out, step)..self.rows_after(out, step + 1),
            Self::Enlarge(_) => step.saturating_sub(1)..min(step + 2, rows),
        }
    }
}

/// `parts` one after the other, then zeros.
fn filled<const N: usize>(parts: &[&[u32]]) -> [u32; N] {
    let mut words = [0; N];
    let values = parts.iter().flat_map(|part| part.iter());
    words.iter_mut().zip(values).for_each(|(word, value)| *word = *value);
    words
}

impl Conv {
    /// The sources in order.
    pub fn sources(&self) -> impl Iterator<Item = u32> {
        core::iter::once(self.first).chain(self.second)
    }

    /// Output rows of a step; the last step may make fewer.
    #[inline]
    pub const fn step_rows(&self) -> usize {
        let block = at_least_one(self.block);
        if self.fold { 2 * block } else { block }
    }

    /// Sets of filters: one, or one per pair of phases and corrections.
    pub const fn variants(&self) -> usize {
        if self.fold { PHASES * PHASES } else { 1 }
    }

    /// Which of [`VARIANT_KINDS`] a set of filters is.
    pub(crate) const fn variant_kind(&self, variant: usize) -> usize {
        2 * (variant / PHASES > 1) as usize + (variant % PHASES > 1) as usize
    }

    /// Kernel rows and columns of a set of filters.
    #[inline]
    pub const fn extent(&self, variant: usize) -> (usize, usize) {
        if self.fold {
            (PHASE_TAPS[variant / PHASES % PHASES], PHASE_TAPS[variant % PHASES])
        } else {
            (self.kernel_rows, self.kernel_cols)
        }
    }
}

/// Four-byte groups of `samples` consecutive samples.
pub const fn groups(samples: usize) -> usize {
    samples.div_ceil(4)
}
