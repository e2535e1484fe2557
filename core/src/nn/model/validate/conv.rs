//! Validation of convolutions: parameters, shapes, requantisation.

use super::work::Work;
use crate::nn::file::{Conv, MAX_ADD_SHIFT, MAX_BLOCK, MAX_EXTENT, MAX_KERNEL, OperatorFault};
use crate::nn::model::Model;
use crate::nn::tensor::{Dtype, Edge, Tensor};
use crate::quant::lut::CODE_TABLE_LEN;

impl Model<'_> {
    pub(super) fn check_conv(&self, work: &Work, conv: &Conv) -> Result<(), OperatorFault> {
        let out = self.tensor(conv.out);
        let sides = [conv.kernel_rows, conv.kernel_cols];
        let legal = sides.iter().all(|k| (1..=MAX_KERNEL).contains(k) && conv.pad < *k)
            && [conv.stride, conv.stride_cols].iter().all(|s| (1..=MAX_KERNEL).contains(s))
            && (1..=MAX_BLOCK).contains(&conv.block)
            && conv.add_shift <= MAX_ADD_SHIFT
            && (!conv.fold || (sides == [5, 5] && (conv.stride, conv.stride_cols) == (1, 1) && conv.pad == 2));
        if !legal {
            return Err(OperatorFault::Parameter);
        }
        if conv.sources().any(|s| self.tensor(s).dtype == Dtype::F32) {
            return Err(OperatorFault::Type);
        }
        let first = self.tensor(conv.first);
        let channels: usize = conv.sources().map(|s| self.tensor(s).channels).sum();
        let extent = |len: usize, kernel: usize, stride: usize| match conv.fold {
            true => (len >= 4).then_some(2 * len),
            false => (len + 2 * conv.pad).checked_sub(kernel).map(|n| n / stride + 1),
        };
        let fits = conv.sources().all(|s| {
            let t = self.tensor(s);
            let margin = if conv.fold { (2, Edge::Nearest) } else { (conv.pad, Edge::Zero) };
            (t.rows, t.cols) == (first.rows, first.cols)
                && (margin.0 == 0 || (t.margin >= margin.0 && t.edge == margin.1))
        }) && extent(first.rows, conv.kernel_rows, conv.stride) == Some(out.rows)
            && extent(first.cols, conv.kernel_cols, conv.stride_cols) == Some(out.cols)
            && channels <= MAX_EXTENT;
        if !fits {
            return Err(OperatorFault::Shape);
        }
        self.check_conv_finish(work, conv, &out)
    }

    /// Validates requantisation, addition and table of a convolution.
    fn check_conv_finish(&self, work: &Work, conv: &Conv, out: &Tensor) -> Result<(), OperatorFault> {
        let float = out.dtype == Dtype::F32;
        if let Some(add) = conv.add {
            let add = self.tensor(add);
            // The channels of a pixel of the output may be several columns.
            let row = |t: &Tensor| (t.rows, t.cols * t.channels);
            let alike = row(&add) == row(out) && (float || add.channels == out.channels);
            if !alike {
                return Err(OperatorFault::Shape);
            }
            if add.dtype == Dtype::F32 {
                return Err(OperatorFault::Type);
            }
        }
        if float {
            let scales = self.constant_slice(work, conv.multipliers, out.channels, 4)?.as_chunks::<4>().0;
            let legal = scales.iter().all(|&b| f32::from_le_bytes(b).is_finite());
            let plain = conv.table.is_none() && conv.shift == 0;
            return if legal && plain { Ok(()) } else { Err(OperatorFault::Constants) };
        }
        if conv.relu {
            return Err(OperatorFault::Parameter);
        }
        self.check_multipliers(work, conv.multipliers, out.channels, conv.shift)?;
        if conv.add.is_some() {
            self.check_multipliers(work, conv.add_multipliers, out.channels, conv.shift)?;
        }
        if let Some(table) = conv.table {
            let codes = self.constant_slice(work, table, CODE_TABLE_LEN, 1)?;
            if out.dtype != Dtype::U8 || !(0..=255).contains(&conv.table_zero) {
                return Err(OperatorFault::Type);
            }
            if !codes.iter().all(|&code| (out.lo..=out.hi).contains(&(code as i32))) {
                return Err(OperatorFault::Constants);
            }
        }
        Ok(())
    }
}
