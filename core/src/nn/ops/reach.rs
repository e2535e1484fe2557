//! The rows that the steps of an operator read and write.

use crate::nn::file::count::{at_least_one, min};
use crate::nn::file::{MAX_KERNEL, Operator};
use crate::nn::tensor::Tensor;
use core::ops::Range;

impl Operator {
    /// Number of steps of this operator for all of `out`. A step is one output row or a block of rows; two rows for an upsampling; twice a
    /// block for a convolution that contains an upsampling; a row of windows for an attention.
    #[inline]
    pub const fn steps(&self, out: &Tensor) -> usize {
        match self {
            Self::Upsample2(_) => out.rows / 2,
            Self::Conv(c) => out.rows.div_ceil(at_least_one(c.step_rows())),
            Self::LayerNorm(_) => out.rows,
            Self::Attention(a) => a.pieces(out.rows, a.shift_rows),
        }
    }

    /// Number of rows of `out` that exist after the first `steps` steps.
    #[inline]
    pub const fn rows_after(&self, out: &Tensor, steps: usize) -> usize {
        match self {
            Self::Upsample2(_) => 2 * steps,
            Self::Conv(c) => min(c.step_rows() * steps, out.rows),
            Self::LayerNorm(_) => steps,
            Self::Attention(_) if steps == 0 => 0,
            Self::Attention(a) => min(a.piece(out.rows, a.shift_rows, steps - 1).1, out.rows),
        }
    }

    /// Returns the rows of input `slot` (see [`Self::inputs`], of `rows` rows) that step `step` reads; an empty range if it reads padding
    /// only.
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
            Self::Upsample2(_) => step.saturating_sub(1)..min(step + 2, rows),
        }
    }

    /// Returns steps among `steps` of which one has the largest difference between the rows written (before or after it) and the first row
    /// it reads. That difference grows while the kernel reaches above the map, which ends within the first `MAX_KERNEL` steps; then it
    /// changes in one direction only, until the last step, which may write fewer rows.
    pub(crate) fn deciding_steps(&self, steps: &Range<usize>) -> impl Iterator<Item = usize> {
        let head = steps.end.min(steps.start.saturating_add(MAX_KERNEL + 1));
        (steps.start..head).chain(steps.end.saturating_sub(2).max(head)..steps.end)
    }

    /// Returns a number of rows of input `slot` (of `rows` rows) that no step exceeds in what it reads.
    pub(crate) fn most_rows_read(&self, slot: usize, rows: usize) -> usize {
        let most = match self {
            Self::Conv(c) if slot == 2 => c.step_rows(),
            Self::Conv(c) if c.fold => c.step_rows() / 2 + 4,
            Self::Conv(c) => (c.step_rows().saturating_sub(1)) * c.stride + c.kernel_rows,
            Self::LayerNorm(n) => n.merge,
            Self::Attention(a) => a.window,
            Self::Upsample2(_) => 3,
        };
        min(most, rows)
    }

    /// Returns a number of rows that no step exceeds in what it writes.
    pub(crate) fn most_rows_written(&self, out: &Tensor) -> usize {
        let most = match self {
            Self::Conv(c) => c.step_rows(),
            Self::LayerNorm(_) => 1,
            Self::Attention(a) => a.window,
            Self::Upsample2(_) => 2,
        };
        min(most, out.rows)
    }
}
