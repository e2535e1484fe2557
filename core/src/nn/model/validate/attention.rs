//! Validation of window attention.

use super::work::Work;
use crate::nn::file::{Attention, MAX_EXTENT, MAX_WINDOW, OperatorFault};
use crate::nn::model::Model;
use crate::nn::tensor::Dtype;
use crate::quant::lut::{EXP_COARSE, EXP_FINE};

impl Model<'_> {
    pub(super) fn check_attention(&self, work: &Work, a: &Attention) -> Result<(), OperatorFault> {
        let (input, out) = (self.tensor(a.input), self.tensor(a.out));
        let shifts = [a.shift_rows, a.shift_cols];
        if !(1..=MAX_WINDOW).contains(&a.window) || a.heads == 0 || shifts.iter().any(|s| *s >= a.window) {
            return Err(OperatorFault::Parameter);
        }
        // Codes begin at 1, because kernels read them as i8 weights, which are never -128.
        if input.dtype != Dtype::U8 || input.zero != 128 || input.lo < 1 || out.dtype == Dtype::F32 {
            return Err(OperatorFault::Type);
        }
        let fits = (input.rows, input.cols, input.channels) == (out.rows, out.cols, 3 * out.channels)
            && a.heads <= out.channels
            && out.channels.is_multiple_of(a.heads)
            && shifts[0] < out.rows
            && shifts[1] < out.cols;
        if !fits {
            return Err(OperatorFault::Shape);
        }
        let (tokens, head) = (a.window * a.window, out.channels / a.heads);
        self.check_multipliers(work, a.logit_multipliers, a.heads, a.logit_shift)?;
        self.check_multipliers(work, a.multipliers, a.heads, a.shift)?;
        self.constant_slice(work, a.position_bias, a.heads, 2 * (2 * a.window - 1) * (2 * a.window - 1))?;
        let exp = self.constant_slice(work, a.exp_table, EXP_COARSE + EXP_FINE, 2)?.as_chunks::<2>().0;
        // The maximum of every row reads the first entries: they keep the sum at 2^13 or above.
        let first = |i: usize| exp.get(i).is_some_and(|&e| i16::from_le_bytes(e) >= 1 << 14);
        if !first(0) || !first(EXP_COARSE) || exp.iter().any(|&e| i16::from_le_bytes(e) < 0) {
            return Err(OperatorFault::Constants);
        }
        if self.constant_slice(work, a.pad_codes, input.channels, 1)?.contains(&0) {
            return Err(OperatorFault::Constants);
        }
        if head > MAX_EXTENT / 2 || tokens as u64 * 127 * i16::MAX as u64 > i32::MAX as u64 {
            return Err(OperatorFault::Overflow);
        }
        Ok(())
    }
}
