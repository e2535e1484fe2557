//! Validation of layer norms.

use super::work::Work;
use crate::nn::file::{LayerNorm, MAX_NORM_CHANNELS, OperatorFault};
use crate::nn::model::Model;
use crate::nn::tensor::Dtype;

/// Largest bias of a layer norm, before its shift.
const MAX_NORM_BIAS: i64 = 1 << 60;

impl Model<'_> {
    pub(super) fn check_layer_norm(&self, work: &Work, norm: &LayerNorm) -> Result<(), OperatorFault> {
        let (input, out) = (self.tensor(norm.input), self.tensor(norm.out));
        if !(1..=2).contains(&norm.merge) || norm.epsilon < 1 || norm.epsilon > 1 << 56 {
            return Err(OperatorFault::Parameter);
        }
        if input.dtype == Dtype::F32 || out.dtype == Dtype::F32 {
            return Err(OperatorFault::Type);
        }
        let m = norm.merge;
        let fits = (input.rows, input.cols, out.channels) == (out.rows * m, out.cols * m, input.channels * m * m);
        if !fits || out.channels > MAX_NORM_CHANNELS {
            return Err(OperatorFault::Shape);
        }
        self.check_multipliers(work, norm.gains, out.channels, norm.shift)?;
        let biases = self.constant_slice(work, norm.biases, out.channels, 8)?.as_chunks::<8>().0;
        if biases.iter().any(|&b| i64::from_le_bytes(b).unsigned_abs() > MAX_NORM_BIAS as u64) {
            return Err(OperatorFault::Overflow);
        }
        Ok(())
    }
}
