//! Configuration of the network: every width, depth and switch, with the paper's value or "our choice".

use crate::names::{IlluminationName, TruthRangeName};
pub use crate::preset::Preset;
use crate::preset::overlaid;
use crate::weights::NetWeights;
use elunar_base::{Error, Result};
use elunar_core::nn::InputRules;
pub use elunar_core::nn::{Illumination, TruthRange};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Output head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OutputHead {
    /// 3x3 convolution and ReLU: absolute normalised elevation (the paper's).
    Relu,
    /// 3x3 convolution whose output is added to the normalised coarse DTM; no ReLU (our choice: training converges in minutes).
    Residual,
}

/// Image encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ImageEncoderKind {
    /// Swin transformer beside a 7x7 stem (the paper's).
    Swin,
    /// Residual basic blocks (the paper's ablation).
    Resnet,
}

/// Blocks 2 to 5 of the decoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DecoderKind {
    /// The shortcut reads the previous decoder output only (the paper's).
    Residual,
    /// Up-projection block: the shortcut reads skip and previous output (the paper's ablation).
    Upb,
}

/// Blocks per stage of [`ImageEncoderKind::Resnet`], as in the 18-layer network (our choice: the paper does not state the depth of its
/// ablation).
pub const RESNET_BLOCKS: usize = 2;

/// Kernel sides of the coarse-DTM encoder's five units (Fig. 5).
pub const DTM_KERNELS: [usize; 5] = [11, 9, 7, 5, 3];

/// The configuration of a network. The first seven fields have the reference implementation's names.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NetConfig {
    /// Swin channels C after patch embedding; stage i has `embed << i`.
    pub embed: usize,
    /// Swin blocks per stage.
    pub depths: [usize; 4],
    /// Attention heads per stage.
    pub heads: [usize; 4],
    /// Window side, tokens.
    pub window: usize,
    /// Channels of the 7x7 stem.
    pub stem: usize,
    /// Channels of the five coarse-DTM convolutions.
    pub dtm: [usize; 5],
    /// Output channels of the five decoder blocks.
    pub decoder: [usize; 5],
    /// Output head.
    pub head: OutputHead,
    /// Which DTM's range normalises the truth.
    #[serde(with = "TruthRangeName")]
    pub target_range: TruthRange,
    /// With [`TruthRange::Reference`]: the coarse relief is widened by this share below and above (0 with `own`).
    pub range_margin: f32,
    /// Upper end of the normalised range, NR (Eq. 1): 50 in the paper, 1 for its max–min ablation.
    pub nr: f32,
    /// Image encoder.
    pub image_encoder: ImageEncoderKind,
    /// Decoder blocks.
    pub decoder_kind: DecoderKind,
    /// Light for which the network is trained.
    #[serde(with = "IlluminationName")]
    pub illumination: Illumination,
    /// Share of a batch in the running statistics of batch normalisation. PyTorch's default is 0.1. Only training uses it.
    pub bn_momentum: f64,
    /// Whether the coarse-DTM branch exists (`false`: the paper's ablation).
    pub use_coarse: bool,
    /// Whether the coarse DTM is one more channel of the image, divided by NR, instead of a separate branch. Other published networks with
    /// a single branch do so. Not exported.
    pub coarse_channel: bool,
    /// Channels of the levels of a plain U-Net, which takes the place of the paper's network; empty: none. Not exported.
    pub unet: Vec<usize>,
    /// Channels of the detail stage; 0: none, as in the paper. The stage works at full resolution, on the image's maps and on the decoder's
    /// last map (our choice: patches of 4 x 4 pixels and a stem of stride 2 lose what the finest waves show).
    pub detail: usize,
    /// Channels inside the residual blocks of the detail stage.
    pub detail_inner: usize,
    /// Residual blocks of the detail stage.
    pub detail_blocks: usize,
}

impl NetConfig {
    /// Returns the paper's network at the width of a preset.
    pub fn preset(preset: Preset) -> Self {
        let Self { embed, depths, heads, window, stem, dtm, decoder, .. } = trained_network(preset);
        Self { embed, depths, heads, window, stem, dtm, decoder, ..trained_network(Preset::Paper) }
    }

    /// Returns the number of channels that the head reads.
    pub fn head_channels(&self) -> usize {
        match self.unet.first() {
            Some(&width) => width,
            None if self.detail > 0 => self.detail,
            None => self.decoder[4],
        }
    }

    /// Returns the number of the image's maps: 1 for brightness, 4 for a guide, 8 for one with slopes.
    pub fn image_maps(&self) -> usize {
        self.illumination.image_maps()
    }

    /// Returns the rules by which tiles are normalised, in the form of `core`.
    pub fn input_rules(&self) -> InputRules {
        let Self { nr, range_margin, target_range: truth_range, illumination, .. } = *self;
        InputRules { nr, range_margin, truth_range, illumination }
    }

    /// Returns the number of channels that the image encoder reads.
    pub fn encoder_channels(&self) -> usize {
        self.image_maps() + usize::from(self.coarse_channel)
    }

    /// Returns the largest magnitude of a normalised coarse height that the runner must represent.
    pub fn coarse_limit(&self) -> f32 {
        match self.target_range {
            // A tile of 320 pixels, relative to its mean. A slope of 45 degrees from end to end stays inside.
            TruthRange::Pixel => 4.0 * self.nr,
            // Slightly beyond [0, NR] on both sides, so that rounding does not clamp.
            _ => 1.02 * self.nr,
        }
    }

    /// Checks that a network can be built: positive widths, divisible heads, and switches that do not contradict each other.
    ///
    /// # Errors
    /// One line with the first field that is wrong, what was expected and what was found.
    pub fn check(&self) -> std::result::Result<(), String> {
        let sizes = [self.embed, self.window, self.stem].into_iter().chain(self.depths).chain(self.heads);
        let sizes = sizes.chain(self.dtm).chain(self.decoder);
        if sizes.clone().any(|n| n == 0 || n > 1 << 14) {
            return Err("configuration: expected every width, depth and window in 1..=16384".into());
        }
        for (i, heads) in self.heads.iter().enumerate() {
            let dim = self.embed << i;
            if !dim.is_multiple_of(*heads) {
                return Err(format!(
                    "configuration: stage {i}: expected heads to divide {dim} channels, found {heads}"
                ));
            }
        }
        if self.unet.len() > 6 || self.unet.iter().any(|n| !(1..=1 << 10).contains(n)) {
            return Err(format!(
                "configuration: expected unet with at most 6 widths in 1..=1024, found {:?}",
                self.unet
            ));
        }
        let whole = self.use_coarse && self.detail == 0 && !self.coarse_channel;
        if !self.unet.is_empty() && !whole {
            return Err("configuration: a U-Net replaces all branches: expected neither detail nor coarse_channel nor use_coarse = false".into());
        }
        let Self { detail, detail_inner, detail_blocks, .. } = *self;
        if detail > 1 << 10 || detail_inner > 1 << 10 || detail_blocks > 64 {
            return Err(format!(
                "configuration: expected detail and detail_inner in 0..=1024 and detail_blocks in 0..=64, found {detail}, {detail_inner} and \
                 {detail_blocks}"
            ));
        }
        if detail > 0 && detail_blocks > 0 && detail_inner == 0 {
            return Err("configuration: expected detail_inner > 0 in a detail stage with blocks, found 0".into());
        }
        if !(self.nr.is_finite() && self.nr > 0.0) {
            return Err(format!("configuration: expected nr > 0, found {}", self.nr));
        }
        if !(0.0..=10.0).contains(&self.range_margin) {
            return Err(format!("configuration: expected range_margin in 0..=10, found {}", self.range_margin));
        }
        if !(0.0..=1.0).contains(&self.bn_momentum) {
            return Err(format!("configuration: expected bn_momentum in 0..=1, found {}", self.bn_momentum));
        }
        if self.target_range == TruthRange::Pixel && self.head == OutputHead::Relu {
            return Err("configuration: heights in pixels fall below 0: expected head = residual".into());
        }
        if self.coarse_channel && self.use_coarse {
            return Err(
                "configuration: a coarse DTM among the image's channels has no branch: expected use_coarse = false"
                    .into(),
            );
        }
        if self.head == OutputHead::Residual && !self.use_coarse && !self.coarse_channel {
            return Err("configuration: a residual head corrects the coarse DTM: expected use_coarse = true".into());
        }
        Ok(())
    }
}

/// Reads the configuration stored beside the weights.
///
/// # Errors
/// [`Error::Broken`] if it is missing or malformed.
pub fn config_of(weights: &NetWeights, path: &Path) -> Result<NetConfig> {
    let text = weights
        .metadata
        .get("config")
        .ok_or_else(|| Error::broken(path, "expected the network configuration in metadata `config`, found none"))?;
    let wrong = |e: serde_json::Error| Error::broken(path, format!("metadata `config`: {e}"));
    // What older files do not state is the paper's.
    let stated = overlaid(Preset::Paper.table("network"), serde_json::from_str(text).map_err(wrong)?);
    let config: NetConfig = serde_json::from_value(stated).map_err(wrong)?;
    config.check().map_err(|what| Error::broken(path, what))?;
    Ok(config)
}

/// Returns the network of a preset's document.
pub fn trained_network(preset: Preset) -> NetConfig {
    preset.table("network")
}

/// Returns a network that is small enough to train in a test, with every part of the shipped networks.
pub fn miniature_network() -> NetConfig {
    NetConfig {
        embed: 8,
        depths: [1, 2, 1, 1],
        heads: [1, 1, 2, 2],
        window: 4,
        stem: 4,
        dtm: [4, 4, 4, 4, 8],
        decoder: [8, 8, 8, 4, 4],
        detail: 6,
        detail_inner: 3,
        ..trained_network(Preset::Nano)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_detail_stage_has_channels_inside_its_blocks() {
        let nano = trained_network(Preset::Nano);
        assert_eq!((nano.check(), nano.head_channels()), (Ok(()), 16));
        let none = NetConfig { detail: 0, ..nano.clone() };
        assert_eq!((none.check(), none.head_channels()), (Ok(()), 8));
        assert!(NetConfig { detail_inner: 0, ..nano.clone() }.check().unwrap_err().contains("detail_inner > 0"));
        assert!(NetConfig { detail: 5000, ..nano }.check().unwrap_err().contains("0..=1024"));
    }

    #[test]
    fn a_file_that_states_less_has_the_rest_of_the_paper() {
        let text = r#"{"embed": 24, "heads": [1, 2, 4, 8], "window": 8, "detail": 4, "detail_inner": 2}"#;
        let weights = NetWeights { metadata: [("config".into(), text.into())].into(), ..NetWeights::default() };
        let found = config_of(&weights, Path::new("w")).unwrap();
        let paper = trained_network(Preset::Paper);
        let expected = NetConfig { embed: 24, heads: [1, 2, 4, 8], window: 8, detail: 4, detail_inner: 2, ..paper };
        assert_eq!(found, expected);
    }

    #[test]
    fn a_u_net_stands_alone() {
        let with = |unet: &[usize]| NetConfig { unet: unet.to_vec(), detail: 0, ..trained_network(Preset::Nano) };
        assert_eq!((with(&[16, 32]).check(), with(&[16, 32]).head_channels()), (Ok(()), 16));
        assert!(with(&[0]).check().unwrap_err().contains("widths"));
        let both = NetConfig { detail: 8, detail_inner: 4, ..with(&[16]) };
        assert!(both.check().unwrap_err().contains("U-Net"));
    }
}
