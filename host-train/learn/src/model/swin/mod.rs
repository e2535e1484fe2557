//! Swin transformer encoder (Sec. III-B) with timm's parameter names, so that published checkpoints can be loaded by prefix.

pub mod attention;
pub mod block;
pub mod depth;
pub mod windows;

use self::block::Block;
use self::depth::BlockFactors;
use super::norm::layer_norm;
use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{LayerNorm, LayerNormConfig, Linear, LinearConfig};
use burn::tensor::{Device, Tensor};
use elunar_net::config::NetConfig;

/// Makes tokens from 4x4 patches.
#[derive(Module, Debug)]
pub struct PatchEmbed {
    proj: Conv2d,
    norm: LayerNorm,
}

/// Merges 2x2 tokens into one with twice the channels, in the order x00, x10, x01, x11 (row, column).
#[derive(Module, Debug)]
pub struct PatchMerging {
    norm: LayerNorm,
    reduction: Linear,
}

impl PatchMerging {
    fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let [b, h, w, c] = x.dims();
        let x: Tensor<6> = x.reshape([b, h / 2, 2, w / 2, 2, c]);
        let x: Tensor<4> = x.permute([0, 1, 3, 4, 2, 5]).reshape([b, h / 2, w / 2, 4 * c]);
        self.reduction.forward(layer_norm(&self.norm, x))
    }
}

/// Blocks at one resolution, after a patch merging (in all stages but the first).
#[derive(Module, Debug)]
pub struct Stage {
    downsample: Option<PatchMerging>,
    blocks: Vec<Block>,
}

/// The four stages, each with a layer norm on its output.
#[derive(Module, Debug)]
pub struct Swin {
    patch_embed: PatchEmbed,
    layers: Vec<Stage>,
    norm0: LayerNorm,
    norm1: LayerNorm,
    norm2: LayerNorm,
    norm3: LayerNorm,
}

impl Swin {
    /// Builds the encoder. The weights are set later.
    pub fn new(config: &NetConfig, device: &Device) -> Self {
        let embed = config.embed;
        let norm = |i: usize| LayerNormConfig::new(embed << i).init(device);
        let layers = (0..4).map(|i| Stage::new(config, i, device)).collect();
        let patch_embed = PatchEmbed {
            proj: Conv2dConfig::new([config.encoder_channels(), embed], [4, 4]).with_stride([4, 4]).init(device),
            norm: LayerNormConfig::new(embed).init(device),
        };
        Self { patch_embed, layers, norm0: norm(0), norm1: norm(1), norm2: norm(2), norm3: norm(3) }
    }

    /// Maps `[B, maps, H, W]` ([`NetConfig::image_maps`]) to E2..E5: `[B, C << i, H / (4 << i), W / (4 << i)]`. `factors` of every block are
    /// those of stochastic depth ([`depth::factors`]).
    pub fn forward(&self, image: Tensor<4>, factors: Option<&[BlockFactors]>) -> [Tensor<4>; 4] {
        let tokens = self.patch_embed.proj.forward(image).permute([0, 2, 3, 1]);
        let mut x = layer_norm(&self.patch_embed.norm, tokens);
        let norms = [&self.norm0, &self.norm1, &self.norm2, &self.norm3];
        let mut first = 0;
        std::array::from_fn(|i| {
            let stage = &self.layers[i];
            let own = first..first + stage.blocks.len();
            first = own.end;
            x = stage.forward(x.clone(), factors.map(|all| &all[own]));
            layer_norm(norms[i], x.clone()).permute([0, 3, 1, 2])
        })
    }
}

impl Stage {
    fn new(config: &NetConfig, i: usize, device: &Device) -> Self {
        let dim = config.embed << i;
        let downsample = (i > 0).then(|| PatchMerging {
            norm: LayerNormConfig::new(2 * dim).init(device),
            reduction: LinearConfig::new(2 * dim, dim).with_bias(false).init(device),
        });
        let shift = |j: usize| if j % 2 == 1 { config.window / 2 } else { 0 };
        let blocks =
            (0..config.depths[i]).map(|j| Block::new(dim, config.window, config.heads[i], shift(j), device)).collect();
        Self { downsample, blocks }
    }

    fn forward(&self, x: Tensor<4>, factors: Option<&[BlockFactors]>) -> Tensor<4> {
        let x = match &self.downsample {
            Some(merging) => merging.forward(x),
            None => x,
        };
        self.blocks.iter().enumerate().fold(x, |x, (i, block)| block.forward(x, factors.map(|all| &all[i])))
    }
}
