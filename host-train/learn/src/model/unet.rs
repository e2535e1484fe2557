//! A plain U-Net at full resolution, for comparison: what does the paper's network add to an ordinary one with the same inputs?

use super::conv::{conv, convolve};
use super::ops::{conv2d, gelu};
use burn::module::Module;
use burn::nn::PaddingConfig2d;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::tensor::{Device, Tensor};
use elunar_net::config::NetConfig;

/// A 3x3 convolution, then per level a residual block of two; levels are joined by 2x2 convolutions of stride 2 downwards, and 1x1 convolutions of
/// repeated pixels upwards, which are added. No normalisation.
#[derive(Module, Debug)]
pub struct UNet {
    input: Conv2d,
    down: Vec<Vec<Conv2d>>,
    narrower: Vec<Conv2d>,
    wider: Vec<Conv2d>,
    up: Vec<Vec<Conv2d>>,
}

impl UNet {
    /// Builds the network; `None` if the configuration has none. The weights are set later.
    pub fn new(config: &NetConfig, device: &Device) -> Option<Self> {
        let widths = &config.unet;
        let first = *widths.first()?;
        let block =
            |&width: &usize| vec![conv(width, width, 3, 1, true, device), conv(width, width, 3, 1, true, device)];
        let halve = |pair: &[usize]| {
            let shape = Conv2dConfig::new([pair[0], pair[1]], [2, 2]).with_stride([2, 2]);
            shape.with_padding(PaddingConfig2d::Valid).init(device)
        };
        Some(Self {
            input: conv(config.encoder_channels(), first, 3, 1, true, device),
            down: widths.iter().map(block).collect(),
            narrower: widths.windows(2).map(halve).collect(),
            wider: widths.windows(2).map(|pair| conv(pair[1], pair[0], 1, 1, true, device)).collect(),
            up: widths[..widths.len() - 1].iter().map(block).collect(),
        })
    }

    /// Maps `[B, maps, H, W]` to `[B, widths[0], H, W]`. H and W are multiples of two to the number of levels less one.
    pub fn forward(&self, image: Tensor<4>) -> Tensor<4> {
        let mut x = convolve(&self.input, image);
        let mut skips = Vec::new();
        for (level, block) in self.down.iter().enumerate() {
            x = residual(block, x);
            if let Some(narrower) = self.narrower.get(level) {
                skips.push(x.clone());
                let y = conv2d(x, narrower.weight.val(), 2, 0);
                x = match &narrower.bias {
                    Some(bias) => y.add(bias.val().reshape([1, -1, 1, 1])),
                    None => y,
                };
            }
        }
        for ((wider, block), skip) in self.wider.iter().zip(&self.up).rev().zip(skips.into_iter().rev()) {
            x = residual(block, skip.add(repeated(convolve(wider, x))));
        }
        x
    }
}

fn residual(block: &[Conv2d], x: Tensor<4>) -> Tensor<4> {
    let inner = gelu(convolve(&block[0], x.clone()));
    x.add(convolve(&block[1], inner))
}

/// Doubles rows and columns by repeating every pixel.
fn repeated(x: Tensor<4>) -> Tensor<4> {
    let [b, c, h, w] = x.dims();
    x.reshape([b * c, h, 1, w, 1]).expand([b * c, h, 2, w, 2]).reshape([b, c, 2 * h, 2 * w])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::init::initial_weights;
    use crate::model::store::load;
    use crate::testing::without_zeros;
    use burn::tensor::{Distribution, TensorData};
    use elunar_net::config::miniature_network;
    use std::path::Path;

    #[test]
    fn pixels_are_repeated() {
        let device = Device::flex();
        let x = Tensor::<4>::from_data(TensorData::new(vec![1.0f32, 2.0, 3.0, 4.0], [1, 1, 2, 2]), &device);
        let found = repeated(x).into_data().try_to_vec::<f32>().unwrap();
        assert_eq!(found, [1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 3.0, 3.0, 4.0, 4.0]);
    }

    /// Far pixels reach each other through the coarsest level, and an untrained network corrects nothing.
    #[test]
    fn the_network_begins_as_the_guide_and_sees_far() {
        let device = Device::flex();
        let config = NetConfig { unet: vec![4, 6, 8], detail: 0, ..miniature_network() };
        let maps = config.image_maps();
        let image = Tensor::<4>::random([1, maps, 64, 96], Distribution::Normal(0.0, 1.0), &device);
        let coarse = Tensor::<4>::random([1, 1, 64, 96], Distribution::Normal(0.0, 1.0), &device);
        let numbers = |x: Tensor<4>| x.into_data().try_to_vec::<f32>().unwrap();
        let (weights, path) = (initial_weights(&config, 1), Path::new("w"));
        let net = load(&config, &weights, path, &device).unwrap();
        assert_eq!(numbers(net.forward(image.clone(), coarse.clone())), numbers(coarse.clone()));
        let net = load(&config, &without_zeros(weights), path, &device).unwrap();
        let spot = Tensor::<4>::ones([1, maps, 1, 1], &device).mul_scalar(5.0);
        let changed = image.clone().slice_assign([0..1, 0..maps, 32..33, 48..49], spot);
        let (a, b) = (numbers(net.forward(image, coarse.clone())), numbers(net.forward(changed, coarse)));
        assert!((a[32 * 96 + 60] - b[32 * 96 + 60]).abs() > 0.0, "twelve pixels away");
        assert_eq!(a[0], b[0], "beyond the field of view");
    }
}
