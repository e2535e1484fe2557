//! The operators, one file each. Every function does one unit of work (see [`super::Model::units`]) and returns how many
//! results had to be cut to their tensor's largest code (or, below a zero that is not the smallest code, to the smallest).

pub(crate) mod conv;
pub(crate) mod layer_norm;
pub(crate) mod window_attention;

use super::program::Tensor;

/// `v` as a code of `tensor`, and whether it had to be cut. Cutting at the zero point is a ReLU, not a fault.
#[inline(always)]
pub(crate) fn saturate(v: i64, tensor: &Tensor) -> (i32, bool) {
    let code = v.saturating_add(tensor.zero as i64);
    let kept = code.clamp(tensor.lo as i64, tensor.hi as i64);
    (kept as i32, kept < code || (kept > code && tensor.lo != tensor.zero))
}
