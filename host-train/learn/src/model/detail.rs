//! The detail stage: convolutions at full resolution, behind the decoder (our choice; the paper has none).

use super::conv::{conv, convolve};
use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};
use elunar_net::config::NetConfig;

/// A 3x3 convolution of the decoder's last map and the image's maps, then residual blocks of two. Each ends with a ReLU. They have biases and
/// no batch normalisation, whose statistics differ from batch to batch: nothing smooths them behind this stage.
#[derive(Module, Debug)]
pub struct Detail {
    join: Conv2d,
    blocks: Vec<Vec<Conv2d>>,
}

impl Detail {
    /// Builds the stage; `None` if the network has none. The weights are set later.
    pub fn new(config: &NetConfig, device: &Device) -> Option<Self> {
        let (channels, inner) = (config.detail, config.detail_inner);
        let unit = |input, output| conv(input, output, 3, 1, true, device);
        (channels > 0).then(|| Self {
            join: unit(config.decoder[4] + config.encoder_channels(), channels),
            blocks: (0..config.detail_blocks).map(|_| vec![unit(channels, inner), unit(inner, channels)]).collect(),
        })
    }

    /// Maps the image's maps `[B, maps, H, W]` and the decoder's last map `[B, C, H, W]` to `[B, detail, H, W]`.
    pub fn forward(&self, image: Tensor<4>, d: Tensor<4>) -> Tensor<4> {
        let joined = relu(convolve(&self.join, Tensor::cat(vec![d, image], 1)));
        let block = |x: Tensor<4>, units: &Vec<Conv2d>| {
            units.iter().enumerate().fold(x.clone(), |y, (i, unit)| {
                let y = convolve(unit, y);
                relu(if i == 0 { y } else { y.add(x.clone()) })
            })
        };
        self.blocks.iter().fold(joined, block)
    }
}

#[cfg(test)]
mod tests {
    use crate::model::init::initial_weights;
    use crate::model::store::load;
    use crate::testing::without_zeros;
    use crate::train::feed::side_by_side;
    use burn::tensor::Device;
    use elunar_net::config::{Illumination, NetConfig, miniature_network};
    use elunar_net::export::{build::build, float};
    use std::path::Path;

    /// The exporter computes the stage on its own.
    #[test]
    fn the_network_with_a_detail_stage_is_the_exporters_graph() {
        let config = NetConfig {
            illumination: Illumination::Sloped,
            detail: 5,
            detail_inner: 3,
            detail_blocks: 2,
            ..miniature_network()
        };
        let weights = without_zeros(initial_weights(&config, 4));
        let (path, device, [rows, cols]) = (Path::new("w.safetensors"), Device::flex(), [64, 96]);
        let wave = |i: usize| (0.37 * i as f32).sin() + (0.011 * i as f32).cos();
        let image: Vec<f32> = (0..8 * rows * cols).map(wave).collect();
        let coarse: Vec<f32> = (0..rows * cols).map(|i| 3.0 * wave(7 * i)).collect();
        let graph = build(&config, &weights, path, (rows, cols)).unwrap();
        let expected = float::run(&graph, &image, &coarse).pop().unwrap();
        let net = load(&config, &weights, path, &device).unwrap();
        let tensor = |map: &[f32]| side_by_side(map.to_vec(), [1, rows, cols], &device);
        let found = net.forward(tensor(&image), tensor(&coarse)).into_data().try_to_vec::<f32>().unwrap();
        let apart = expected.iter().zip(&found).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart < 1e-3, "{apart}");
        assert!(expected.iter().zip(&coarse).any(|(z, c)| (z - c).abs() > 0.1), "the network does something");
    }
}
