//! The float graph and the runner agree with the reference implementation's golden files.

use super::super::build::build;
use super::super::{CalibrationTile, float};
use super::super::{CompileOptions, MapBits, export};
use super::runs::run;
use crate::config::{NetConfig, config_of};
use crate::weights::{Array, NetWeights};
use std::path::{Path, PathBuf};

/// Returns the repository's own case, then the shared ones, if any.
fn cases() -> Vec<(PathBuf, NetWeights, NetConfig)> {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let shared = std::env::var_os("ELUNAR_SHARED").map_or_else(|| repository.join("../shared"), PathBuf::from);
    let own = repository.join("tests/golden/mini/case.safetensors");
    let others = ["even_windows", "padded_windows"].map(|n| shared.join(format!("oracle/golden/{n}.safetensors")));
    let mut found = Vec::new();
    for path in [own].into_iter().chain(others) {
        if found.is_empty() || path.exists() {
            let weights = NetWeights::read(&path).unwrap();
            let config = config_of(&weights, &path).unwrap();
            found.push((path, weights, config));
        } else {
            elunar_testing::skipped("a golden case", &format!("{} is absent", path.display()));
        }
    }
    found
}

/// Compares `[1, C, H, W]` of a golden map with `[H, W, C]`. Returns the largest difference over the largest magnitude.
fn relative_error(expected: &Array, found: &[f32]) -> f64 {
    let (channels, area) = (expected.shape[1], expected.shape[2] * expected.shape[3]);
    let magnitude = expected.data.iter().fold(0.0f64, |m, v| m.max(v.abs() as f64));
    let difference = |i: usize| (expected.data[i] - found[i % area * channels + i / area]).abs() as f64;
    (0..expected.data.len()).map(difference).fold(0.0, f64::max) / magnitude
}

#[test]
fn float_graph_matches_every_golden_map() {
    for (path, weights, config) in cases() {
        let image = &weights.tensors["input.image"];
        let graph = build(&config, &weights, &path, (image.shape[2], image.shape[3])).unwrap();
        let maps = float::run(&graph, &image.data, &weights.tensors["input.coarse"].data);
        let mut compared = 0;
        for (node, map) in graph.nodes.iter().zip(&maps) {
            let trace = weights.tensors.get(&format!("trace.{}", node.name));
            let Some(expected) = trace.or(weights.tensors.get(&node.name)) else { continue };
            let error = relative_error(expected, map);
            assert!(error < 1e-4, "{} {}: {error:e}", path.display(), node.name);
            compared += 1;
        }
        assert_eq!(compared, 13, "{}", path.display());
    }
}

#[test]
fn runner_stays_close_to_golden_outputs() {
    // Random weights are the worst case for 8 bits: every layer adds about 1 %, and the last one was scaled to fill the range. Trained
    // networks stay within 0.1 %.
    for (path, weights, config) in cases() {
        let image = &weights.tensors["input.image"];
        let tile = CalibrationTile {
            image: image.data.clone(),
            coarse: weights.tensors["input.coarse"].data.clone(),
            ground: None,
        };
        let tile_size = (image.shape[2], image.shape[3]);
        let options = CompileOptions { tile: tile_size, precision: MapBits::Mixed, name: "golden".into() };
        let made = export(&config, &weights, &path, std::slice::from_ref(&tile), &options, |_| {}).unwrap();
        let (found, expected) = (run(&made.bytes, &tile, u64::MAX), &weights.tensors["output"].data);
        let n = expected.len() as f64;
        let mean = expected.iter().map(|&v| v as f64).sum::<f64>() / n;
        let spread = (expected.iter().map(|&v| (v as f64 - mean).powi(2)).sum::<f64>() / n).sqrt();
        let square = |(a, b): (&f32, &f32)| (*a as f64 - *b as f64).powi(2);
        let error = (found.iter().zip(expected).map(square).sum::<f64>() / n).sqrt();
        println!("{}: rms difference {error:.3}, spread of the output {spread:.3}", path.display());
        assert!(error < 0.15 * spread, "{}: {error} of {spread}", path.display());
    }
}
