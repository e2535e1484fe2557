//! The operators as an extension of Burn's flex backend. Their gradients are steps of its automatic differentiation.

pub(super) mod convolutions;
pub(super) mod norms;
mod step;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Flex, TensorMetadata, ops::FloatTensorOps};
use burn::tensor::{DType, Device, Tensor, TensorData};

/// Returns whether the extension supports these tensors: `f32` on flex.
pub(super) fn takes(tensors: &[&Tensor<4>]) -> bool {
    tensors.iter().all(|t| t.device() == Device::flex() && t.dtype() == DType::F32)
}

fn dims<const D: usize>(tensor: &FloatTensor<Flex>) -> [usize; D] {
    tensor.shape().dims()
}

fn numbers(tensor: &FloatTensor<Flex>) -> &[f32] {
    tensor.as_slice().expect("made contiguous, of f32")
}

fn tensor<const D: usize>(data: Vec<f32>, dims: [usize; D]) -> FloatTensor<Flex> {
    Flex::float_from_data(TensorData::new(data, dims), &Default::default())
}

/// Makes a tensor of the shape of another.
fn shaped(data: Vec<f32>, like: &FloatTensor<Flex>) -> FloatTensor<Flex> {
    Flex::float_from_data(TensorData::new(data, like.shape()), &Default::default())
}
