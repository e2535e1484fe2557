//! Checks that the models for `elunar-provoke` are the exporter's output for its smallest networks.

use elunar_core::nn::Model;
use elunar_core::nn::file::word;
use elunar_net::config::{Illumination, NetConfig, OutputHead, Preset, TruthRange};
use elunar_net::export::build::manifest;
use elunar_net::export::{CalibrationTile, CompileOptions, MapBits, export};
use elunar_net::weights::{Array, NetWeights};
use elunar_provoke::Random;
use elunar_tests::repository;
use std::path::{Path, PathBuf};

/// The taller tiles are large enough for upsamplings that are folded into filters.
const MODELS: [(&str, (usize, usize), MapBits, Illumination); 4] = [
    ("mixed", (32, 32), MapBits::Mixed, Illumination::Any),
    ("int8", (64, 32), MapBits::Int8, Illumination::Any),
    ("int16", (64, 32), MapBits::Int16, Illumination::Northwest),
    ("guided", (32, 64), MapBits::Mixed, Illumination::Given),
];

fn file(name: &str) -> PathBuf {
    repository().join("tests/golden/provoked").join(name).with_extension("eld")
}

/// Returns the numbers and places of all records, which do not depend on a machine's arithmetic.
fn structure(bytes: &[u8]) -> Vec<u32> {
    let model = Model::new(bytes).expect("a sound model");
    let words = [word::TENSORS, word::OPERATORS, word::SCHEDULE, word::CONSTANTS];
    words.into_iter().flat_map(|at| [model.raw().word(at), model.raw().word(at + 1)]).collect()
}

#[test]
fn they_have_the_structure_that_the_exporter_makes_today() {
    for (name, tile, precision, illumination) in MODELS {
        let kept = std::fs::read(file(name)).expect("a file of the repository");
        let made = small_model(tile, precision, illumination);
        let advice = "if that is meant: cargo test -p elunar-tests --test sound_models -- --ignored";
        assert_eq!(structure(&kept), structure(&made), "{name}: {advice}");
    }
}

#[test]
#[ignore = "writes tests/golden/provoked anew"]
fn write_them_anew() {
    for (name, tile, precision, illumination) in MODELS {
        std::fs::write(file(name), small_model(tile, precision, illumination)).expect("a folder that can be written");
    }
}

fn small_model(tile: (usize, usize), precision: MapBits, illumination: Illumination) -> Vec<u8> {
    let given = illumination == Illumination::Given;
    let config = NetConfig {
        illumination,
        target_range: if given { TruthRange::Pixel } else { TruthRange::Own },
        embed: 2,
        depths: [2, 1, 1, 1],
        heads: [1, 1, 2, 1],
        window: 3,
        stem: 1,
        dtm: [1; 5],
        decoder: [2; 5],
        head: OutputHead::Residual,
        ..NetConfig::preset(Preset::Nano)
    };
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let mut weights = NetWeights::default();
    for (name, shape) in manifest(&config).expect("a legal configuration") {
        let fan_in: usize = shape[1..].iter().product();
        let one = |r: f32| match name.rsplit('.').next() {
            Some("running_var") => 0.5 + r.abs(),
            Some("weight") if shape.len() == 1 => 1.0 + 0.2 * r,
            Some("weight") => 1.5 * r / (fan_in as f32).sqrt(),
            _ => 0.2 * r,
        };
        let data = (0..shape.iter().product()).map(|_| one(random.sample())).collect();
        weights.tensors.insert(name.clone(), Array { shape, data });
    }
    let samples = tile.0 * tile.1;
    let maps = if given { elunar_core::photoclinometry::MAPS } else { 1 };
    let image = (0..maps * samples).map(|_| 0.5 + 0.25 * random.sample()).collect();
    let coarse = (0..samples).map(|i| 25.0 + 20.0 * (i as f32 / 97.0).sin()).collect();
    let tiles = [CalibrationTile { image, coarse, ground: None }];
    let options = CompileOptions { tile, precision, name: "provoked".into() };
    export(&config, &weights, Path::new("provoked"), &tiles, &options, |_| {}).expect("a sound network").bytes
}
