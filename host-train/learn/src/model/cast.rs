//! Casts between the types of mixed precision ([`super::precision`]).

use burn::tensor::{DType, Tensor};

/// Casts `x` to another type; returns `x` itself if it has the type already.
pub fn cast<const D: usize>(x: Tensor<D>, dtype: DType) -> Tensor<D> {
    if x.dtype() == dtype { x } else { x.cast(dtype) }
}

/// Applies `work` to `x` in `f32`. The result has the type of `x`.
pub fn in_f32<const D: usize>(x: Tensor<D>, work: impl FnOnce(Tensor<D>) -> Tensor<D>) -> Tensor<D> {
    let dtype = x.dtype();
    cast(work(cast(x, DType::F32)), dtype)
}
