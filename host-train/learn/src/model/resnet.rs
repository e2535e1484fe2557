//! Residual image encoder, the paper's ablation instead of Swin.

use super::conv::{ConvBn, ConvBnShape};
use burn::module::Module;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};
use elunar_net::config::{NetConfig, RESNET_BLOCKS};

/// Basic residual block: two 3x3 convolutions and a shortcut (1x1 if the shape changes).
#[derive(Module, Debug)]
pub struct BasicBlock {
    conv1: ConvBn,
    conv2: ConvBn,
    shortcut: Option<ConvBn>,
}

impl BasicBlock {
    fn new(input: usize, output: usize, stride: usize, momentum: f64, device: &Device) -> Self {
        let shape = |input, kernel, stride, relu| ConvBnShape { input, output, kernel, stride, relu, momentum };
        let same = input == output && stride == 1;
        Self {
            conv1: ConvBn::new(shape(input, 3, stride, true), device),
            conv2: ConvBn::new(shape(output, 3, 1, false), device),
            shortcut: (!same).then(|| ConvBn::new(shape(input, 1, stride, false), device)),
        }
    }

    fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let main = self.conv2.forward(self.conv1.forward(x.clone()));
        let short = match &self.shortcut {
            Some(conv) => conv.forward(x),
            None => x,
        };
        relu(main.add(short))
    }
}

/// Four stages of [`RESNET_BLOCKS`] basic blocks after the stem. Each halves the resolution; widths are those of the Swin stages.
#[derive(Module, Debug)]
pub struct ResNet {
    stages: Vec<Vec<BasicBlock>>,
}

impl ResNet {
    /// Builds the encoder. The weights are set later.
    pub fn new(config: &NetConfig, device: &Device) -> Self {
        let mut input = config.stem;
        let stages = (0..4)
            .map(|i| {
                let output = config.embed << i;
                let blocks = (0..RESNET_BLOCKS)
                    .map(|j| {
                        let (from, stride) = if j == 0 { (input, 2) } else { (output, 1) };
                        BasicBlock::new(from, output, stride, config.bn_momentum, device)
                    })
                    .collect();
                input = output;
                blocks
            })
            .collect();
        Self { stages }
    }

    /// Maps E1 `[B, stem, H/2, W/2]` to E2..E5, with the shapes of [`super::swin::Swin::forward`].
    pub fn forward(&self, e1: Tensor<4>) -> [Tensor<4>; 4] {
        let mut x = e1;
        std::array::from_fn(|i| {
            x = self.stages[i].iter().fold(x.clone(), |x, block| block.forward(x));
            x.clone()
        })
    }
}
