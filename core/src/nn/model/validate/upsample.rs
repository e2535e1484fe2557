//! Validation of upsamplings.

use crate::nn::file::{OperatorFault, Upsample2};
use crate::nn::model::Model;
use crate::nn::tensor::Dtype;

impl Model<'_> {
    pub(super) fn check_upsample(&self, op: &Upsample2) -> Result<(), OperatorFault> {
        let (input, out) = (self.tensor(op.input), self.tensor(op.out));
        if input.dtype == Dtype::F32 || input.dtype != out.dtype {
            return Err(OperatorFault::Type);
        }
        let fits = (out.rows, out.cols, out.channels) == (2 * input.rows, 2 * input.cols, input.channels)
            && (out.zero, out.lo, out.hi) == (input.zero, input.lo, input.hi);
        if fits { Ok(()) } else { Err(OperatorFault::Shape) }
    }
}
