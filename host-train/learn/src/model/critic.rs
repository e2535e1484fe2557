//! A patch critic. It scores how much each part of a DTM resembles the truth, given image and coarse DTM (Isola et al. 2017). Adversarial
//! training uses it; it is not part of any network that predicts.

use super::conv::{conv, convolve};
use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::activation::leaky_relu;
use burn::tensor::{Device, Tensor};

/// Number of halvings before the score. A patch depends on 31 x 31 pixels (our choice: small craters, not whole scenes).
const HALVINGS: usize = 3;

/// Slope of the leaky ReLU.
const LEAK: f64 = 0.2;

/// Three halving convolutions, then a score per patch.
#[derive(Module, Debug)]
pub struct Critic {
    stages: Vec<Conv2d>,
    score: Conv2d,
}

impl Critic {
    /// Makes a critic of `maps` input maps, with `width` channels after the first halving and twice as many after each further one.
    pub fn new(maps: usize, width: usize, device: &Device) -> Self {
        let channels = |stage: usize| if stage == 0 { maps } else { width << (stage - 1) };
        Self {
            stages: (0..HALVINGS).map(|i| conv(channels(i), channels(i + 1), 3, 2, true, device)).collect(),
            score: conv(channels(HALVINGS), 1, 3, 1, true, device),
        }
    }

    /// Maps `[B, maps, H, W]` to `[B, 1, H/8, W/8]`: 1 for a patch that resembles the truth, 0 for one that resembles a prediction.
    pub fn forward(&self, maps: Tensor<4>) -> Tensor<4> {
        let x = self.stages.iter().fold(maps, |x, stage| leaky_relu(convolve(stage, x), LEAK));
        convolve(&self.score, x)
    }
}
