//! Our own operators for the CPU backend: convolutions, upsampling with a convolution, and batch normalisation in training. Other backends use
//! Burn's, except where its gradient is missing or another (upsampling, GELU). With Burn's a step of training takes longer: docs/training.md.
//!
//! Burn's flex computes a convolution as a product with a matrix of patches, and its gradients as further convolutions with kernels as
//! large as the map. Here the kernels read the maps in place ([`product`], [`correlate`]). For all channel counts they use the full width
//! of the processor's vectors. They are a backend extension of Burn ([`extension`]), so the rest of the network does not depend on them.
//! Results do not depend on the number of threads.

mod batch_norm;
mod conv;
mod correlate;
mod extension;
mod frame;
mod product;
mod scratch;
#[cfg(test)]
mod tests;
mod up2;

use crate::model::backend::has_exact_gradients;
use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use burn::tensor::module;
use burn::tensor::ops::{ConvOptions, InterpolateMode, InterpolateOptions};
use extension::{convolutions, norms, takes};

/// Convolves without bias: `x` `[B, I, H, W]` and `weight` `[O, I, kh, kw]` to
/// `[B, O, (H + 2 p - kh) / stride + 1, (W + 2 p - kw) / stride + 1]`, with p = `padding` zeros around `x`.
pub fn conv2d(x: Tensor<4>, weight: Tensor<4>, stride: usize, padding: usize) -> Tensor<4> {
    if takes(&[&x, &weight]) {
        return convolutions::run(x, weight, convolutions::Kind::Conv { stride, padding });
    }
    module::conv2d(x, weight, None, ConvOptions::new([stride; 2], [padding; 2], [1, 1], 1))
}

/// A map to be upsampled by two bilinearly (half-pixel centres, align_corners = false; our choice, the paper does not state it), and then
/// convolved. The CPU backend does both in one; for others the upsampled map is made once, for all its convolutions.
#[derive(Clone)]
pub struct Upsampled {
    small: Tensor<4>,
    large: Option<Tensor<4>>,
}

impl Upsampled {
    /// Takes a map `[B, I, h, w]`.
    pub fn new(small: Tensor<4>) -> Self {
        let in_one = takes(&[&small]) && small.dims()[2].min(small.dims()[3]) >= up2::MIN_SIDE;
        Self { large: (!in_one).then(|| up2(small.clone())), small }
    }

    /// Returns the map of the last channels alone. `small` are these channels, before upsampling.
    pub fn last_channels(&self, small: Tensor<4>) -> Self {
        let [count, all] = [&small, &self.small].map(|map| map.dims()[1]);
        Self { large: self.large.clone().map(|large| large.narrow(1, all - count, count)), small }
    }

    /// Convolves 5x5 with two zeros on every side: with `weight` `[O, I, 5, 5]` to `[B, O, 2h, 2w]`.
    pub fn conv5(&self, weight: Tensor<4>) -> Tensor<4> {
        match &self.large {
            Some(large) => conv2d(large.clone(), weight, 1, 2),
            None => convolutions::run(self.small.clone(), weight, convolutions::Kind::Up2),
        }
    }
}

/// Upsamples by two bilinearly. Where Burn's operator has no gradient, upsampling with gradients is [`up2_by_sums`].
fn up2(x: Tensor<4>) -> Tensor<4> {
    let device = x.device();
    if device.is_autodiff() && !has_exact_gradients(&device) { up2_by_sums(x) } else { up2_by_burn(x) }
}

fn up2_by_burn(x: Tensor<4>) -> Tensor<4> {
    let options =
        InterpolateOptions::new(InterpolateMode::Bilinear).with_align_corners(false).with_scale_factor([2.0, 2.0]);
    module::interpolate(x, options)
}

/// Upsamples by two bilinearly with operators that have gradients on every backend.
fn up2_by_sums(x: Tensor<4>) -> Tensor<4> {
    double(double(x, 2), 3)
}

/// Upsamples one axis. Each pixel becomes two: three quarters of it, and a quarter of its neighbour on that side. At the border it is its
/// own neighbour.
fn double(x: Tensor<4>, axis: usize) -> Tensor<4> {
    let mut dims = x.dims();
    let last = dims[axis] - 1;
    dims[axis] *= 2;
    let part = |start: usize, length: usize| x.clone().narrow(axis, start, length);
    let [before, after] = match last {
        0 => [x.clone(), x.clone()],
        _ => [[part(0, 1), part(0, last)], [part(1, last), part(last, 1)]].map(|two| Tensor::cat(two.into(), axis)),
    };
    let near = x.mul_scalar(0.75);
    let two = [before, after].map(|neighbour| near.clone().add(neighbour.mul_scalar(0.25)));
    Tensor::stack::<5>(two.into(), axis + 1).reshape(dims)
}

/// Applies GELU, with its own gradient on every backend.
pub fn gelu<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    let device = x.device();
    if device.is_autodiff() && !has_exact_gradients(&device) {
        gelu_by_erf(x)
    } else {
        burn::tensor::activation::gelu(x)
    }
}

/// Computes GELU as x (1 + erf(x / sqrt 2)) / 2.
fn gelu_by_erf<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    let both = x.clone().mul_scalar(std::f64::consts::FRAC_1_SQRT_2).erf().add_scalar(1.0);
    x.mul_scalar(0.5).mul(both)
}

/// Result of [`batch_norm_train`].
pub struct Normalised {
    /// The normalised map.
    pub output: Tensor<4>,
    /// Mean of each channel, `[C]`, without gradient.
    pub mean: Tensor<1>,
    /// Biased variance of each channel, `[C]`, without gradient.
    pub variance: Tensor<1>,
}

/// Normalises `x` `[B, C, H, W]` by its own statistics over B, H and W, then applies `weight` and `bias` `[C]`, then optionally a ReLU.
pub fn batch_norm_train(x: Tensor<4>, weight: Tensor<1>, bias: Tensor<1>, epsilon: f64, with_relu: bool) -> Normalised {
    if takes(&[&x]) {
        let channels = x.dims()[1];
        let options = norms::NormOptions { epsilon: epsilon as f32, relu: with_relu };
        let (output, statistics) = norms::run(x, weight, bias, options);
        let figure = |i: usize| statistics.clone().narrow(0, i, 1).reshape([channels]);
        return Normalised { output, mean: figure(0), variance: figure(1) };
    }
    let out = module::batch_norm_train(x, weight, bias, epsilon);
    let output = if with_relu { relu(out.output) } else { out.output };
    Normalised { output, mean: out.mean.detach(), variance: out.variance.detach() }
}
