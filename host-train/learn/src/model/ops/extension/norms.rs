//! The batch normalisation of the extension.

use super::super::batch_norm::{self, Parameters, Shape};
use super::step::{Operator, apply, track};
use super::tokens::Affine;
use super::{dims, numbers, shaped, tensor};
use crate::stopwatch::{Part, Pass, time};
use burn::backend::autodiff::NodeId;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, AutodiffBackend, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::Tensor;

/// Extension of flex for maps `[B, C, H, W]`.
#[backend_extension(Flex, Autodiff)]
pub(super) trait Norms: Backend {
    /// Returns mean and biased variance of the channels, `[2, C]`. Automatic differentiation treats them as constants.
    fn channel_statistics(x: FloatTensor<Self>) -> FloatTensor<Self>;

    /// Normalises the map by its own statistics, multiplies by `weight`, adds `bias`, and optionally applies a ReLU. For the gradient, the
    /// statistics count as functions of the map.
    fn normalise_channels(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        statistics: FloatTensor<Self>,
        options: Options,
    ) -> FloatTensor<Self>;

    /// The same, with `other` added before a ReLU.
    fn normalise_and_add(
        x: FloatTensor<Self>,
        #[extension_type] affine: Affine<Self>,
        statistics: FloatTensor<Self>,
        other: FloatTensor<Self>,
        epsilon: f32,
    ) -> FloatTensor<Self>;
}

/// Options of the normalisation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in super::super) struct Options {
    /// Added to the variance.
    pub(in super::super) epsilon: f32,
    /// Whether negative results become zero.
    pub(in super::super) relu: bool,
}

/// Returns output and statistics of the operator on a map that [`super::takes`] accepts.
pub(in super::super) fn run(
    x: Tensor<4>,
    weight: Tensor<1>,
    bias: Tensor<1>,
    options: Options,
) -> (Tensor<4>, Tensor<2>) {
    let statistics = <Dispatch as Norms>::channel_statistics(x.clone().into_dispatch());
    let (weight, bias) = (weight.into_dispatch(), bias.into_dispatch());
    let out = <Dispatch as Norms>::normalise_channels(x.into_dispatch(), weight, bias, statistics.clone(), options);
    (Tensor::from_dispatch(out), Tensor::from_dispatch(statistics))
}

/// Returns relu(normalised + other) and statistics of the operator on maps that [`super::takes`] accepts.
pub(in super::super) fn run_added(
    x: Tensor<4>,
    affine: Affine<Dispatch>,
    epsilon: f32,
    other: Tensor<4>,
) -> (Tensor<4>, Tensor<2>) {
    let statistics = <Dispatch as Norms>::channel_statistics(x.clone().into_dispatch());
    let (x, other) = (x.into_dispatch(), other.into_dispatch());
    let out = <Dispatch as Norms>::normalise_and_add(x, affine, statistics.clone(), other, epsilon);
    (Tensor::from_dispatch(out), Tensor::from_dispatch(statistics))
}

/// The normalisation with addition and ReLU, of a map, weight, bias, and the other map.
#[derive(Debug, Clone)]
struct Added {
    statistics: FloatTensor<Flex>,
    epsilon: f32,
}

impl Added {
    /// Returns the parameters. The ReLU comes after the addition.
    fn parameters<'a>(&'a self, [weight, bias]: [&'a FloatTensor<Flex>; 2]) -> Parameters<'a> {
        parameters(weight, bias, &self.statistics, Options { epsilon: self.epsilon, relu: false })
    }
}

impl Operator<4> for Added {
    fn forward(&self, operands: &[FloatTensor<Flex>; 4]) -> FloatTensor<Flex> {
        let [x, weight, bias, other] = operands;
        let parameters = self.parameters([weight, bias]);
        let run = || batch_norm::forward_added(&shape(x), numbers(x), &parameters, numbers(other));
        shaped(time(Part::BatchNorm(Pass::Forward), run), x)
    }

    fn backward(&self, operands: &[FloatTensor<Flex>; 4], gradient: &FloatTensor<Flex>) -> [Vec<f32>; 4] {
        let ([x, weight, bias, other], shape) = (operands, shape(&operands[0]));
        let parameters = self.parameters([weight, bias]);
        time(Part::BatchNorm(Pass::Backward), || {
            let passed = batch_norm::passed_added(&shape, numbers(x), &parameters, numbers(other), numbers(gradient));
            let [of_x, of_weight, of_bias] = batch_norm::backward(&shape, numbers(x), &parameters, &passed);
            [of_x, of_weight, of_bias, passed]
        })
    }
}

fn shape(x: &FloatTensor<Flex>) -> Shape {
    let [images, channels, rows, cols] = dims(x);
    Shape { images, channels, pixels: rows * cols }
}

impl Norms for Flex {
    fn channel_statistics(x: FloatTensor<Self>) -> FloatTensor<Self> {
        let x = x.to_contiguous();
        let shape = shape(&x);
        let found = time(Part::BatchNorm(Pass::Forward), || batch_norm::statistics(&shape, numbers(&x)));
        tensor(found, [2, shape.channels])
    }

    fn normalise_channels(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        statistics: FloatTensor<Self>,
        options: Options,
    ) -> FloatTensor<Self> {
        let [x, weight, bias, statistics] = [x, weight, bias, statistics].map(|t| t.to_contiguous());
        let parameters = parameters(&weight, &bias, &statistics, options);
        let normalise = || batch_norm::forward(&shape(&x), numbers(&x), &parameters);
        let out = time(Part::BatchNorm(Pass::Forward), normalise);
        tensor(out, dims::<4>(&x))
    }

    fn normalise_and_add(
        x: FloatTensor<Self>,
        affine: Affine<Self>,
        statistics: FloatTensor<Self>,
        other: FloatTensor<Self>,
        epsilon: f32,
    ) -> FloatTensor<Self> {
        apply(&Added { statistics, epsilon }, [x, affine.weight, affine.bias, other])
    }
}

fn parameters<'a>(
    weight: &'a FloatTensor<Flex>,
    bias: &'a FloatTensor<Flex>,
    statistics: &'a FloatTensor<Flex>,
    Options { epsilon, relu }: Options,
) -> Parameters<'a> {
    Parameters { statistics: numbers(statistics), weight: numbers(weight), bias: numbers(bias), epsilon, relu }
}

/// The step of automatic differentiation.
#[derive(Debug)]
struct Step;

impl Backward<Flex, 3> for Step {
    type State = (NodeId, NodeId, NodeId, FloatTensor<Flex>, Options);

    fn backward(self, ops: Ops<Self::State, 3>, grads: &mut Gradients, checkpointer: &mut Checkpointer) {
        let gradient = grads.consume::<Flex>(&ops.node).to_contiguous();
        let (x, weight, bias, statistics, options) = ops.state;
        let [x, weight, bias] =
            [x, weight, bias].map(|id| checkpointer.retrieve_node_output::<FloatTensor<Flex>>(id).to_contiguous());
        let statistics = statistics.to_contiguous();
        let parameters = parameters(&weight, &bias, &statistics, options);
        let back = || batch_norm::backward(&shape(&x), numbers(&x), &parameters, numbers(&gradient));
        let [of_x, of_weight, of_bias] = time(Part::BatchNorm(Pass::Backward), back);
        let channels = [of_weight.len()];
        let found = [tensor(of_x, dims::<4>(&x)), tensor(of_weight, channels), tensor(of_bias, channels)];
        for (node, gradient) in ops.parents.iter().zip(found) {
            if let Some(node) = node {
                grads.register::<Flex>(node.id, gradient);
            }
        }
    }
}

impl<C: CheckpointStrategy> Norms for Autodiff<Flex, C> {
    fn channel_statistics(x: FloatTensor<Self>) -> FloatTensor<Self> {
        Self::from_inner(Flex::channel_statistics(x.into_primitive()))
    }

    fn normalise_channels(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        statistics: FloatTensor<Self>,
        options: Options,
    ) -> FloatTensor<Self> {
        let statistics = statistics.into_primitive();
        match Step.prepare::<C>([x.node(), weight.node(), bias.node()]).compute_bound().stateful() {
            OpsKind::Tracked(mut prep) => {
                let ids = (prep.checkpoint(&x), prep.checkpoint(&weight), prep.checkpoint(&bias));
                let state = (ids.0, ids.1, ids.2, statistics.clone(), options);
                let (x, weight, bias) = (x.into_primitive(), weight.into_primitive(), bias.into_primitive());
                prep.finish(state, Flex::normalise_channels(x, weight, bias, statistics, options))
            }
            OpsKind::UnTracked(prep) => {
                let (x, weight, bias) = (x.into_primitive(), weight.into_primitive(), bias.into_primitive());
                prep.finish(Flex::normalise_channels(x, weight, bias, statistics, options))
            }
        }
    }

    fn normalise_and_add(
        x: FloatTensor<Self>,
        affine: Affine<Self>,
        statistics: FloatTensor<Self>,
        other: FloatTensor<Self>,
        epsilon: f32,
    ) -> FloatTensor<Self> {
        let operator = Added { statistics: statistics.into_primitive(), epsilon };
        track::<C, 4>(operator, [x, affine.weight, affine.bias, other])
    }
}
