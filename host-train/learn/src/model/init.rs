//! Initial weights from a seed, with the same bytes on every backend.

use super::store::shapes;
use burn::tensor::Device;
use elunar_net::config::{Head, NetConfig};
use elunar_net::weights::Weights;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use sha2::{Digest, Sha256};

/// Standard deviation of transformer weights and position biases, as in published Swin code.
const SWIN_STD: f32 = 0.02;

/// Returns initial weights for `config`. Norms are identities, Swin matrices are N(0, 0.02²) cut at two sigma, convolutions are He-normal.
/// The ReLU head starts at NR/2, because a ReLU that is zero everywhere makes the mean in Eq. 6 zero. The residual head starts with zero
/// correction, so that an untrained network returns the coarse DTM.
pub fn initial_weights(config: &NetConfig, seed: u64) -> Weights {
    let mut weights = shapes(config, &Device::default());
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
