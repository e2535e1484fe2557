//! A network of twice the width and more blocks that computes what a trained one does (Net2Net, Chen et al. 2016, arXiv:1511.05641).
//!
//! Every channel becomes two equal ones next to each other. A layer that reads them shares its weight between the two, in random parts, so that
//! the two learn different things from the first step on. Layer and batch norms see the same mean and variance as before. Attention gets twice
//! the heads of the same depth. New Swin blocks pass their tokens on.

use super::init::initial_weights;
use super::store::outline;
use burn::tensor::Device;
use elunar_net::config::{NetConfig, Preset, config_of};
use elunar_net::fit::check_fit;
use elunar_net::weights::{Array, Weights};
use elunar_raster::{Error, Result};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;

/// Returns weights of the size of `preset`, which has twice the width of `weights` and at least its blocks, and computes the same. A detail stage
/// gets twice its channels. `seed` determines how pairs of channels share their weights. Messages call the weights `path`.
///
/// # Errors
/// [`Error::Broken`] if the weights have no usable configuration, or are not of half the preset's width.
pub fn widened(weights: &Weights, preset: Preset, seed: u64, path: &Path) -> Result<Weights> {
    let old = config_of(weights, path)?;
    let config = wider(&old, preset).map_err(|what| Error::broken(path, what))?;
    check_fit(&outline(&old, &Device::flex()), weights, path)?;
    let mut wide = initial_weights(&config, seed);
    for (name, array) in &mut wide.tensors {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(name.bytes().fold(0, |hash: u64, byte| hash.wrapping_mul(31).wrapping_add(byte.into())));
        match weights.tensors.get(name) {
            Some(narrow) => *array = doubled(name, narrow, &array.shape, &old, &mut rng),
            // A block that the narrow network lacks adds nothing at first.
            None if name.ends_with("attn.proj.weight") || name.ends_with("mlp.fc2.weight") => array.data.fill(0.0),
            None => {}
        }
    }
    wide.metadata
        .extend(weights.metadata.iter().filter(|(key, _)| *key != "config").map(|(k, v)| (k.clone(), v.clone())));
    check_fit(&outline(&config, &Device::flex()), &wide, path)?;
    Ok(wide)
}

/// Returns the configuration of the preset's size with the switches of `old`.
fn wider(old: &NetConfig, preset: Preset) -> std::result::Result<NetConfig, String> {
    let size = NetConfig::preset(preset);
    let config = NetConfig {
        embed: size.embed,
        depths: size.depths,
        heads: size.heads,
        window: size.window,
        stem: size.stem,
        dtm: size.dtm,
        decoder: size.decoder,
        detail: 2 * old.detail,
        detail_inner: 2 * old.detail_inner,
        ..old.clone()
    };
    let twice = |old: &[usize], new: &[usize]| old.iter().zip(new).all(|(old, new)| 2 * old == *new);
    let same_or_twice =
        |old: &[usize], new: &[usize]| old.iter().zip(new).all(|(old, new)| old == new || 2 * old == *new);
    let fits = 2 * old.embed == config.embed
        && twice(&old.heads, &config.heads)
        && same_or_twice(&[old.stem], &[config.stem])
        && same_or_twice(&old.dtm, &config.dtm)
        && same_or_twice(&old.decoder, &config.decoder);
    let deeper = old.depths.iter().zip(config.depths).all(|(old, new)| *old <= new);
    if !fits || !deeper || old.window != config.window || !old.unet.is_empty() {
        return Err(format!(
            "expected the paper's network of half the width of {preset:?}, of the same window and no more blocks, found embed {}, depths {:?}, \
             window {}",
            old.embed, old.depths, old.window
        ));
    }
    Ok(config)
}

/// Returns an array of the wider network. Index i of a doubled axis is index i / 2 of the old one; with heads, as below.
fn doubled(name: &str, old: &Array, shape: &[usize], config: &NetConfig, rng: &mut ChaCha8Rng) -> Array {
    let depth = config.embed / config.heads[0];
    let (rows, old_rows) = (shape[0], old.shape[0]);
    let (filter, old_filter) = (shape[1..].iter().product::<usize>(), old.shape[1..].iter().product::<usize>());
    // The first of the two axes is that of the outputs; a table of position biases has its heads in the second.
    let table = name.ends_with("relative_position_bias_table");
    let row_of = |row: usize| match rows / old_rows {
        1 => row,
        _ if name.contains("attn.qkv.") => by_heads(row, depth),
        _ => row / 2,
    };
    let mut data = vec![0.0; rows * filter];
    for row in 0..rows {
        let from = &old.data[row_of(row) * old_filter..][..old_filter];
        let to = &mut data[row * filter..][..filter];
        if shape.len() == 1 {
            to.copy_from_slice(from);
        } else if table {
            to.iter_mut().enumerate().for_each(|(head, to)| *to = from[head / 2]);
        } else {
            let (inputs, old_inputs) = (shape[1], old.shape[1]);
            let area = filter / inputs;
            // The detail stage reads the decoder's map, which is doubled, and the image's maps, which are not.
            let pairs = inputs - old_inputs;
            let of = |input: usize| match input {
                _ if input >= 2 * pairs => input - pairs,
                _ if name.ends_with("attn.proj.weight") => by_heads(input, depth),
                _ => input / 2,
            };
            let mut twins = vec![None; old_inputs];
            for (input, to) in to.chunks_exact_mut(area).enumerate() {
                let old_input = of(input);
                let share = match twins[old_input] {
                    _ if input >= 2 * pairs => 1.0,
                    Some(share) => 1.0 - share,
                    None => rng.random::<f32>(),
                };
                twins[old_input] = Some(share);
                to.iter_mut().zip(&from[old_input * area..]).for_each(|(to, from)| *to = share * from);
            }
        }
    }
    Array { shape: shape.to_vec(), data }
}

/// Returns the old index of an axis that lists heads of `depth` channels, of which there are now twice as many.
fn by_heads(index: usize, depth: usize) -> usize {
    let (head, channel) = (index / depth, index % depth);
    (head / 2) * depth + channel
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::store::load;
    use crate::testing::without_zeros;
    use burn::tensor::{Distribution, Tensor};
    use elunar_net::config::trained_network;

    #[test]
    fn a_wider_network_computes_the_same_and_its_twins_differ() {
        let (path, device) = (Path::new("nano.safetensors"), Device::flex());
        let nano = trained_network(Preset::Nano);
        let narrow = without_zeros(initial_weights(&nano, 3));
        let wide = widened(&narrow, Preset::Tiny, 5, path).unwrap();
        let config = config_of(&wide, path).unwrap();
        assert_eq!((config.embed, config.depths, config.detail), (48, [2, 2, 4, 2], 32));
        let random = |maps: usize| Tensor::<4>::random([1, maps, 64, 96], Distribution::Normal(0.0, 1.0), &device);
        let (image, coarse) = (random(8), random(1));
        let of = |config: &NetConfig, weights: &Weights| {
            let net = load(config, weights, path, &device).unwrap();
            net.forward(image.clone(), coarse.clone()).into_data().try_to_vec::<f32>().unwrap()
        };
        let (expected, found) = (of(&nano, &narrow), of(&config, &wide));
        let size = expected.iter().fold(0.0, |most: f32, z| most.max(z.abs()));
        let apart = expected.iter().zip(&found).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(size > 0.1 && apart < 1e-4 * size.max(1.0), "{apart} of {size}");
        let fusion = &wide.tensors["fusion.conv.weight"].data;
        assert!((fusion[0] - fusion[9]).abs() > 1e-6, "twins share in different parts");
    }

    #[test]
    fn other_sizes_are_refused() {
        let path = Path::new("w.safetensors");
        let weights = initial_weights(&trained_network(Preset::Nano), 1);
        for preset in [Preset::Nano, Preset::Small] {
            let refused = widened(&weights, preset, 1, path).unwrap_err().to_string();
            assert!(refused.contains("half the width") && refused.contains("embed 24"), "{refused}");
        }
    }
}
