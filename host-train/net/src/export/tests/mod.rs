//! The graph equals the network, the runner agrees with the graph, and no file can harm the runner.

mod agreement;
mod emulate;
mod files;
mod fixture;
mod golden;
mod runs;

use super::build::manifest;
use super::compile::Export;
use super::{CalibrationTile, calibrate};
use super::{CompileOptions, MapBits, export};
use crate::config::{NetConfig, Preset};
use crate::weights::{Array, NetWeights};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;

/// Returns a network of a few thousand weights with every operator and every kind of map.
fn small_config() -> NetConfig {
    NetConfig {
        embed: 4,
        depths: [2, 1, 1, 1],
        heads: [1, 2, 2, 4],
        window: 3,
        stem: 3,
        dtm: [2, 3, 2, 3, 4],
        decoder: [5, 4, 9, 3, 2],
        ..NetConfig::preset(Preset::Nano)
    }
}

/// Returns random weights, scaled so that the range of maps hardly changes from layer to layer.
fn random_weights(config: &NetConfig, seed: u64) -> NetWeights {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut weights = NetWeights::default();
    for (name, shape) in manifest(config).unwrap() {
        let fan_in: usize = shape[1..].iter().product();
        let mut sample = || -> f32 { (0..6).map(|_| rng.random_range(-0.7..0.7f32)).sum() };
        let value = |r: f32| match name.rsplit('.').next().unwrap() {
            "running_var" => 0.5 + r.abs(),
            "weight" if shape.len() == 1 => 1.0 + 0.2 * r,
            "weight" => 1.5 * r / (fan_in as f32).sqrt(),
            _ if name == "head.bias" => 20.0,
            _ => 0.2 * r,
        };
        let data = (0..shape.iter().product()).map(|_| value(sample())).collect();
        weights.tensors.insert(name.clone(), Array { shape, data });
    }
    weights
}

/// Returns a tile of waves and noise.
fn random_tile(rows: usize, cols: usize, seed: u64) -> CalibrationTile {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let wave =
        |i: usize, step: f32| 0.5 + 0.4 * ((i / cols) as f32 * step).sin() * ((i % cols) as f32 * 0.7 * step).cos();
    let image = (0..rows * cols).map(|i| wave(i, 0.9) + rng.random_range(-0.1..0.1f32)).collect();
    let coarse = (0..rows * cols).map(|i| 50.0 * wave(i, 0.1)).collect();
    CalibrationTile { image, coarse, ground: None }
}

/// Exports `config` with random weights, calibrated on two tiles. Also returns the first tile.
fn random_export(config: &NetConfig, tile: (usize, usize), precision: MapBits, seed: u64) -> (Export, CalibrationTile) {
    let tiles = [random_tile(tile.0, tile.1, seed), random_tile(tile.0, tile.1, seed + 1)];
    let options = CompileOptions { tile, precision, name: "random".into() };
    let weights = random_weights(config, seed);
    let made = export(config, &weights, Path::new("random"), &tiles, &options, |_| {}).unwrap();
    let [first, _] = tiles;
    (made, first)
}

#[test]
fn weights_that_do_not_fit_are_all_named() {
    let config = small_config();
    let mut weights = random_weights(&config, 1);
    weights.tensors.remove("head.bias");
    weights.tensors.get_mut("fusion.bn.weight").unwrap().shape = vec![3];
    weights.tensors.insert("stray".into(), Array { shape: vec![1], data: vec![0.0] });
    let error = super::build::build(&config, &weights, Path::new("w.safetensors"), (32, 32)).unwrap_err().to_string();
    let expected = ["w.safetensors", "3 misfits", "head.bias: expected [1], found none"];
    let more = ["fusion.bn.weight: expected [32], found [3]", "stray: expected none, found [1]"];
    assert!(expected.iter().chain(&more).all(|part| error.contains(part)), "{error}");
    let config = NetConfig { unet: vec![4, 8], ..small_config() };
    let error = super::build::build(&config, &weights, Path::new("w.safetensors"), (32, 32)).unwrap_err().to_string();
    assert!(error.contains("U-Net"), "{error}");
}

#[test]
fn calibration_without_tiles_is_refused() {
    let (made, _) = random_export(&small_config(), (32, 32), MapBits::Mixed, 1);
    assert!(calibrate::calibrate(&made.graph, &[], |_| {}).is_err());
}
