//! The program: records of tensors and operators, as the file holds them and as the runner uses them.
//!
//! A program is a list of operators over tensors at fixed arena offsets. Three operators carry the whole network and its
//! ablations: a convolution that reads several tensors side by side (so concatenation costs nothing), enlarges them on the fly
//! (so no enlarged tensor exists), adds another tensor, clamps and maps through a table; a layer norm that can gather 2x2
//! neighbours (patch merging); and window attention.

use super::error::OperatorFault;
use super::format::{NONE, i64_at, u32_at};
use super::kernels::padded;

/// Bytes of a tensor record.
pub const TENSOR_BYTES: usize = 40;
/// Bytes of an operator record.
pub const OPERATOR_BYTES: usize = 96;
const KIND_CONV: u32 = 1;
const KIND_LAYER_NORM: u32 = 2;
const KIND_ATTENTION: u32 = 3;

/// Largest left shift of an added tensor: i16 times `2^30` times `2^15` stays below `2^60`.
pub const MAX_ADD_SHIFT: u32 = 15;

/// Sample type of a tensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dtype {
    /// One byte; value = code - zero.
    U8,
    /// Two bytes, little-endian; value = code - zero.
    I16,
    /// IEEE 754 single, little-endian: the coarse DTM of a residual head, and the result.
    F32,
}

impl Dtype {
    /// Bytes per sample.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::I16 => 2,
            Self::F32 => 4,
        }
    }

    /// The type's number in the file.
    pub const fn number(self) -> u32 {
        match self {
            Self::U8 => 0,
            Self::I16 => 1,
            Self::F32 => 2,
        }
    }

    const fn from_number(number: u32) -> Option<Self> {
        match number {
            0 => Some(Self::U8),
            1 => Some(Self::I16),
            2 => Some(Self::F32),
            _ => None,
        }
    }
}

/// A tensor `[rows, cols, channels]`, dense, in the arena.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tensor {
    /// Sample type.
    pub dtype: Dtype,
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Channels.
    pub channels: usize,
    /// First byte in the arena.
    pub offset: usize,
    /// The code that stands for 0.
    pub zero: i32,
    /// Smallest code its writer may store.
    pub lo: i32,
    /// Largest code its writer may store.
    pub hi: i32,
    /// Real value of one code step; the runner uses it for its inputs only (other tensors may have a scale per channel).
    pub scale: f32,
}

impl Tensor {
    /// One u8.
    pub(crate) const SINGLE: Self =
        Self { dtype: Dtype::U8, rows: 1, cols: 1, channels: 1, offset: 0, zero: 0, lo: 0, hi: 0, scale: 1.0 };

    /// Reads a record; `None` if a field is outside its type's range.
    pub fn decode(record: &[u8]) -> Option<Self> {
        let word = |i: usize| u32_at(record, 4 * i);
        let tensor = Self {
            dtype: Dtype::from_number(word(0))?,
            rows: word(1) as usize,
            cols: word(2) as usize,
            channels: word(3) as usize,
            offset: word(4) as usize,
            zero: word(5) as i32,
            lo: word(6) as i32,
            hi: word(7) as i32,
            scale: f32::from_bits(word(8)),
        };
        let (low, high) = match tensor.dtype {
            Dtype::U8 => (0, 255),
            Dtype::I16 => (-32767, 32767),
            Dtype::F32 => (0, 0),
        };
        let codes = [tensor.lo, tensor.zero, tensor.hi];
        let legal = codes.iter().all(|c| (low..=high).contains(c))
            && tensor.lo <= tensor.hi
            && tensor.magnitude() <= i16::MAX as i32;
        (legal && word(9) == 0 && tensor.scale.is_finite() && tensor.scale > 0.0).then_some(tensor)
    }

    /// The record's bytes.
    pub fn encode(&self) -> [u8; TENSOR_BYTES] {
        let words = [
            self.dtype.number(),
            self.rows as u32,
            self.cols as u32,
            self.channels as u32,
            self.offset as u32,
            self.zero as u32,
            self.lo as u32,
            self.hi as u32,
            self.scale.to_bits(),
            0,
        ];
        let mut record = [0; TENSOR_BYTES];
        record.as_chunks_mut::<4>().0.iter_mut().zip(words).for_each(|(bytes, word)| *bytes = word.to_le_bytes());
        record
    }

    /// Samples.
    pub const fn len(&self) -> usize {
        self.rows * self.cols * self.channels
    }

    /// Whether it has no samples (never in a validated model).
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes.
    pub const fn size_bytes(&self) -> usize {
        self.len() * self.dtype.bytes()
    }

    /// Bytes of one row.
    pub const fn row_bytes(&self) -> usize {
        self.cols * self.channels * self.dtype.bytes()
    }

    /// Largest absolute value, in code steps from zero.
    pub fn magnitude(&self) -> i32 {
        (self.hi - self.zero).abs().max((self.lo - self.zero).abs())
    }

    /// Whether two tensors share arena bytes.
    pub const fn overlaps(&self, other: &Self) -> bool {
        self.offset < other.offset + other.size_bytes() && other.offset < self.offset + self.size_bytes()
    }

    /// Whether two tensors are the very same bytes read in the same way.
    pub fn coincides(&self, other: &Self) -> bool {
        (self.offset, self.dtype, self.rows, self.cols, self.channels)
            == (other.offset, other.dtype, other.rows, other.cols, other.channels)
    }
}

/// One tensor that a convolution reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Source {
    /// Which tensor.
    pub tensor: u32,
    /// Enlarge it twofold by bilinear interpolation (half-pixel centres, replicated border) while reading. In units of a
    /// sixteenth of a code step that is exact in integers.
    pub up: bool,
    /// With `up`: how many of the four fraction bits are rounded away (0 keeps all).
    pub shift: u32,
}

/// Convolution over the sources' channels side by side, zero-padded, then requantised.
///
/// `code = clamp(zero + (acc*M[o] + (r*A[o] << add_shift) + half) >> shift)` with `acc = bias[o] + Σ x*w`, `r` the added tensor; or through a
/// table; or, if the output is F32, `acc * m[o] + r` in floats.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conv {
    /// Output tensor.
    pub out: u32,
    /// First source.
    pub first: Source,
    /// Second source; its channels follow the first's.
    pub second: Option<Source>,
    /// Kernel rows.
    pub kernel_rows: usize,
    /// Kernel columns.
    pub kernel_cols: usize,
    /// Stride, both axes.
    pub stride: usize,
    /// Zero padding on all four sides.
    pub pad: usize,
    /// Constants: i8 `[out][kernel row][padded(kernel_cols * channels)]`, the padding 0.
    pub weights: usize,
    /// Constants: i32 `[out]`.
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

/// Attention inside shifted windows (Swin): softmax(q·k/√d + relative position bias, masked) · v.
///
/// The input holds q, k, v side by side, each `heads * head channels`. Windows at the right and bottom reach beyond the tensor;
/// there q, k and v are `pad_codes` (the projection's bias, as the padding is zero behind the norm), and count like others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attention {
    /// Output tensor, `[rows, cols, heads * head channels]`.
    pub out: u32,
    /// Input tensor.
    pub input: u32,
    /// Heads.
    pub heads: usize,
    /// Window side, pixels.
    pub window: usize,
    /// Cyclic shift in rows.
    pub shift_rows: usize,
    /// Cyclic shift in columns.
    pub shift_cols: usize,
    /// Constants: i16 `[input channels]`, values (zero point removed) outside the tensor.
    pub pad_codes: usize,
    /// Constants: i32 `[heads]`, q·k to logits.
    pub logit_multipliers: usize,
    /// Right shift to logits.
    pub logit_shift: u32,
    /// Constants: i16 `[heads][(2w-1)²]` logits.
    pub position_bias: usize,
    /// Constants: i16 `[exp_len]`, `exp` by distance from the maximum.
    pub exp_table: usize,
    /// Entries of the table.
    pub exp_len: usize,
    /// Constants: i32 `[heads]`, weighted mean of v (16 fraction bits) to codes.
    pub multipliers: usize,
    /// Right shift to codes.
    pub shift: u32,
}

/// One operator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Operator {
    /// Convolution, linear layer, head.
    Conv(Conv),
    /// Layer norm, patch merging.
    LayerNorm(LayerNorm),
    /// Window attention.
    Attention(Attention),
}

fn option(word: u32) -> Option<u32> {
    (word != NONE).then_some(word)
}

impl Operator {
    /// Reads a record; judges nothing but the kind, flags and unused words.
    pub(crate) fn decode(record: &[u8]) -> Result<Self, OperatorFault> {
        let word = |i: usize| u32_at(record, 4 * i);
        let size = |i: usize| word(i) as usize;
        let flag = |i: usize| if word(i) <= 1 { Ok(word(i) == 1) } else { Err(OperatorFault::Parameter) };
        let used;
        let operator = match word(0) {
            KIND_CONV => {
                used = 22;
                let source = |i| Ok(Source { tensor: word(i), up: flag(i + 1)?, shift: word(i + 2) });
                Self::Conv(Conv {
                    out: word(1),
                    first: source(2)?,
                    second: if word(5) == NONE { None } else { Some(source(5)?) },
                    kernel_rows: size(8),
                    kernel_cols: size(9),
                    stride: size(10),
                    pad: size(11),
                    weights: size(12),
                    bias: size(13),
                    multipliers: size(14),
                    shift: word(15),
                    add: option(word(16)),
                    add_multipliers: size(17),
                    table: option(word(18)).map(|offset| offset as usize),
                    table_zero: word(19) as i32,
                    relu: flag(20)?,
                    add_shift: word(21),
                })
            }
            KIND_LAYER_NORM => {
                used = 9;
                Self::LayerNorm(LayerNorm {
                    out: word(1),
                    input: word(2),
                    merge: size(3),
                    gains: size(4),
                    biases: size(5),
                    shift: word(6),
                    epsilon: i64_at(record, 28),
                })
            }
            KIND_ATTENTION => {
                used = 15;
                Self::Attention(Attention {
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
                    exp_len: size(12),
                    multipliers: size(13),
                    shift: word(14),
                })
            }
            _ => return Err(OperatorFault::Parameter),
        };
        let unused = (used..OPERATOR_BYTES / 4).all(|i| word(i) == 0);
        if unused { Ok(operator) } else { Err(OperatorFault::Parameter) }
    }

    /// The record's bytes.
    pub fn encode(&self) -> [u8; OPERATOR_BYTES] {
        let mut words = [0u32; OPERATOR_BYTES / 4];
        let mut put = |start: usize, values: &[u32]| words[start..start + values.len()].copy_from_slice(values);
        match self {
            Self::Conv(c) => {
                let source = |s: &Source| [s.tensor, s.up as u32, s.shift];
                put(0, &[KIND_CONV, c.out]);
                put(2, &source(&c.first));
                put(5, &c.second.as_ref().map_or([NONE, 0, 0], source));
                put(8, &[c.kernel_rows, c.kernel_cols, c.stride, c.pad].map(|v| v as u32));
                put(12, &[c.weights, c.bias, c.multipliers].map(|v| v as u32));
                put(15, &[c.shift, c.add.unwrap_or(NONE), c.add_multipliers as u32]);
                put(18, &[c.table.map_or(NONE, |t| t as u32), c.table_zero as u32, c.relu as u32, c.add_shift]);
            }
            Self::LayerNorm(n) => {
                put(0, &[KIND_LAYER_NORM, n.out, n.input, n.merge as u32, n.gains as u32, n.biases as u32, n.shift]);
                put(7, &[n.epsilon as u64 as u32, (n.epsilon as u64 >> 32) as u32]);
            }
            Self::Attention(a) => {
                put(0, &[KIND_ATTENTION, a.out, a.input]);
                put(3, &[a.heads, a.window, a.shift_rows, a.shift_cols, a.pad_codes].map(|v| v as u32));
                put(8, &[a.logit_multipliers as u32, a.logit_shift, a.position_bias as u32, a.exp_table as u32]);
                put(12, &[a.exp_len as u32, a.multipliers as u32, a.shift]);
            }
        }
        let mut record = [0; OPERATOR_BYTES];
        record.as_chunks_mut::<4>().0.iter_mut().zip(words).for_each(|(bytes, word)| *bytes = word.to_le_bytes());
        record
    }

    /// The tensor it writes.
    pub const fn output(&self) -> u32 {
        match self {
            Self::Conv(c) => c.out,
            Self::LayerNorm(n) => n.out,
            Self::Attention(a) => a.out,
        }
    }

    /// The tensors it reads, the added one last.
    pub fn inputs(&self) -> [Option<u32>; 3] {
        match self {
            Self::Conv(c) => [Some(c.first.tensor), c.second.map(|s| s.tensor), c.add],
            Self::LayerNorm(n) => [Some(n.input), None, None],
            Self::Attention(a) => [Some(a.input), None, None],
        }
    }

    /// One word for reports.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Conv(_) => "conv",
            Self::LayerNorm(n) if n.merge == 2 => "merge-norm",
            Self::LayerNorm(_) => "layer-norm",
            Self::Attention(_) => "attention",
        }
    }
}

impl Conv {
    /// The sources in order.
    pub fn sources(&self) -> impl Iterator<Item = Source> {
        core::iter::once(self.first).chain(self.second)
    }

    /// i8 weights per output channel and kernel row, padding included.
    pub const fn segment(&self, channels_in: usize) -> usize {
        padded(self.kernel_cols * channels_in)
    }
}
