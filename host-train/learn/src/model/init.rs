//! Initial weights from a seed, with the same bytes on every backend.

use super::store::{outline, shapes};
use burn::tensor::Device;
use elunar_net::config::{Head, NetConfig};
use elunar_net::fit::check_fit;
use elunar_net::weights::Weights;
use elunar_raster::{Error, Result};
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
pub fn initial_weights(config: &NetConfig, seed: u64) -> Weights {
    let mut weights = shapes(config, &Device::flex());
    for (name, array) in &mut weights.tensors {
        let fan_in: usize = array.shape.iter().skip(1).product();
        let field = name.rsplit('.').next().unwrap_or(name);
        let one_dimensional = array.shape.len() == 1;
        let std = match (name.as_str(), field) {
            ("head.bias", _) => {
                array.data.fill(if config.head == Head::Relu { config.nr / 2.0 } else { 0.0 });
                continue;
            }
            ("head.weight", _) if config.head == Head::Residual => 0.0,
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

/// Returns the weights of another network as those of `config`: only the configuration in their metadata changes. Messages call the weights
/// `path`.
///
/// # Errors
/// [`Error::Broken`] if they do not fit the configuration.
pub fn weights_for(mut weights: Weights, config: &NetConfig, path: &Path) -> Result<Weights> {
    config.check().map_err(|what| Error::broken(path, what))?;
    check_fit(&outline(config, &Device::flex()), &weights, path)?;
    let text = serde_json::to_string(config).expect("a plain struct");
    weights.metadata.insert("config".into(), text);
    Ok(weights)
}

/// Returns He-normal weights and zero biases for `arrays` of a module of convolutions.
pub fn normal_weights(mut arrays: Weights, seed: u64) -> Weights {
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
    use elunar_net::config::{Illumination, config_of, miniature_network};

    #[test]
    fn weights_serve_another_light_but_no_other_shape() {
        let path = Path::new("w.safetensors");
        let config = NetConfig { illumination: Illumination::Given, ..miniature_network() };
        let mut weights = initial_weights(&config, 3);
        weights.metadata.insert("origin".into(), "kept".into());
        let weighed = NetConfig { illumination: Illumination::Weighed, ..config.clone() };
        let made = weights_for(weights.clone(), &weighed, path).unwrap();
        assert_eq!(config_of(&made, path).unwrap(), weighed);
        assert_eq!((made.metadata["origin"].as_str(), made.tensors == weights.tensors), ("kept", true));
        // Brightness is one map, a guide has four.
        let any = NetConfig { illumination: Illumination::Any, ..config };
        assert!(weights_for(weights, &any, path).unwrap_err().to_string().contains("do not fit"));
    }
}
