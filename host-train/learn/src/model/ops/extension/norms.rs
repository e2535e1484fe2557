//! The batch normalisation of the extension.

use super::super::batch_norm::{self, NormParameters, NormShape};
use super::step::{Operator, apply, track};
use super::{dims, numbers, shaped, tensor};
use crate::stopwatch::{Pass, TrainingPart, time};
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
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
        options: NormOptions,
    ) -> FloatTensor<Self>;
}

/// Options of the normalisation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in super::super) struct NormOptions {
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
    options: NormOptions,
) -> (Tensor<4>, Tensor<2>) {
    let statistics = <Dispatch as Norms>::channel_statistics(x.clone().into_dispatch());
    let (weight, bias) = (weight.into_dispatch(), bias.into_dispatch());
    let out = <Dispatch as Norms>::normalise_channels(x.into_dispatch(), weight, bias, statistics.clone(), options);
    (Tensor::from_dispatch(out), Tensor::from_dispatch(statistics))
}

/// The normalisation of a map by `statistics`, with a weight and a bias.
#[derive(Debug, Clone)]
struct Normalisation {
    statistics: FloatTensor<Flex>,
    options: NormOptions,
}

impl Normalisation {
    fn parameters<'a>(&'a self, weight: &'a FloatTensor<Flex>, bias: &'a FloatTensor<Flex>) -> NormParameters<'a> {
        let NormOptions { epsilon, relu } = self.options;
        let statistics = numbers(&self.statistics);
        NormParameters { statistics, weight: numbers(weight), bias: numbers(bias), epsilon, relu }
    }
}

impl Operator<3> for Normalisation {
    fn forward(&self, [x, weight, bias]: &[FloatTensor<Flex>; 3]) -> FloatTensor<Flex> {
        let normalise = || batch_norm::forward(&shape(x), numbers(x), &self.parameters(weight, bias));
        shaped(time(TrainingPart::BatchNorm(Pass::Forward), normalise), x)
    }

    fn backward(
        &self,
        [x, weight, bias]: &[FloatTensor<Flex>; 3],
        gradient: &FloatTensor<Flex>,
        _: [bool; 3],
    ) -> [Option<Vec<f32>>; 3] {
        let parameters = self.parameters(weight, bias);
        let back = || batch_norm::backward(&shape(x), numbers(x), &parameters, numbers(gradient));
        time(TrainingPart::BatchNorm(Pass::Backward), back).map(Some)
    }
}

fn shape(x: &FloatTensor<Flex>) -> NormShape {
    let [images, channels, rows, cols] = dims(x);
    NormShape { images, channels, pixels: rows * cols }
}

impl Norms for Flex {
    fn channel_statistics(x: FloatTensor<Self>) -> FloatTensor<Self> {
        let x = x.to_contiguous();
        let shape = shape(&x);
        let found = time(TrainingPart::BatchNorm(Pass::Forward), || batch_norm::statistics(&shape, numbers(&x)));
        tensor(found, [2, shape.channels])
    }

    fn normalise_channels(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        statistics: FloatTensor<Self>,
        options: NormOptions,
    ) -> FloatTensor<Self> {
        apply(&Normalisation { statistics: statistics.to_contiguous(), options }, [x, weight, bias])
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
        options: NormOptions,
    ) -> FloatTensor<Self> {
        let statistics = statistics.into_primitive().to_contiguous();
        track::<C, 3>(Normalisation { statistics, options }, [x, weight, bias])
    }
}
