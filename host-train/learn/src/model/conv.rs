//! The convolution unit of every branch, on a map or on the map upsampled by two.

use super::norm::BatchNorm2d;
use super::ops::{Upsampled, conv2d};
use burn::module::Module;
use burn::nn::PaddingConfig2d;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

/// Convolution without bias, batch normalisation, optionally ReLU.
#[derive(Module, Debug)]
pub struct ConvBn {
    conv: Conv2d,
    bn: BatchNorm2d,
    relu: bool,
}

/// Shape of a [`ConvBn`].
#[derive(Debug, Clone, Copy)]
pub struct ConvBnShape {
    /// Input channels.
    pub input: usize,
    /// Output channels.
    pub output: usize,
    /// Kernel side k, odd; the padding is k/2.
    pub kernel: usize,
    /// Stride.
    pub stride: usize,
    /// Whether a ReLU ends the unit.
    pub relu: bool,
    /// Share of a batch in the running statistics of the batch normalisation.
    pub momentum: f64,
}

impl ConvBn {
    /// Builds the unit. The weights are set later.
    pub fn new(shape: ConvBnShape, device: &Device) -> Self {
        Self {
            conv: conv(shape.input, shape.output, shape.kernel, shape.stride, false, device),
            bn: BatchNorm2d::new(shape.output, shape.momentum, device),
            relu: shape.relu,
        }
    }

    /// Maps `[B, C_in, H, W]` to `[B, C_out, H/stride, W/stride]`.
    pub fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        self.finish(convolve(&self.conv, x))
    }

    /// Applies convolution and batch normalisation, adds `other`, and applies a ReLU. Only for a unit without a ReLU of its own.
    pub fn forward_added(&self, x: Tensor<4>, other: Tensor<4>) -> Tensor<4> {
        debug_assert!(!self.relu);
        relu(self.forward(x).add(other))
    }

    /// Applies the unit to an upsampled map: `[B, C_in, H, W]` to `[B, C_out, 2H, 2W]`. For 5x5 kernels.
    pub fn forward_up2(&self, x: &Upsampled) -> Tensor<4> {
        self.finish(x.conv5(self.conv.weight.val()))
    }

    fn finish(&self, x: Tensor<4>) -> Tensor<4> {
        self.bn.forward(x, self.relu)
    }
}

/// Makes a square convolution with padding k/2.
pub fn conv(input: usize, output: usize, kernel: usize, stride: usize, bias: bool, device: &Device) -> Conv2d {
    let pad = kernel / 2;
    Conv2dConfig::new([input, output], [kernel, kernel])
        .with_stride([stride, stride])
        .with_padding(PaddingConfig2d::Explicit(pad, pad, pad, pad))
        .with_bias(bias)
        .init(device)
}

/// Applies `conv`, made by [`conv()`], with the operators of [`super::ops`].
pub fn convolve(conv: &Conv2d, x: Tensor<4>) -> Tensor<4> {
    let y = conv2d(x, conv.weight.val(), conv.stride[0], conv.kernel_size[0] / 2);
    match &conv.bias {
        Some(bias) => y.add(bias.val().reshape([1, -1, 1, 1])),
        None => y,
    }
}
