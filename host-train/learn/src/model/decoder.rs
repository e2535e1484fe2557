//! Decoder blocks (Fig. 6): upsample by two, refine, add a shortcut.

use super::conv::{ConvBn, ConvBnShape};
use super::ops::Upsampled;
use burn::module::Module;
use burn::tensor::{Device, Tensor};
use elunar_net::config::{DecoderKind, NetConfig};

/// Main path: concat(E, D), up2, 5x5 conv-BN-ReLU, 3x3 conv-BN. Shortcut: D (with `upb`: concat(E, D)), up2, 5x5 conv-BN. Then sum and
/// ReLU.
#[derive(Module, Debug)]
pub struct DecoderBlock {
    main: Vec<ConvBn>,
    shortcut: ConvBn,
    upb: bool,
}

impl DecoderBlock {
    fn new([previous, skip, output]: [usize; 3], config: &NetConfig, device: &Device) -> Self {
        let (upb, momentum) = (config.decoder_kind == DecoderKind::Upb, config.bn_momentum);
        let all = skip + previous;
        let unit =
            |input, kernel, relu| ConvBn::new(ConvBnShape { input, output, kernel, stride: 1, relu, momentum }, device);
        Self {
            main: vec![unit(all, 5, true), unit(output, 3, false)],
            shortcut: unit(if upb { all } else { previous }, 5, false),
            upb,
        }
    }

    /// Maps `d` `[B, C, h, w]` and the skip map `e` of the same size to `[B, C_out, 2h, 2w]`.
    pub fn forward(&self, d: Tensor<4>, e: Option<Tensor<4>>) -> Tensor<4> {
        let all = Upsampled::new(match e {
            Some(e) => Tensor::cat(vec![e, d.clone()], 1),
            None => d.clone(),
        });
        let short = self.shortcut.forward_up2(&if self.upb { all.clone() } else { all.last_channels(d) });
        self.main[1].forward_added(self.main[0].forward_up2(&all), short)
    }
}

/// Makes the five blocks of a network.
pub fn decoder(config: &NetConfig, device: &Device) -> Vec<DecoderBlock> {
    let c = config.embed;
    let previous = [8 * c, config.decoder[0], config.decoder[1], config.decoder[2], config.decoder[3]];
    let skip = [0, 4 * c, 2 * c, c, config.stem];
    (0..5).map(|i| DecoderBlock::new([previous[i], skip[i], config.decoder[i]], config, device)).collect()
}
