//! Initial weights from a seed, with the same bytes on every backend.

use super::store::{outline, shapes};
use burn::tensor::Device;
use elunar_base::{Error, Result};
use elunar_net::config::{NetConfig, OutputHead};
use elunar_net::fit::check_fit;
use elunar_net::weights::{Array, NetWeights};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use sha2::{Digest, Sha256};
use std::path::Path;

/// Standard deviation of transformer weights and position biases, as in published Swin code.
const SWIN_STD: f32 = 0.02;

/// Returns initial weights for `config`. Norms are identities, Swin matrices are N(0, 0.02²) cut at two sigma, convolutions are He-normal.
/// The ReLU head starts at NR/2, because a ReLU that is zero everywhere makes the mean in Eq. 6 zero. The residual head starts with zero
/// correction, so that an untrained network returns the coarse DTM.
pub fn initial_weights(config: &NetConfig, seed: u64) -> NetWeights {
    let mut weights = shapes(config, &Device::flex());
    for (name, array) in &mut weights.tensors {
        let fan_in: usize = array.shape.iter().skip(1).product();
        let field = name.rsplit('.').next().unwrap_or(name);
        let one_dimensional = array.shape.len() == 1;
        let std = match (name.as_str(), field) {
            ("head.bias", _) => {
                array.data.fill(if config.head == OutputHead::Relu { config.nr / 2.0 } else { 0.0 });
                continue;
            }
            ("head.weight", _) if config.head == OutputHead::Residual => 0.0,
            // A residual block begins as the identity.
            (name, "weight") if name.starts_with("detail.blocks.") && name.ends_with(".1.weight") => 0.0,
            (_, "running_var") => {
                array.data.fill(1.0);
                continue;
            }
            (_, "weight") if one_dimensional => {
                array.data.fill(1.0);
                continue;
            }
            (_, "weight") if name.contains(".swin.") => SWIN_STD,
            (_, "relative_position_bias_table") => SWIN_STD,
            (_, "weight") => (2.0 / fan_in as f32).sqrt(),
            _ => 0.0,
        };
        fill_normal(&mut array.data, std, seed, name);
    }
    weights
}

/// Returns the weights of another network as those of `config`, which may have more maps of the image, and a detail stage or a wider one. The
/// network computes the same as before: new maps have zero weights, and a new detail stage passes the decoder's last map on. Other weights of
/// the stage are random, from `seed`. Messages call the weights `path`.
///
/// # Errors
/// [`Error::Broken`] if they do not fit the configuration.
pub fn weights_for(mut weights: NetWeights, config: &NetConfig, seed: u64, path: &Path) -> Result<NetWeights> {
    config.check().map_err(|what| Error::broken(path, what))?;
    if config.detail >= config.decoder[4] {
        add_detail(&mut weights, config, seed);
    }
    if !config.coarse_channel {
        for name in ["image_encoder.stem.conv.weight", "image_encoder.swin.patch_embed.proj.weight"] {
            weights.tensors.get_mut(name).into_iter().for_each(|array| widen(array, config.image_maps()));
        }
    }
    check_fit(&outline(config, &Device::flex()), &weights, path)?;
    let text = serde_json::to_string(config).expect("a plain struct");
    weights.metadata.insert("config".into(), text);
    Ok(weights)
}

/// Adds what is missing of the detail stage: the stage, blocks, channels. A new stage passes the decoder's last map on, which has no negative
/// values; new blocks pass their input on; new channels add nothing to what older ones compute.
fn add_detail(weights: &mut NetWeights, config: &NetConfig, seed: u64) {
    let whole = weights.tensors.contains_key("detail.join.weight");
    for (name, array) in initial_weights(config, seed).tensors {
        if name.starts_with("detail.") {
            match weights.tensors.remove(&name) {
                // A block's last convolution begins with zeros, so its new channels give nothing at first.
                Some(old) => weights.tensors.insert(name, grown(&old, array)),
                None => weights.tensors.insert(name, array),
            };
        }
    }
    if let Some(join) = weights.tensors.get_mut("detail.join.weight").filter(|_| !whole) {
        let filter = join.data.len() / config.detail;
        for (channel, filter) in join.data.chunks_exact_mut(filter).enumerate().take(config.decoder[4]) {
            filter.fill(0.0);
            // The centre of the 3x3 weights of the same channel.
            filter[9 * channel + 4] = 1.0;
        }
    }
    weights.tensors.get_mut("head.weight").into_iter().for_each(|head| widen(head, config.detail));
}

/// Returns `new`, a convolution `[O, I, k, k]` or its biases `[O]`, with the weights of a smaller one in its first channels. Those do not read
/// the new inputs. Returns `old` where it is not smaller; the shapes are compared later.
fn grown(old: &Array, mut new: Array) -> Array {
    let fits = old.shape.len() == new.shape.len()
        && old.shape.iter().zip(&new.shape).all(|(old, new)| old <= new)
        && old.shape.iter().skip(2).eq(new.shape.iter().skip(2));
    if !fits || old.shape == new.shape || old.shape.contains(&0) {
        return old.clone();
    }
    let filter = |array: &Array| array.data.len() / array.shape[0];
    let (narrow, wide) = (filter(old), filter(&new));
    for (from, to) in old.data.chunks_exact(narrow).zip(new.data.chunks_exact_mut(wide)) {
        to[..narrow].copy_from_slice(from);
        to[narrow..].fill(0.0);
    }
    new
}

/// Gives a convolution `[O, I, k, k]` more input channels, with weights of zero.
fn widen(array: &mut Array, inputs: usize) {
    if array.shape.len() > 1 && array.shape[1] < inputs {
        let mut shape = array.shape.clone();
        shape[1] = inputs;
        let data = vec![0.0; shape.iter().product()];
        *array = grown(array, Array { shape, data });
    }
}

/// Returns He-normal weights and zero biases for `arrays` of a module of convolutions.
pub fn normal_weights(mut arrays: NetWeights, seed: u64) -> NetWeights {
    for (name, array) in &mut arrays.tensors {
        let fan_in: usize = array.shape.iter().skip(1).product();
        let std = if array.shape.len() == 1 { 0.0 } else { (2.0 / fan_in as f32).sqrt() };
        fill_normal(&mut array.data, std, seed, name);
    }
    arrays
}

/// Fills with N(0, std²) cut at two sigma. Each tensor has its own random stream, so a new tensor does not change the others.
fn fill_normal(data: &mut [f32], std: f32, seed: u64, name: &str) {
    let digest = Sha256::new().chain_update(seed.to_le_bytes()).chain_update(name).finalize();
    let mut rng = ChaCha8Rng::from_seed(digest.into());
    let normal = Normal::new(0.0f32, 1.0).expect("unit deviation");
    for v in data {
        *v = std
            * loop {
                let sample = normal.sample(&mut rng);
                if sample.abs() <= 2.0 {
                    break sample;
                }
            };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::store::load;
    use crate::testing::without_zeros;
    use burn::tensor::{Distribution, Tensor};
    use elunar_net::config::{Illumination, config_of, miniature_network};

    #[test]
    fn weights_serve_another_light_but_no_other_shape() {
        let path = Path::new("w.safetensors");
        let config = NetConfig { illumination: Illumination::Given, detail: 0, ..miniature_network() };
        let mut weights = initial_weights(&config, 3);
        weights.metadata.insert("origin".into(), "kept".into());
        let weighed = NetConfig { illumination: Illumination::Weighed, ..config.clone() };
        let made = weights_for(weights.clone(), &weighed, 0, path).unwrap();
        assert_eq!(config_of(&made, path).unwrap(), weighed);
        assert_eq!((made.metadata["origin"].as_str(), made.tensors == weights.tensors), ("kept", true));
        // With slopes and a detail stage the network is the same at first, and every new weight can learn.
        let detailed = NetConfig {
            illumination: Illumination::Sloped,
            detail: 6,
            detail_inner: 3,
            detail_blocks: 2,
            ..config.clone()
        };
        let grown = weights_for(without_zeros(weights.clone()), &detailed, 7, path).unwrap();
        let device = Device::flex();
        let random = |maps: usize| Tensor::<4>::random([1, maps, 32, 64], Distribution::Normal(0.0, 1.0), &device);
        let (image, coarse) = (random(8), random(1));
        let of = |config: &NetConfig, weights: &NetWeights, image: Tensor<4>| {
            let net = load(config, weights, path, &device).unwrap();
            net.forward(image, coarse.clone()).into_data().try_to_vec::<f32>().unwrap()
        };
        let expected = of(&config, &without_zeros(weights.clone()), image.clone().narrow(1, 0, 4));
        let found = of(&detailed, &grown, image.clone());
        let apart = expected.iter().zip(&found).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart < 1e-4, "{apart}");
        assert!(expected.iter().any(|z| z.abs() > 0.1));
        // A wider and deeper stage, at first the same, too.
        let wider = NetConfig { detail: 9, detail_inner: 5, detail_blocks: 3, ..detailed.clone() };
        let trained = without_zeros(grown);
        let expected = of(&detailed, &trained, image.clone());
        let wide = weights_for(trained.clone(), &wider, 8, path).unwrap();
        let found = of(&wider, &wide, image.clone());
        let apart = expected.iter().zip(&found).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart < 1e-4, "{apart}");
        assert!(weights_for(trained, &NetConfig { detail: 5, ..detailed.clone() }, 8, path).is_err(), "never narrower");
        // Too narrow to pass the decoder's map on.
        assert!(
            weights_for(weights.clone(), &NetConfig { detail: 2, detail_inner: 1, ..config.clone() }, 7, path).is_err()
        );
        // Brightness is one map, a guide has four.
        let any = NetConfig { illumination: Illumination::Any, ..config };
        assert!(weights_for(weights, &any, 0, path).unwrap_err().to_string().contains("do not fit"));
    }
}
