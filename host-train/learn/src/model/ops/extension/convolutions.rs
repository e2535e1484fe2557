//! The convolutions of the extension.

use super::super::{conv, up2};
use super::{dims, numbers, tensor};
use crate::stopwatch::{Part, Pass, time};
use burn::backend::autodiff::NodeId;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
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
    Conv(conv::Shape),
    Up2(up2::Shape),
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
            return Sized::Up2(up2::Shape { images, channels, small: [rows, cols] });
        };
        let output = |size: usize, kernel: usize| (size + 2 * padding - kernel) / stride + 1;
        Sized::Conv(conv::Shape {
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

impl Convolutions for Flex {
    fn convolve(x: FloatTensor<Self>, weight: FloatTensor<Self>, kind: Kind) -> FloatTensor<Self> {
        let (x, weight) = (x.to_contiguous(), weight.to_contiguous());
        let (images, outputs) = (dims::<4>(&x)[0], dims::<4>(&weight)[0]);
        let (map, kernel) = (numbers(&x), numbers(&weight));
        let (out, [rows, cols]) = match kind.sized(&x, &weight) {
            Sized::Conv(shape) => {
                (time(Part::Convolution(Pass::Forward), || conv::forward(&shape, map, kernel)), shape.output)
            }
            Sized::Up2(shape) => {
                let out = time(Part::Upsampling(Pass::Forward), || up2::forward(&shape, map, kernel));
                (out, shape.small.map(|n| 2 * n))
            }
        };
        tensor(out, [images, outputs, rows, cols])
    }
}

/// Returns the requested gradients of `x` and `weight`.
fn backward(
    kind: Kind,
    x: &FloatTensor<Flex>,
    weight: &FloatTensor<Flex>,
    gradient: &FloatTensor<Flex>,
    wanted: [bool; 2],
) -> [Option<FloatTensor<Flex>>; 2] {
    let (x, weight, gradient) = (x.to_contiguous(), weight.to_contiguous(), gradient.to_contiguous());
    let (map, kernel, slope) = (numbers(&x), numbers(&weight), numbers(&gradient));
    let [of_x, of_weight] = match kind.sized(&x, &weight) {
        Sized::Conv(shape) => {
            time(Part::Convolution(Pass::Backward), || conv::backward(&shape, map, kernel, slope, wanted))
        }
        Sized::Up2(shape) => {
            time(Part::Upsampling(Pass::Backward), || up2::backward(&shape, map, kernel, slope, wanted))
        }
    };
    [of_x.map(|data| tensor(data, dims::<4>(&x))), of_weight.map(|data| tensor(data, dims::<4>(&weight)))]
}

/// The step of automatic differentiation.
#[derive(Debug)]
struct Step;

impl Backward<Flex, 2> for Step {
    type State = (NodeId, NodeId, Kind);

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, checkpointer: &mut Checkpointer) {
        let gradient = grads.consume::<Flex>(&ops.node);
        let (x, weight, kind) = ops.state;
        let x = checkpointer.retrieve_node_output::<FloatTensor<Flex>>(x);
        let weight = checkpointer.retrieve_node_output::<FloatTensor<Flex>>(weight);
        let wanted = ops.parents.each_ref().map(Option::is_some);
        let found = backward(kind, &x, &weight, &gradient, wanted);
        for (node, gradient) in ops.parents.iter().zip(found) {
            if let (Some(node), Some(gradient)) = (node, gradient) {
                grads.register::<Flex>(node.id, gradient);
            }
        }
    }
}

impl<C: CheckpointStrategy> Convolutions for Autodiff<Flex, C> {
    fn convolve(x: FloatTensor<Self>, weight: FloatTensor<Self>, kind: Kind) -> FloatTensor<Self> {
        match Step.prepare::<C>([x.node(), weight.node()]).compute_bound().stateful() {
            OpsKind::Tracked(mut prep) => {
                let state = (prep.checkpoint(&x), prep.checkpoint(&weight), kind);
                prep.finish(state, Flex::convolve(x.into_primitive(), weight.into_primitive(), kind))
            }
            OpsKind::UnTracked(prep) => prep.finish(Flex::convolve(x.into_primitive(), weight.into_primitive(), kind)),
        }
    }
}
