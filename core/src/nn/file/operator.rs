//! The record of an operator, for the file and for the runner.
//!
//! Four operators are enough for the whole network and its ablations. The convolution reads two tensors side by side (so concatenation
//! needs no copy), adds another tensor, clamps and maps through a table; it can contain the bilinear upsampling before it. The others are
//! the upsampling alone, a layer norm that can gather 2x2 neighbours (patch merging), and window attention. `ops/` says what their steps
//! read, write and cost.

use super::bytes::{i64_at, u32_at};
use super::error::OperatorFault;
use super::layout::NONE;
use super::seal::{seal_record, sealed};
use super::{Attention, Conv, LayerNorm, Upsample2};

/// Bytes of an operator record.
pub const OPERATOR_BYTES: usize = 96;
const KIND_CONV: u32 = 1;
const KIND_LAYER_NORM: u32 = 2;
const KIND_ATTENTION: u32 = 3;
const KIND_UPSAMPLE: u32 = 4;

/// One operator of the program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Operator {
    /// Convolution, or a linear layer as 1x1.
    Conv(Conv),
    /// Layer norm or patch merging.
    LayerNorm(LayerNorm),
    /// Window attention.
    Attention(Attention),
    /// Bilinear upsampling.
    Upsample2(Upsample2),
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
            KIND_UPSAMPLE => Self::Upsample2(Upsample2 { out: word(1), input: word(2) }),
            _ => return Err(OperatorFault::Kind),
        })
    }

    /// Returns the record's bytes.
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
            Self::Upsample2(e) => filled(&[&[KIND_UPSAMPLE, e.out, e.input]]),
        };
        words.iter_mut().zip(fields).for_each(|(word, field)| *word = field);
        let mut record = [0; OPERATOR_BYTES];
        record.as_chunks_mut::<4>().0.iter_mut().zip(words).for_each(|(bytes, word)| *bytes = word.to_le_bytes());
        seal_record(&mut record);
        record
    }

    /// Returns the number of the tensor that the operator writes.
    pub const fn output(&self) -> u32 {
        match self {
            Self::Conv(c) => c.out,
            Self::LayerNorm(n) => n.out,
            Self::Attention(a) => a.out,
            Self::Upsample2(e) => e.out,
        }
    }

    /// Returns the numbers of the tensors that the operator reads, the added one last.
    pub fn inputs(&self) -> [Option<u32>; 3] {
        match self {
            Self::Conv(c) => [Some(c.first), c.second, c.add],
            Self::LayerNorm(n) => [Some(n.input), None, None],
            Self::Attention(a) => [Some(a.input), None, None],
            Self::Upsample2(e) => [Some(e.input), None, None],
        }
    }

    /// Returns the operator's name in reports, one word.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Conv(c) if c.fold => "up-conv",
            Self::Conv(_) => "conv",
            Self::LayerNorm(n) if n.merge == 2 => "merge-norm",
            Self::LayerNorm(_) => "layer-norm",
            Self::Attention(_) => "attention",
            Self::Upsample2(_) => "upsampling",
        }
    }
}

/// Returns `parts` one after the other, then zeros.
fn filled<const N: usize>(parts: &[&[u32]]) -> [u32; N] {
    let mut words = [0; N];
    let values = parts.iter().flat_map(|part| part.iter());
    words.iter_mut().zip(values).for_each(|(word, value)| *word = *value);
    words
}
