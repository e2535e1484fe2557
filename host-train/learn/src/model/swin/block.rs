//! One Swin block: windowed attention and a two-layer perceptron, each after a layer norm and with a residual connection.

use super::attention::WindowAttention;
use super::depth::{BlockFactors, scaled};
use super::windows::{WindowPlan, merge, partition};
use crate::model::norm::layer_norm;
use crate::model::ops::gelu;
use burn::module::Module;
use burn::nn::{LayerNorm, LayerNormConfig, Linear, LinearConfig};
use burn::tensor::ops::PadMode;
use burn::tensor::{Device, Tensor};

/// Two linear layers with GELU. The hidden layer is four times as wide.
#[derive(Module, Debug)]
pub struct Mlp {
    fc1: Linear,
    fc2: Linear,
}

/// Swin block. After `norm1` it pads right and bottom to whole windows (padded tokens are zeros and are not masked, as in published
/// segmentation code), then shifts, attends, shifts back and crops.
#[derive(Module, Debug)]
pub struct Block {
    norm1: LayerNorm,
    attn: WindowAttention,
    norm2: LayerNorm,
    mlp: Mlp,
    window: usize,
    shift: usize,
}

impl Block {
    /// Makes a block of `dim` channels; `shift` is 0 or half a window.
    pub fn new(dim: usize, window: usize, heads: usize, shift: usize, device: &Device) -> Self {
        let mlp = Mlp {
            fc1: LinearConfig::new(dim, 4 * dim).init(device),
            fc2: LinearConfig::new(4 * dim, dim).init(device),
        };
        Self {
            norm1: LayerNormConfig::new(dim).init(device),
            attn: WindowAttention::new(dim, window, heads, device),
            norm2: LayerNormConfig::new(dim).init(device),
            mlp,
            window,
            shift,
        }
    }

    /// Maps `[B, H, W, C]` to the same shape. `factors` multiply the residual branches of every sample; `None` leaves them as they are.
    pub fn forward(&self, x: Tensor<4>, factors: Option<&BlockFactors>) -> Tensor<4> {
        let [_, h, w, _] = x.dims();
        let plan = WindowPlan::new(h, w, self.window, self.shift);
        let weigh = |i: usize, branch: Tensor<4>| match factors {
            Some(both) => scaled(branch, &both[i]),
            None => branch,
        };
        let attended = self.attend(layer_norm(&self.norm1, x.clone()), plan);
        let x = x.add(weigh(0, attended));
        let hidden = gelu(self.mlp.fc1.forward(layer_norm(&self.norm2, x.clone())));
        x.add(weigh(1, self.mlp.fc2.forward(hidden)))
    }

    fn attend(&self, y: Tensor<4>, plan: WindowPlan) -> Tensor<4> {
        let [b, h, w, _] = y.dims();
        let [hp, wp] = plan.padded;
        let [sy, sx] = plan.shift.map(|s| s as i64);
        let mut y = if [hp, wp] == [h, w] {
            y
        } else {
            y.pad([(0, 0), (0, hp - h), (0, wp - w), (0, 0)], PadMode::Constant(0.0))
        };
        if plan.shifted() {
            y = y.roll(&[-sy, -sx], &[1, 2]);
        }
        let mask = plan.mask(&y.device());
        let mut y = merge(self.attn.forward(partition(y, self.window), mask), self.window, [b, hp, wp]);
        if plan.shifted() {
            y = y.roll(&[sy, sx], &[1, 2]);
        }
        if [hp, wp] == [h, w] { y } else { y.slice([0..b, 0..h, 0..w]) }
    }
}
