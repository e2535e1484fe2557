//! Normalisations in `f32`: batch normalisation with PyTorch's running statistics, and that of tokens.

use super::cast::{cast, in_f32};
use super::ops::{Normalised, batch_norm_train};
use burn::module::{Initializer, Module, Param, RunningState};
use burn::nn::LayerNorm;
use burn::tensor::activation::relu;
use burn::tensor::module::batch_norm;
use burn::tensor::{DType, Device, Tensor};

/// Added to the variance; PyTorch's default.
pub const EPSILON: f64 = 1e-5;

/// Batch normalisation of `[B, C, H, W]` over B, H and W. On an autodiff device it uses and records the batch's statistics, otherwise the
/// running ones.
///
/// In contrast to Burn's own module, the running variance uses the unbiased batch variance, as in PyTorch. At 1/32 resolution a small crop
/// has so few samples that the difference is visible.
#[derive(Module, Debug)]
pub struct BatchNorm2d {
    weight: Param<Tensor<1>>,
    bias: Param<Tensor<1>>,
    running_mean: RunningState<Tensor<1>>,
    running_var: RunningState<Tensor<1>>,
    momentum: f64,
}

impl BatchNorm2d {
    /// Makes an identity: weight 1, bias 0, mean 0, variance 1. `momentum` is the share of a batch in the running statistics.
    pub fn new(channels: usize, momentum: f64, device: &Device) -> Self {
        Self {
            weight: Initializer::Ones.init([channels], device),
            bias: Initializer::Zeros.init([channels], device),
            running_mean: RunningState::new(Tensor::zeros([channels], device)),
            running_var: RunningState::new(Tensor::ones([channels], device)),
            momentum,
        }
    }

    /// Maps `[B, C, H, W]` to the same shape, optionally through a ReLU. It computes in `f32`.
    pub fn forward(&self, x: Tensor<4>, with_relu: bool) -> Tensor<4> {
        let (device, dtype) = (x.device(), x.dtype());
        if !device.is_autodiff() {
            let y = self.by_running_statistics(x);
            return cast(if with_relu { relu(y) } else { y }, dtype);
        }
        let x = cast(x, DType::F32);
        let samples = samples(&x);
        let out = batch_norm_train(x, self.weight.val(), self.bias.val(), EPSILON, with_relu);
        cast(self.learn(out, samples), dtype)
    }

    fn by_running_statistics(&self, x: Tensor<4>) -> Tensor<4> {
        let (mean, var) = (self.running_mean.value_sync(), self.running_var.value_sync());
        batch_norm(cast(x, DType::F32), self.weight.val(), self.bias.val(), mean, var, EPSILON)
    }

    /// Adds the statistics of a batch to the running ones. Returns the map.
    fn learn(&self, out: Normalised, samples: f64) -> Tensor<4> {
        let device = out.output.device();
        let unbiased = samples / (samples - 1.0).max(1.0);
        let blend = |old: &RunningState<Tensor<1>>, new: Tensor<1>, scale: f64| {
            let kept = old.value_sync().to_device(&device).mul_scalar(1.0 - self.momentum);
            old.update(kept.add(new.detach().mul_scalar(self.momentum * scale)).detach());
            // An update is kept for its thread alone until then, and the next step may run on another thread.
            let _ = old.value_sync();
        };
        blend(&self.running_mean, out.mean, 1.0);
        blend(&self.running_var, out.variance, unbiased);
        out.output
    }
}

/// Normalises each token `[.., C]`.
pub fn layer_norm(norm: &LayerNorm, x: Tensor<4>) -> Tensor<4> {
    in_f32(x, |x| norm.forward(x))
}

/// Returns the number of samples of a channel.
fn samples(x: &Tensor<4>) -> f64 {
    let [b, _, h, w] = x.dims();
    (b * h * w) as f64
}
