//! Multi-head self-attention inside windows, with a learned relative position bias.

use super::windows::relative_index;
use crate::model::cast::cast;
use burn::module::{Initializer, Module, Param};
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::softmax;
use burn::tensor::{DType, Device, Tensor};

/// Attention between the tokens of each window.
#[derive(Module, Debug)]
pub struct WindowAttention {
    qkv: Linear,
    proj: Linear,
    relative_position_bias_table: Param<Tensor<2>>,
    heads: usize,
    window: usize,
}

impl WindowAttention {
    /// Makes attention for `dim` channels in `heads` heads; `dim` is a multiple of `heads`.
    pub fn new(dim: usize, window: usize, heads: usize, device: &Device) -> Self {
        let side = 2 * window - 1;
        Self {
            qkv: LinearConfig::new(dim, 3 * dim).init(device),
            proj: LinearConfig::new(dim, dim).init(device),
            relative_position_bias_table: Initializer::Zeros.init([side * side, heads], device),
            heads,
            window,
        }
    }

    /// Maps `[B * windows, n, C]` to the same shape; `mask` is that of [`super::windows::WindowPlan::mask`].
    pub fn forward(&self, x: Tensor<3>, mask: Option<Tensor<4>>) -> Tensor<3> {
        let [b, n, c] = x.dims();
        let (heads, depth) = (self.heads, c / self.heads);
        // [3, B', heads, n, depth]
        let qkv: Tensor<5> = self.qkv.forward(x).reshape([b, n, 3, heads, depth]).permute([2, 0, 3, 1, 4]);
        let part = |i: usize| -> Tensor<4> { qkv.clone().narrow(0, i, 1).reshape([b, heads, n, depth]) };
        let q = part(0).mul_scalar((depth as f64).powf(-0.5));
        let dtype = q.dtype();
        let scores = cast(q.matmul(part(1).swap_dims(2, 3)), DType::F32).add(cast(self.bias(), DType::F32));
        let scores = match mask {
            None => scores,
            Some(mask) => {
                let windows = mask.dims()[0];
                let by_window: Tensor<5> = scores.reshape([b / windows, windows, heads, n, n]);
                by_window.add(mask.unsqueeze_dim::<5>(0)).reshape([b, heads, n, n])
            }
        };
        let mixed = cast(softmax(scores, 3), dtype).matmul(part(2)).swap_dims(1, 2).reshape([b, n, c]);
        self.proj.forward(mixed)
    }

    /// Returns the relative position bias `[1, heads, n, n]`.
    fn bias(&self) -> Tensor<4> {
        let n = self.window * self.window;
        let table = self.relative_position_bias_table.val();
        let index = relative_index(self.window, &table.device());
        table.select(0, index).reshape([1, n, n, self.heads]).permute([0, 3, 1, 2])
    }
}
