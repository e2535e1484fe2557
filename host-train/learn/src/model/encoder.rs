//! The two encoders: image (Fig. 4) and coarse DTM (Fig. 5).

use super::conv::{ConvBn, ConvBnShape};
use super::resnet::ResNet;
use super::swin::Swin;
use super::swin::depth::BlockFactors;
use burn::module::Module;
use burn::tensor::{Device, Tensor};
use elunar_net::config::{DTM_KERNELS, ImageEncoderKind, NetConfig};

/// Image encoder: a 7x7 stem for E1 and, beside it, the Swin transformer for E2..E5 (or residual stages after the stem).
#[derive(Module, Debug)]
pub struct ImageEncoder {
    stem: ConvBn,
    swin: Option<Swin>,
    resnet: Option<ResNet>,
}

impl ImageEncoder {
    /// Builds the encoder. The weights are set later.
    pub fn new(config: &NetConfig, device: &Device) -> Self {
        let swin = config.image_encoder == ImageEncoderKind::Swin;
        let momentum = config.bn_momentum;
        Self {
            stem: ConvBn::new(
                ConvBnShape {
                    input: config.encoder_channels(),
                    output: config.stem,
                    kernel: 7,
                    stride: 2,
                    relu: true,
                    momentum,
                },
                device,
            ),
            swin: swin.then(|| Swin::new(config, device)),
            resnet: (!swin).then(|| ResNet::new(config, device)),
        }
    }

    /// Maps `[B, channels, H, W]` in [0, 1] to E1..E5 at 1/2 to 1/32 resolution. `factors` are those of the Swin transformer's stochastic depth.
    pub fn forward(&self, image: Tensor<4>, factors: Option<&[BlockFactors]>) -> [Tensor<4>; 5] {
        let e1 = self.stem.forward(image.clone());
        let [e2, e3, e4, e5] = match (&self.swin, &self.resnet) {
            (Some(swin), _) => swin.forward(image, factors),
            (None, Some(resnet)) => resnet.forward(e1.clone()),
            (None, None) => unreachable!("the constructor builds one of the two"),
        };
        [e1, e2, e3, e4, e5]
    }
}

/// Makes the coarse-DTM encoder: five stride-2 units with decreasing kernels, `[B, 1, H, W]` to `[B, dtm[4], H/32, W/32]`.
pub fn dtm_encoder(config: &NetConfig, device: &Device) -> Vec<ConvBn> {
    let input = |i: usize| if i == 0 { 1 } else { config.dtm[i - 1] };
    DTM_KERNELS
        .iter()
        .enumerate()
        .map(|(i, &kernel)| {
            let shape = ConvBnShape {
                input: input(i),
                output: config.dtm[i],
                kernel,
                stride: 2,
                relu: true,
                momentum: config.bn_momentum,
            };
            ConvBn::new(shape, device)
        })
        .collect()
}
