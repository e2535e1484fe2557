//! The convolutions of the extension.

use super::super::{conv, up2};
use super::step::{Operator, apply, track};
use super::{dims, numbers, tensor};
use crate::stopwatch::{Pass, TrainingPart, time};
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::Tensor;

/// A linear operator of a map and a weight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in super::super) enum Kind {
    /// A convolution.
    Conv {
        /// Stride of rows and columns.
        stride: usize,
        /// Number of zeros on every side.
        padding: usize,
    },
    /// Bilinear upsampling by two, then a 5x5 convolution with zeros around.
    Up2,
}

/// An operator with the sizes of its operands.
enum Sized {
    Conv(conv::ConvShape),
    Up2(up2::Up2Shape),
}

/// Extension of flex: an operator of `x` `[B, I, H, W]` and `weight` `[O, I, kh, kw]`.
#[backend_extension(Flex, Autodiff)]
pub(super) trait Convolutions: Backend {
    /// Applies the operator.
    fn convolve(x: FloatTensor<Self>, weight: FloatTensor<Self>, kind: Kind) -> FloatTensor<Self>;
}

/// Applies the operator to tensors that [`super::takes`] accepts.
pub(in super::super) fn run(x: Tensor<4>, weight: Tensor<4>, kind: Kind) -> Tensor<4> {
    Tensor::from_dispatch(<Dispatch as Convolutions>::convolve(x.into_dispatch(), weight.into_dispatch(), kind))
}

impl Kind {
    fn sized(self, x: &FloatTensor<Flex>, weight: &FloatTensor<Flex>) -> Sized {
        let ([images, inputs, rows, cols], [outputs, _, kh, kw]) = (dims(x), dims(weight));
        let channels = [inputs, outputs];
        let Self::Conv { stride, padding } = self else {
            return Sized::Up2(up2::Up2Shape { images, channels, small: [rows, cols] });
        };
        let output = |size: usize, kernel: usize| (size + 2 * padding - kernel) / stride + 1;
        Sized::Conv(conv::ConvShape {
            images,
            channels,
            input: [rows, cols],
            output: [output(rows, kh), output(cols, kw)],
            kernel: [kh, kw],
            stride,
            padding: [padding; 2],
        })
    }
}

impl Operator<2> for Kind {
    fn forward(&self, [x, weight]: &[FloatTensor<Flex>; 2]) -> FloatTensor<Flex> {
        let (images, outputs) = (dims::<4>(x)[0], dims::<4>(weight)[0]);
        let (map, kernel) = (numbers(x), numbers(weight));
        let (out, [rows, cols]) = match self.sized(x, weight) {
            Sized::Conv(shape) => {
                (time(TrainingPart::Convolution(Pass::Forward), || conv::forward(&shape, map, kernel)), shape.output)
            }
            Sized::Up2(shape) => {
                let out = time(TrainingPart::Upsampling(Pass::Forward), || up2::forward(&shape, map, kernel));
                (out, shape.small.map(|n| 2 * n))
            }
        };
        tensor(out, [images, outputs, rows, cols])
    }

    fn backward(
        &self,
        [x, weight]: &[FloatTensor<Flex>; 2],
        gradient: &FloatTensor<Flex>,
        wanted: [bool; 2],
    ) -> [Option<Vec<f32>>; 2] {
        let (map, kernel, slope) = (numbers(x), numbers(weight), numbers(gradient));
        match self.sized(x, weight) {
            Sized::Conv(shape) => {
                time(TrainingPart::Convolution(Pass::Backward), || conv::backward(&shape, map, kernel, slope, wanted))
            }
            Sized::Up2(shape) => {
                time(TrainingPart::Upsampling(Pass::Backward), || up2::backward(&shape, map, kernel, slope, wanted))
            }
        }
    }
}

impl Convolutions for Flex {
    fn convolve(x: FloatTensor<Self>, weight: FloatTensor<Self>, kind: Kind) -> FloatTensor<Self> {
        apply(&kind, [x, weight])
    }
}

impl<C: CheckpointStrategy> Convolutions for Autodiff<Flex, C> {
    fn convolve(x: FloatTensor<Self>, weight: FloatTensor<Self>, kind: Kind) -> FloatTensor<Self> {
        track::<C, 2>(kind, [x, weight])
    }
}
