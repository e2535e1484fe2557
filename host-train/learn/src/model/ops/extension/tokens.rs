//! The operators on tokens: layer normalisation and the two halves of a Swin block.

use super::super::{attention, layer_norm as norm_rows, perceptron as mlp};
use super::step::{Operator, apply, track};
use super::{dims, numbers, shaped};
use crate::model::swin::windows::{WindowPlan, relative_rows};
use crate::stopwatch::{Part, Pass, time};
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, ExtensionType, Flex, backend_extension};
use burn::tensor::Tensor;

/// Weight and bias of a linear layer or a normalisation.
#[derive(Debug, Clone, ExtensionType)]
pub(in super::super) struct Affine<B: Backend> {
    /// Weight.
    pub(super) weight: FloatTensor<B>,
    /// Bias.
    pub(super) bias: FloatTensor<B>,
}

/// Extension of flex for tokens.
#[backend_extension(Flex, Autodiff)]
pub(super) trait Tokens: Backend {
    /// Normalises tokens `[.., C]`.
    fn normalise_tokens(x: FloatTensor<Self>, #[extension_type] norm: Affine<Self>) -> FloatTensor<Self>;

    /// See [`perceptron`].
    fn perceptron(
        x: FloatTensor<Self>,
        #[extension_type] norm: Affine<Self>,
        #[extension_type] first: Affine<Self>,
        #[extension_type] second: Affine<Self>,
    ) -> FloatTensor<Self>;

    /// See [`attend`].
    fn attend(
        x: FloatTensor<Self>,
        #[extension_type] norm: Affine<Self>,
        #[extension_type] qkv: Affine<Self>,
        table: FloatTensor<Self>,
        #[extension_type] projection: Affine<Self>,
        windows: Windows,
    ) -> FloatTensor<Self>;
}

/// The windows of [`attend`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in super::super) struct Windows {
    /// Number of heads.
    pub(in super::super) heads: usize,
    /// Arrangement of the windows.
    pub(in super::super) plan: WindowPlan,
}

impl Affine<Dispatch> {
    /// Takes a weight and its bias.
    pub(in super::super) fn new<const D: usize>(weight: Tensor<D>, bias: Tensor<1>) -> Self {
        Self { weight: weight.into_dispatch(), bias: bias.into_dispatch() }
    }
}

/// Normalises tokens that [`super::takes`] accepts.
pub(in super::super) fn layer_norm(x: Tensor<4>, norm: Affine<Dispatch>) -> Tensor<4> {
    Tensor::from_dispatch(<Dispatch as Tokens>::normalise_tokens(x.into_dispatch(), norm))
}

/// Returns x + second(gelu(first(norm(x)))) for tokens that [`super::takes`] accepts.
pub(in super::super) fn perceptron(x: Tensor<4>, [norm, first, second]: [Affine<Dispatch>; 3]) -> Tensor<4> {
    Tensor::from_dispatch(<Dispatch as Tokens>::perceptron(x.into_dispatch(), norm, first, second))
}

/// Returns x + attention(norm(x)) for tokens that [`super::takes`] accepts.
pub(in super::super) fn attend(
    x: Tensor<4>,
    [norm, qkv, projection]: [Affine<Dispatch>; 3],
    table: Tensor<2>,
    windows: Windows,
) -> Tensor<4> {
    let (x, table) = (x.into_dispatch(), table.into_dispatch());
    Tensor::from_dispatch(<Dispatch as Tokens>::attend(x, norm, qkv, table, projection, windows))
}

#[derive(Debug, Clone)]
struct Normalisation;

impl Operator<3> for Normalisation {
    fn forward(&self, operands: &[FloatTensor<Flex>; 3]) -> FloatTensor<Flex> {
        let [x, weight, bias] = operands.each_ref().map(numbers);
        let out = time(Part::Tokens(Pass::Forward), || norm_rows::forward(x, [weight, bias]));
        shaped(out, &operands[0])
    }

    fn backward(&self, operands: &[FloatTensor<Flex>; 3], gradient: &FloatTensor<Flex>) -> [Vec<f32>; 3] {
        let [x, weight, _] = operands.each_ref().map(numbers);
        time(Part::Tokens(Pass::Backward), || norm_rows::backward(x, weight, numbers(gradient)))
    }
}

#[derive(Debug, Clone)]
struct Perceptron;

impl Perceptron {
    fn weights<'a>([norm, shift, first, first_bias, second, second_bias]: [&'a [f32]; 6]) -> mlp::Weights<'a> {
        mlp::Weights { norm: [norm, shift], first: [first, first_bias], second: [second, second_bias] }
    }
}

impl Operator<7> for Perceptron {
    fn forward(&self, operands: &[FloatTensor<Flex>; 7]) -> FloatTensor<Flex> {
        let [x, weights @ ..] = operands.each_ref().map(numbers);
        let out = time(Part::Tokens(Pass::Forward), || mlp::forward(x, &Self::weights(weights)));
        shaped(out, &operands[0])
    }

    fn backward(&self, operands: &[FloatTensor<Flex>; 7], gradient: &FloatTensor<Flex>) -> [Vec<f32>; 7] {
        let [x, weights @ ..] = operands.each_ref().map(numbers);
        let back = || mlp::backward(x, &Self::weights(weights), numbers(gradient));
        time(Part::Tokens(Pass::Backward), back)
    }
}

impl Windows {
    fn shape(&self, x: &FloatTensor<Flex>) -> attention::Shape {
        let [images, rows, cols, channels] = dims(x);
        attention::Shape { images, tokens: [rows, cols], channels, heads: self.heads, plan: self.plan }
    }

    /// Runs `work` with the weights.
    fn with<T>(
        &self,
        [norm, shift, qkv, qkv_bias, table, projection, projection_bias]: [&[f32]; 7],
        work: impl FnOnce(attention::Weights) -> T,
    ) -> T {
        let index = relative_rows(self.plan.window);
        work(attention::Weights {
            norm: [norm, shift],
            qkv: [qkv, qkv_bias],
            table,
            index: &index,
            projection: [projection, projection_bias],
        })
    }
}

impl Operator<8> for Windows {
    fn forward(&self, operands: &[FloatTensor<Flex>; 8]) -> FloatTensor<Flex> {
        let ([x, weights @ ..], shape) = (operands.each_ref().map(numbers), self.shape(&operands[0]));
        let run = || self.with(weights, |weights| attention::forward(&shape, x, weights));
        shaped(time(Part::Tokens(Pass::Forward), run), &operands[0])
    }

    fn backward(&self, operands: &[FloatTensor<Flex>; 8], gradient: &FloatTensor<Flex>) -> [Vec<f32>; 8] {
        let ([x, weights @ ..], shape) = (operands.each_ref().map(numbers), self.shape(&operands[0]));
        let run = || self.with(weights, |weights| attention::backward(&shape, x, weights, numbers(gradient)));
        time(Part::Tokens(Pass::Backward), run)
    }
}

impl Tokens for Flex {
    fn normalise_tokens(x: FloatTensor<Self>, norm: Affine<Self>) -> FloatTensor<Self> {
        apply(&Normalisation, [x, norm.weight, norm.bias])
    }

    fn perceptron(
        x: FloatTensor<Self>,
        norm: Affine<Self>,
        first: Affine<Self>,
        second: Affine<Self>,
    ) -> FloatTensor<Self> {
        apply(&Perceptron, [x, norm.weight, norm.bias, first.weight, first.bias, second.weight, second.bias])
    }

    fn attend(
        x: FloatTensor<Self>,
        norm: Affine<Self>,
        qkv: Affine<Self>,
        table: FloatTensor<Self>,
        projection: Affine<Self>,
        windows: Windows,
    ) -> FloatTensor<Self> {
        let [a, b, c] = [norm, qkv, projection].map(|Affine { weight, bias }| (weight, bias));
        apply(&windows, [x, a.0, a.1, b.0, b.1, table, c.0, c.1])
    }
}

impl<C: CheckpointStrategy> Tokens for Autodiff<Flex, C> {
    fn normalise_tokens(x: FloatTensor<Self>, norm: Affine<Self>) -> FloatTensor<Self> {
        track::<C, 3>(Normalisation, [x, norm.weight, norm.bias])
    }

    fn perceptron(
        x: FloatTensor<Self>,
        norm: Affine<Self>,
        first: Affine<Self>,
        second: Affine<Self>,
    ) -> FloatTensor<Self> {
        track::<C, 7>(Perceptron, [x, norm.weight, norm.bias, first.weight, first.bias, second.weight, second.bias])
    }

    fn attend(
        x: FloatTensor<Self>,
        norm: Affine<Self>,
        qkv: Affine<Self>,
        table: FloatTensor<Self>,
        projection: Affine<Self>,
        windows: Windows,
    ) -> FloatTensor<Self> {
        let [a, b, c] = [norm, qkv, projection].map(|Affine { weight, bias }| (weight, bias));
        track::<C, 8>(windows, [x, a.0, a.1, b.0, b.1, table, c.0, c.1])
    }
}
