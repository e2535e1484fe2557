//! An operator that is ready to run, and its cost.

use super::attention_layout::Layout;
use crate::nn::arena::OVERREAD;
use crate::nn::file::{Conv, Operator, Phase};
use crate::nn::panels::{panel, panel_count};
use crate::nn::tensor::Tensor;
use core::ops::Range;

/// A copy of an operator and its tensors outside the model's memory. A fault in the model's memory after the copy does not change where, or
/// how often, the operator reads and writes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Prepared {
    /// The operator.
    pub(crate) operator: Operator,
    /// The tensor that the operator writes.
    pub(crate) out: Tensor,
    /// The tensors that the operator reads, by slot ([`Operator::inputs`]).
    pub(crate) inputs: [Option<Tensor>; 3],
    /// Whether matrix products are compared with their checksums.
    pub(crate) checked: bool,
}

impl Prepared {
    /// Number of units of work in a step: panels of output channels, rows of pixels, or windows.
    #[inline]
    pub(crate) const fn units(&self) -> usize {
        match &self.operator {
            Operator::Conv(_) => panel_count(self.out.channels),
            Operator::LayerNorm(_) | Operator::Upsample2(_) => 1,
            Operator::Attention(a) => a.pieces(self.out.cols, a.shift_cols),
        }
    }

    /// Number of multiply-accumulates of one unit of one step, without filling. A layer norm counts four per sample, an upsampling eight.
    pub(crate) fn unit_macs(&self, step: usize, unit: usize) -> u64 {
        let out = &self.out;
        match &self.operator {
            Operator::Conv(conv) => {
                let (first, width) = panel(out.channels, unit);
                self.taps(conv, step) * out.channels.saturating_sub(first).min(width) as u64
            }
            Operator::LayerNorm(_) => 4 * (out.cols * out.channels) as u64,
            Operator::Upsample2(_) => 8 * (out.cols * out.channels) as u64,
            Operator::Attention(a) => {
                let (rows, cols) = (a.piece(out.rows, a.shift_rows, step), a.piece(out.cols, a.shift_cols, unit));
                let tokens = ((rows.1 - rows.0) * (cols.1 - cols.0)) as u64;
                2 * tokens * tokens * out.channels as u64
            }
        }
    }

    /// Work of one unit of one step, in multiply-accumulates, by what it takes on a processor without vectors: twice the products of samples
    /// of 16 bits and of an attention's exponentials; rounding a sum counts 16, a sample of a layer norm 40, of an upsampling 16.
    pub(crate) fn unit_work(&self, step: usize, unit: usize) -> u64 {
        let macs = self.unit_macs(step, unit);
        match &self.operator {
            Operator::Conv(conv) => {
                let of = |slot: usize| (self.input(slot).channels as u64, self.input(slot).dtype.bytes().min(2) as u64);
                let (first, second) = (of(0), conv.second.map_or((0, 0), |_| of(1)));
                let products = macs / (first.0 + second.0).max(1) * (first.0 * first.1 + second.0 * second.1);
                let (channel, width) = panel(self.out.channels, unit);
                let channels = self.out.channels.saturating_sub(channel).min(width);
                products + 16 * (self.step_rows(conv, step).len() * self.out.cols * channels) as u64
            }
            Operator::Attention(_) => macs / 2 * 3,
            Operator::LayerNorm(_) => macs * 10,
            Operator::Upsample2(_) => macs * 4,
        }
    }

    /// Number of multiply-accumulates of the whole operator.
    pub(crate) fn macs(&self) -> u64 {
        match &self.operator {
            Operator::Conv(conv) => {
                let all = Conv { block: self.out.rows, ..*conv };
                self.taps(&all, 0).saturating_mul(self.out.channels as u64)
            }
            Operator::Attention(a) => {
                let out = &self.out;
                let squares = a.squares(out.rows, a.shift_rows) * a.squares(out.cols, a.shift_cols);
                squares.saturating_mul(2 * out.channels as u64)
            }
            _ => self.unit_macs(0, 0).saturating_mul(self.steps() as u64),
        }
    }

    /// Returns a bound of the work of a unit: that of the largest one, with all bytes that a step compares and sums.
    pub(crate) fn largest_unit(&self) -> u64 {
        // A unit's cost is the product of a factor of its step and a factor of its number. Only steps and units at the two ends differ
        // from the others.
        let ends = |count: usize| (0..count.min(3)).chain(count.saturating_sub(2)..count);
        let units = |step: usize| ends(self.units()).map(move |unit| self.unit_work(step, unit));
        let work = ends(self.steps()).flat_map(units).max().unwrap_or(0);
        let read = |(slot, t): (usize, &Option<Tensor>)| {
            t.map_or(0, |t| (self.operator.most_rows_read(slot, t.rows) * t.row_bytes()) as u64)
        };
        let read: u64 = self.inputs.iter().enumerate().map(read).sum();
        work + read + (self.operator.most_rows_written(&self.out) * self.out.row_bytes()) as u64
    }

    /// Number of bytes of scratch memory that the operator needs.
    pub(crate) fn scratch_bytes(&self) -> usize {
        match &self.operator {
            // A row of zero codes for the padding, as long as the part of a row that the kernel reads.
            Operator::Conv(conv) if conv.pad > 0 && !conv.fold => {
                let line = |t: &Tensor| t.plane_bytes() + conv.kernel_cols * t.channels + OVERREAD;
                self.inputs.iter().take(2).flatten().map(line).max().unwrap_or(0)
            }
            Operator::Attention(a) => Layout::new(a.window * a.window, self.out.channels / a.heads.max(1)).bytes(),
            _ => 0,
        }
    }

    /// Number of products per output channel in one step.
    fn taps(&self, conv: &Conv, step: usize) -> u64 {
        let out = &self.out;
        let channels = self.input(0).channels + conv.second.map_or(0, |_| self.input(1).channels);
        let rows = self.step_rows(conv, step);
        let taps = if conv.fold {
            // Four samples along each axis, and one more for the two outermost outputs on each side.
            let corrected = Phase::corrected(&rows, out.rows / 2);
            (4 * rows.len() + corrected) as u64 * (4 * out.cols + 4) as u64
        } else {
            (conv.kernel_rows * conv.kernel_cols) as u64 * (out.cols * rows.len()) as u64
        };
        taps * channels as u64
    }

    /// The rows that a step makes.
    fn step_rows(&self, conv: &Conv, step: usize) -> Range<usize> {
        let first = (conv.step_rows() * step).min(self.out.rows);
        first..(first + conv.step_rows()).min(self.out.rows)
    }

    /// Number of steps for the whole output.
    pub(crate) const fn steps(&self) -> usize {
        self.operator.steps(&self.out)
    }

    /// Returns input `slot`; for an input that the operator does not have, a single byte at the start of the arena.
    #[inline]
    pub(crate) fn input(&self, slot: usize) -> Tensor {
        self.inputs.get(slot).copied().flatten().unwrap_or(Tensor::SINGLE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::file::{Attention, Dtype, LayerNorm};

    fn prepared(operator: Operator, out: Tensor, channels: usize) -> Prepared {
        let input = Tensor::new(Dtype::U8, (out.rows, out.cols), channels);
        Prepared { operator, out, inputs: [Some(input), None, None], checked: false }
    }

    /// Multiply-accumulates and work of all units.
    fn of_all_units(prepared: &Prepared) -> (u64, u64) {
        let all = || (0..prepared.steps()).flat_map(|step| (0..prepared.units()).map(move |unit| (step, unit)));
        let sum = |of: &dyn Fn(usize, usize) -> u64| all().map(|(step, unit)| of(step, unit)).sum();
        (sum(&|step, unit| prepared.unit_macs(step, unit)), sum(&|step, unit| prepared.unit_work(step, unit)))
    }

    #[test]
    fn units_cost_what_they_multiply_and_round() {
        let map = |channels| Tensor::new(Dtype::U8, (7, 10), channels);
        let conv = Conv { kernel_rows: 3, kernel_cols: 5, pad: 1, block: 2, ..Conv::default() };
        let macs = 7 * 10 * 15 * 3 * 40;
        assert_eq!(of_all_units(&prepared(Operator::Conv(conv), map(40), 3)), (macs, macs + 16 * 7 * 10 * 40));
        let norm = LayerNorm { merge: 1, ..LayerNorm::default() };
        assert_eq!(of_all_units(&prepared(Operator::LayerNorm(norm), map(6), 6)), (4 * 7 * 10 * 6, 40 * 7 * 10 * 6));
        // A row is read and a row is written.
        assert_eq!(prepared(Operator::LayerNorm(norm), map(6), 6).largest_unit(), 40 * 10 * 6 + 60 + 60);
        // Windows of 4 x 4, 4 x 4 and 4 x 4 pixels, filled up, in two rows: each token with each one, twice.
        let attention = Attention { heads: 1, window: 4, ..Attention::default() };
        let macs = 2 * 3 * (2 * 16 * 16 * 6);
        assert_eq!(of_all_units(&prepared(Operator::Attention(attention), map(6), 18)), (macs, macs / 2 * 3));
        // Cut after a row and three columns: pieces of 1, 4 and 3 rows, and of 3, 4 and 4 columns with what is filled up, or 1 of 12.
        let attention = Attention { shift_rows: 1, shift_cols: 3, ..attention };
        let cut = prepared(Operator::Attention(attention), map(6), 18);
        assert_eq!(of_all_units(&cut).0, 2 * (1 + 16 + 9) * (9 + 16 + 16) * 6);
        assert_eq!(cut.macs(), of_all_units(&cut).0);
    }

    #[test]
    fn a_folded_upsampling_costs_four_samples_along_each_axis_and_its_corrections() {
        let out = Tensor::new(Dtype::U8, (8, 6), 5);
        let conv = Conv { fold: true, kernel_rows: 5, kernel_cols: 5, pad: 2, block: 1, ..Conv::default() };
        let folded = prepared(Operator::Conv(conv), out, 3);
        assert_eq!((folded.steps(), folded.units()), (4, 1));
        let macs = (4 * 8 + 4) * (4 * 6 + 4) * 3 * 5;
        assert_eq!(of_all_units(&folded), (macs, macs + 16 * 8 * 6 * 5));
        assert_eq!(folded.macs(), macs);
        // The two outermost rows on each side have corrections.
        let steps: Vec<u64> = (0..4).map(|step| folded.unit_macs(step, 0)).collect();
        assert_eq!(steps, [10, 8, 8, 10].map(|rows| rows * 28 * 3 * 5));
    }
}
