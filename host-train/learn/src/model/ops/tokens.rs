//! Operators of the Swin transformer on tokens `[B, H, W, C]`: in one where the CPU backend has them, otherwise from Burn's operators.

use super::extension::takes;
use super::extension::tokens::{self, Affine, Windows};
use super::gelu;
use crate::model::precision::in_f32;
use crate::model::swin::windows::WindowPlan;
use burn::module::Param;
use burn::nn::{LayerNorm, Linear};
use burn::tensor::{DType, Tensor};

/// Greatest number of channels of the operators in one. With more, the weights leave a core's cache for every tile of tokens.
const MOST_CHANNELS: usize = 256;

/// Returns weight and bias of a layer norm for the operators in one.
fn norm_of(norm: &LayerNorm) -> Option<Affine<burn::backend::Dispatch>> {
    Some(Affine::new(norm.gamma.val(), norm.beta.as_ref()?.val()))
}

/// Returns weight and bias of a linear layer for the operators in one: `None` without bias or in another precision.
fn linear_of(linear: &Linear) -> Option<Affine<burn::backend::Dispatch>> {
    let weight = linear.weight.val();
    (weight.dtype() == DType::F32).then_some(())?;
    Some(Affine::new(weight, linear.bias.as_ref()?.val()))
}

fn in_one(x: &Tensor<4>) -> bool {
    takes(&[x]) && x.dims()[3] <= MOST_CHANNELS
}

/// Normalises each token, in `f32`.
pub fn layer_norm(norm: &LayerNorm, x: Tensor<4>) -> Tensor<4> {
    match norm_of(norm).filter(|_| takes(&[&x])) {
        Some(weights) => tokens::layer_norm(x, weights),
        None => in_f32(x, |x| norm.forward(x)),
    }
}

/// Returns `x + second(gelu(first(norm(x))))`.
pub fn perceptron(norm: &LayerNorm, [first, second]: [&Linear; 2], x: Tensor<4>) -> Tensor<4> {
    let weights = || Some([norm_of(norm)?, linear_of(first)?, linear_of(second)?]);
    match weights().filter(|_| in_one(&x)) {
        Some(weights) => tokens::perceptron(x, weights),
        None => {
            let hidden = first.forward(layer_norm(norm, x.clone()));
            x.add(second.forward(gelu(hidden)))
        }
    }
}

/// Returns `x + projection(attention(qkv(norm(x))))` with attention inside windows, or `None` where no operator does this in one. `table`
/// is the relative position bias, `[(2 window - 1)², heads]`.
pub fn window_attention(
    norm: &LayerNorm,
    [qkv, projection]: [&Linear; 2],
    (table, heads): (&Param<Tensor<2>>, usize),
    plan: WindowPlan,
    x: &Tensor<4>,
) -> Option<Tensor<4>> {
    let weights = [norm_of(norm)?, linear_of(qkv)?, linear_of(projection)?];
    in_one(x).then(|| tokens::attend(x.clone(), weights, table.val(), Windows { heads, plan }))
}
