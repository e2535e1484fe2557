//! Configuration of the network: every width, depth and switch, with the paper's value or "our choice".

use crate::names::{IlluminationName, TruthRangeName};
use crate::weights::Weights;
use elunar_core::nn::InputRules;
pub use elunar_core::nn::{Illumination, TruthRange};
use elunar_raster::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Output head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Head {
    /// 3x3 convolution and ReLU: absolute normalised elevation (the paper's).
    Relu,
    /// 3x3 convolution whose output is added to the normalised coarse DTM; no ReLU (our choice: training converges in minutes).
    Residual,
}

/// Image encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum ImageEncoderKind {
    /// Swin transformer beside a 7x7 stem (the paper's).
    Swin,
    /// Residual basic blocks (the paper's ablation).
    Resnet,
}

/// Blocks 2 to 5 of the decoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum DecoderKind {
    /// The shortcut reads the previous decoder output only (the paper's).
    Residual,
    /// Up-projection block: the shortcut reads skip and previous output (the paper's ablation).
    Upb,
}

/// Named sizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// The paper's network, 321 M parameters.
    Paper,
    /// Half the width.
    Small,
    /// A quarter of the width.
    Tiny,
    /// An eighth of the width, 2.8 M parameters. A laptop can train it, and a microcontroller can run it.
    Nano,
}

/// Changes to the paper's network, as command-line options.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct Switches {
    /// Output head [default: relu; `train` with tiny or nano: residual].
    #[cfg_attr(feature = "clap", arg(long))]
    pub head: Option<Head>,
    /// Which DTM's range normalises the truth [default: own; `train` with tiny or nano: pixel].
    #[cfg_attr(feature = "clap", arg(long, value_parser = crate::names::truth_range()))]
    pub target_range: Option<TruthRange>,
    /// Share of the coarse relief added below and above the range [default: 0.1 with `reference`, otherwise 0].
    #[cfg_attr(feature = "clap", arg(long))]
    pub range_margin: Option<f32>,
    /// Upper end of the normalised range; 1 is the paper's max-min ablation [default: 50].
    #[cfg_attr(feature = "clap", arg(long))]
    pub nr: Option<f32>,
    /// Image encoder [default: swin].
    #[cfg_attr(feature = "clap", arg(long))]
    pub image_encoder: Option<ImageEncoderKind>,
    /// Decoder blocks [default: residual].
    #[cfg_attr(feature = "clap", arg(long))]
    pub decoder_kind: Option<DecoderKind>,
    /// Light for which the network is trained [default: any; `train` with tiny or nano: given].
    #[cfg_attr(feature = "clap", arg(long, value_parser = crate::names::illumination()))]
    pub illumination: Option<Illumination>,
    /// Share of a batch in the running statistics of batch normalisation [default: 0.1, as in PyTorch; `train` with tiny or
    /// nano: 0.02].
    #[cfg_attr(feature = "clap", arg(long))]
    pub bn_momentum: Option<f64>,
    /// Leave out the coarse-DTM branch (the paper's ablation).
    #[cfg_attr(feature = "clap", arg(long))]
    pub no_coarse: bool,
    /// Channels of the detail stage, at full resolution behind the decoder; 0: none [default: the preset's].
    #[cfg_attr(feature = "clap", arg(long))]
    pub detail: Option<usize>,
    /// Channels inside the residual blocks of the detail stage [default: half of its channels].
    #[cfg_attr(feature = "clap", arg(long))]
    pub detail_inner: Option<usize>,
    /// Residual blocks of the detail stage [default: 1].
    #[cfg_attr(feature = "clap", arg(long))]
    pub detail_blocks: Option<usize>,
    /// Pass the coarse DTM as one more channel of the image instead of a separate branch (as in other published networks with a single
    /// branch).
    #[cfg_attr(feature = "clap", arg(long))]
    pub coarse_channel: bool,
}

/// Blocks per stage of [`ImageEncoderKind::Resnet`], as in the 18-layer network (our choice: the paper does not state the depth of its
/// ablation).
pub const RESNET_BLOCKS: usize = 2;

/// Kernel sides of the coarse-DTM encoder's five units (Fig. 5).
pub const DTM_KERNELS: [usize; 5] = [11, 9, 7, 5, 3];

/// Default of [`NetConfig::range_margin`] with [`TruthRange::Reference`] (our choice). The fine relief exceeds the coarse one by 6 to 10 %,
/// so a tenth on both sides keeps nearly all truth inside [0, NR].
pub const REFERENCE_MARGIN: f32 = 0.1;

impl Switches {
    /// Returns `config` with the given switches set.
    ///
    /// # Errors
    /// [`Error::Usage`] if they contradict each other.
    pub fn apply(&self, mut config: NetConfig) -> Result<NetConfig> {
        config.head = self.head.unwrap_or(config.head);
        if let Some(target_range) = self.target_range {
            config.target_range = target_range;
            config.range_margin = if target_range == TruthRange::Reference { REFERENCE_MARGIN } else { 0.0 };
        }
        config.range_margin = self.range_margin.unwrap_or(config.range_margin);
        config.nr = self.nr.unwrap_or(config.nr);
        config.image_encoder = self.image_encoder.unwrap_or(config.image_encoder);
        config.decoder_kind = self.decoder_kind.unwrap_or(config.decoder_kind);
        config.illumination = self.illumination.unwrap_or(config.illumination);
        config.bn_momentum = self.bn_momentum.unwrap_or(config.bn_momentum);
        if let Some(detail) = self.detail {
            let stage = detail > 0;
            (config.detail, config.detail_inner, config.detail_blocks) = (detail, detail / 2, usize::from(stage));
        }
        config.detail_inner = self.detail_inner.unwrap_or(config.detail_inner);
        config.detail_blocks = self.detail_blocks.unwrap_or(config.detail_blocks);
        config.coarse_channel |= self.coarse_channel;
        config.use_coarse &= !(self.no_coarse || self.coarse_channel);
        config.check().map_err(Error::usage)?;
        Ok(config)
    }
}

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
    #[serde(default = "relu")]
    pub head: Head,
    /// Which DTM's range normalises the truth.
    #[serde(default = "own", with = "TruthRangeName")]
    pub target_range: TruthRange,
    /// With [`TruthRange::Reference`]: the coarse relief is widened by this share below and above (0 with `own`).
    #[serde(default)]
    pub range_margin: f32,
    /// Upper end of the normalised range, NR (Eq. 1): 50 in the paper, 1 for its max–min ablation.
    #[serde(default = "nr")]
    pub nr: f32,
    /// Image encoder.
    #[serde(default = "swin")]
    pub image_encoder: ImageEncoderKind,
    /// Decoder blocks.
    #[serde(default = "residual_decoder")]
    pub decoder_kind: DecoderKind,
    /// Light for which the network is trained.
    #[serde(default = "any", with = "IlluminationName")]
    pub illumination: Illumination,
    /// Share of a batch in the running statistics of batch normalisation. PyTorch's default is 0.1. Only training uses it.
    #[serde(default = "bn_momentum")]
    pub bn_momentum: f64,
    /// Whether the coarse-DTM branch exists (`false`: the paper's ablation).
    #[serde(default = "yes")]
    pub use_coarse: bool,
    /// Whether the coarse DTM is one more channel of the image, divided by NR, instead of a separate branch. Other published networks with
    /// a single branch do so. Not exported.
    #[serde(default)]
    pub coarse_channel: bool,
    /// Channels of the levels of a plain U-Net, which takes the place of the paper's network; empty: none. Not exported.
    #[serde(default)]
    pub unet: Vec<usize>,
    /// Channels of the detail stage; 0: none, as in the paper. The stage works at full resolution, on the image's maps and on the decoder's
    /// last map (our choice: patches of 4 x 4 pixels and a stem of stride 2 lose what the finest waves show).
    #[serde(default)]
    pub detail: usize,
    /// Channels inside the residual blocks of the detail stage.
    #[serde(default)]
    pub detail_inner: usize,
    /// Residual blocks of the detail stage.
    #[serde(default)]
    pub detail_blocks: usize,
}

fn relu() -> Head {
    Head::Relu
}
fn own() -> TruthRange {
    TruthRange::Own
}
fn nr() -> f32 {
    50.0
}
fn swin() -> ImageEncoderKind {
    ImageEncoderKind::Swin
}
fn residual_decoder() -> DecoderKind {
    DecoderKind::Residual
}
fn any() -> Illumination {
    Illumination::Any
}
fn bn_momentum() -> f64 {
    0.1
}
fn yes() -> bool {
    true
}

impl NetConfig {
    /// Returns the reference configuration of a preset, with the paper's switches.
    pub fn preset(preset: Preset) -> Self {
        let (embed, depths, heads, window, stem, dtm, decoder) = match preset {
            Preset::Paper => {
                (192, [2, 2, 18, 2], [6, 12, 24, 48], 7, 64, [32, 64, 128, 256, 512], [768, 384, 192, 96, 48])
            }
            Preset::Small => (96, [2, 2, 6, 2], [3, 6, 12, 24], 7, 32, [16, 32, 64, 128, 256], [384, 192, 96, 48, 32]),
            Preset::Tiny => (48, [2, 2, 4, 2], [2, 4, 8, 16], 8, 16, [8, 16, 32, 64, 128], [192, 96, 48, 24, 16]),
            Preset::Nano => (24, [1, 1, 2, 1], [1, 2, 4, 8], 8, 8, [8, 8, 16, 32, 64], [96, 48, 24, 12, 8]),
        };
        Self {
            embed,
            depths,
            heads,
            window,
            stem,
            dtm,
            decoder,
            head: Head::Relu,
            target_range: TruthRange::Own,
            range_margin: 0.0,
            nr: 50.0,
            image_encoder: ImageEncoderKind::Swin,
            decoder_kind: DecoderKind::Residual,
            illumination: Illumination::Any,
            bn_momentum: 0.1,
            use_coarse: true,
            coarse_channel: false,
            unet: Vec::new(),
            detail: 0,
            detail_inner: 0,
            detail_blocks: 0,
        }
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
        if self.target_range == TruthRange::Pixel && self.head == Head::Relu {
            return Err("configuration: heights in pixels fall below 0: expected head = residual".into());
        }
        if self.coarse_channel && self.use_coarse {
            return Err(
                "configuration: a coarse DTM among the image's channels has no branch: expected use_coarse = false"
                    .into(),
            );
        }
        if self.head == Head::Residual && !self.use_coarse && !self.coarse_channel {
            return Err("configuration: a residual head corrects the coarse DTM: expected use_coarse = true".into());
        }
        Ok(())
    }
}

/// Reads the configuration stored beside the weights.
///
/// # Errors
/// [`Error::Broken`] if it is missing or malformed.
pub fn config_of(weights: &Weights, path: &Path) -> Result<NetConfig> {
    let text = weights
        .metadata
        .get("config")
        .ok_or_else(|| Error::broken(path, "expected the network configuration in metadata `config`, found none"))?;
    let config: NetConfig =
        serde_json::from_str(text).map_err(|e| Error::broken(path, format!("metadata `config`: {e}")))?;
    config.check().map_err(|what| Error::broken(path, what))?;
    Ok(config)
}

/// Returns the network that a preset trains by default: the paper's for `paper` and `small`. For `tiny` and `nano`, slopes are inputs,
/// corrections of the coarse DTM are the output, and a stage at full resolution follows the decoder (our choices).
pub fn trained_network(preset: Preset) -> NetConfig {
    let config = NetConfig::preset(preset);
    match preset {
        Preset::Paper | Preset::Small => config,
        Preset::Tiny | Preset::Nano => NetConfig {
            head: Head::Residual,
            target_range: TruthRange::Pixel,
            illumination: Illumination::Sloped,
            detail: 16,
            detail_inner: 8,
            detail_blocks: 1,
            // Batches are small and their tiles differ much. At 0.1, running statistics and validation results vary strongly.
            bn_momentum: 0.02,
            ..config
        },
    }
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
    fn a_detail_stage_has_a_block_of_half_its_channels_unless_stated() {
        let of = |switches: Switches| switches.apply(trained_network(Preset::Nano)).map_err(|e| e.to_string());
        let shape = |c: NetConfig| [c.detail, c.detail_inner, c.detail_blocks, c.head_channels()];
        let detail = |detail| Switches { detail: Some(detail), ..Switches::default() };
        assert_eq!(of(Switches::default()).map(shape), Ok([16, 8, 1, 16]));
        assert_eq!(of(detail(0)).map(shape), Ok([0, 0, 0, 8]));
        assert_eq!(of(detail(16)).map(shape), Ok([16, 8, 1, 16]));
        let stated = Switches { detail_inner: Some(5), detail_blocks: Some(3), ..detail(12) };
        assert_eq!(of(stated).map(shape), Ok([12, 5, 3, 12]));
        assert!(of(Switches { detail_inner: Some(0), ..detail(4) }).unwrap_err().contains("detail_inner > 0"));
        assert!(of(detail(5000)).unwrap_err().contains("0..=1024"));
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
