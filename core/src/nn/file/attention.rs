//! The record of window attention.

use super::count::{at_least_one, min};

/// Attention inside shifted windows (Swin): softmax(q·k/√d + relative position bias) · v.
///
/// The cyclic shift of the paper brings pixels together that are not neighbours, and then masks them. Cutting the map at `shift`,
/// `shift + window`, ... into windows, of which the outer ones are smaller, gives the same result. The input holds q, k, v side by side,
/// each `heads * head channels`, u8 with zero 128. The map is extended to whole windows at the right and bottom. In the extension q, k and
/// v are `pad_codes` (the bias of the projection, because the padding is zero after the norm), and count like others.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Attention {
    /// Output tensor, `[rows, cols, heads * head channels]`.
    pub out: u32,
    /// Input tensor.
    pub input: u32,
    /// Heads.
    pub heads: usize,
    /// Window side.
    pub window: usize,
    /// Row of the first cut; below `window`.
    pub shift_rows: usize,
    /// Column of the first cut; below `window`.
    pub shift_cols: usize,
    /// Constants: u8 `[input channels]`, codes of the extension.
    pub pad_codes: usize,
    /// Constants: i32 `[heads]`, from q·k to logit.
    pub logit_multipliers: usize,
    /// Right shift of the logits.
    pub logit_shift: u32,
    /// Constants: i16 `[heads][(2 window - 1)²]`, in logits, by key row minus query row and key column minus query column.
    pub position_bias: usize,
    /// Constants: the two tables of the exponential, i16, one after the other (see [`crate::quant::lut::exp_lookup`]).
    pub exp_table: usize,
    /// Constants: i32 `[heads]`, from the mean of v to output code.
    pub multipliers: usize,
    /// Right shift of the output.
    pub shift: u32,
}

impl Attention {
    /// Returns start and end of piece `index` of an axis of `len` pixels that is extended to whole windows and cut at `shift`.
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

    /// Returns the sum of the squares of the lengths of all pieces of an axis. All pieces but the first and the last are whole windows.
    pub(crate) fn squares(&self, len: usize, shift: usize) -> u64 {
        let count = self.pieces(len, shift);
        let square = |index: usize| {
            let (start, end) = self.piece(len, shift, index);
            ((end - start) as u64).pow(2)
        };
        match count {
            0 => 0,
            1 => square(0),
            _ => square(0) + (count as u64 - 2) * (self.window as u64).pow(2) + square(count - 1),
        }
    }
}
