//! The whole network (Fig. 2).

use super::cast::cast;
use super::conv::{ConvBn, ConvBnShape, conv, convolve};
use super::decoder::{DecoderBlock, decoder};
use super::detail::Detail;
use super::encoder::{ImageEncoder, dtm_encoder};
use super::swin::depth::BlockFactors;
use super::unet::UNet;
use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::activation::relu;
use burn::tensor::{DType, Device, Tensor};
use elunar_net::config::{NetConfig, OutputHead};

/// ELunarDTMNet: from image and coarse DTM to a DTM at the image's resolution.
#[derive(Module, Debug)]
pub struct ELunarDtmNet {
    image_encoder: Option<ImageEncoder>,
    dtm_encoder: Vec<ConvBn>,
    fusion: Option<ConvBn>,
    decoder: Vec<DecoderBlock>,
    detail: Option<Detail>,
    unet: Option<UNet>,
    head: Conv2d,
    residual: bool,
    /// Factor that brings the coarse DTM to [0, 1], if it is among the image's channels.
    channel_scale: Option<f64>,
}

/// Feature maps by the names the golden files use: `e1`..`e5`, `s5`, `fused`, `d1`..`d5`.
pub type Trace = Vec<(String, Tensor<4>)>;

impl ELunarDtmNet {
    /// Builds the network on `device`. Weights come from [`super::init`] or a file.
    pub fn new(config: &NetConfig, device: &Device) -> Self {
        let unet = UNet::new(config, device);
        let paper = unet.is_none();
        Self {
            image_encoder: paper.then(|| ImageEncoder::new(config, device)),
            dtm_encoder: if paper && config.use_coarse { dtm_encoder(config, device) } else { Vec::new() },
            fusion: paper.then(|| fusion(config, device)),
            decoder: if paper { decoder(config, device) } else { Vec::new() },
            detail: Detail::new(config, device),
            unet,
            head: conv(config.head_channels(), 1, 3, 1, true, device),
            residual: config.head == OutputHead::Residual,
            channel_scale: config.coarse_channel.then(|| 1.0 / f64::from(config.nr)),
        }
    }

    /// Maps `image` `[B, 1, H, W]` in [0, 1] and `coarse` `[B, 1, H, W]` in [0, NR] to normalised elevation `[B, 1, H, W]`. H and W are
    /// multiples of 32.
    pub fn forward(&self, image: Tensor<4>, coarse: Tensor<4>) -> Tensor<4> {
        self.run(image, coarse, None, None)
    }

    /// Runs the network as [`Self::forward`] in training, with the factors of stochastic depth ([`super::swin::depth::factors`]), if there are
    /// any.
    pub fn forward_in_training(
        &self,
        image: Tensor<4>,
        coarse: Tensor<4>,
        factors: Option<&[BlockFactors]>,
    ) -> Tensor<4> {
        self.run(image, coarse, factors, None)
    }

    /// Runs the network as [`Self::forward`], and also returns the feature maps.
    pub fn forward_traced(&self, image: Tensor<4>, coarse: Tensor<4>) -> (Tensor<4>, Trace) {
        let mut trace = Trace::new();
        let output = self.run(image, coarse, None, Some(&mut trace));
        (output, trace)
    }

    fn run(
        &self,
        image: Tensor<4>,
        coarse: Tensor<4>,
        factors: Option<&[BlockFactors]>,
        trace: Option<&mut Trace>,
    ) -> Tensor<4> {
        let image = match self.channel_scale {
            Some(scale) => Tensor::cat(vec![image, coarse.clone().mul_scalar(scale)], 1),
            None => image,
        };
        // Maps have the precision of the weights.
        let dtype = self.head.weight.val().dtype();
        let image = cast(image, dtype);
        let mut d = match (&self.unet, &self.image_encoder, &self.fusion) {
            (Some(unet), ..) => unet.forward(image.clone()),
            (None, Some(encoder), Some(fusion)) => {
                let e = encoder.forward(image.clone(), factors);
                self.decoded(e, cast(coarse.clone(), dtype), fusion, trace)
            }
            _ => unreachable!("the constructor builds one of the two"),
        };
        if let Some(detail) = &self.detail {
            d = detail.forward(image, d);
        }
        let z = cast(convolve(&self.head, d), DType::F32);
        if self.residual { z.add(coarse) } else { relu(z) }
    }

    /// Encodes the coarse DTM, and decodes both encoders' maps.
    fn decoded(
        &self,
        e: [Tensor<4>; 5],
        coarse: Tensor<4>,
        fusion: &ConvBn,
        mut trace: Option<&mut Trace>,
    ) -> Tensor<4> {
        let mut note = |name: String, map: &Tensor<4>| {
            if let Some(trace) = trace.as_mut() {
                trace.push((name, map.clone()));
            }
        };
        e.iter().enumerate().for_each(|(i, map)| note(format!("e{}", i + 1), map));
        let mut deepest = vec![e[4].clone()];
        if !self.dtm_encoder.is_empty() {
            let s5 = self.dtm_encoder.iter().fold(coarse, |x, unit| unit.forward(x));
            note("s5".into(), &s5);
            deepest.push(s5);
        }
        // Eq. 3: concatenation, 3x3 convolution, batch norm, no ReLU.
        let mut d = fusion.forward(Tensor::cat(deepest, 1));
        note("fused".into(), &d);
        for (u, block) in self.decoder.iter().enumerate() {
            d = block.forward(d, (u > 0).then(|| e[4 - u].clone()));
            note(format!("d{}", u + 1), &d);
        }
        d
    }
}

/// Makes the fusion unit: 3x3 convolution and batch norm, no ReLU (Eq. 3).
fn fusion(config: &NetConfig, device: &Device) -> ConvBn {
    let (c5, s5) = (8 * config.embed, if config.use_coarse { config.dtm[4] } else { 0 });
    let momentum = config.bn_momentum;
    ConvBn::new(ConvBnShape { input: c5 + s5, output: c5, kernel: 3, stride: 1, relu: false, momentum }, device)
}
