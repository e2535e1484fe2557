//! The graph is the network, and the runner is the graph.

use super::build::build;
use super::*;
use crate::model::config::NetConfig;
use crate::model::weights::Weights;
use elunar_core::nn::{Model, Progress, Runner, required};
use std::path::{Path, PathBuf};

fn golden(name: &str) -> Option<(PathBuf, Weights, NetConfig)> {
    let shared = std::env::var_os("ELUNAR_SHARED").map_or(PathBuf::from("../../shared"), PathBuf::from);
    let shared = if shared.exists() { shared } else { PathBuf::from("../../../shared") };
    let path = shared.join("oracle/golden").join(name);
    if !path.exists() {
        println!("SKIPPED: {} is absent", path.display());
        return None;
    }
    let weights = Weights::read(&path).unwrap();
    let config = serde_json::from_str(&weights.metadata["config"]).unwrap();
    Some((path, weights, config))
}

/// `[1, C, H, W]` of a golden map against `[H, W, C]`: largest difference over largest magnitude.
fn relative_error(expected: &crate::model::weights::Array, found: &[f32]) -> f64 {
    let (channels, area) = (expected.shape[1], expected.shape[2] * expected.shape[3]);
    let magnitude = expected.data.iter().fold(0.0f64, |m, v| m.max(v.abs() as f64));
    let difference = |i: usize| (expected.data[i] - found[i % area * channels + i / area]).abs() as f64;
    (0..expected.data.len()).map(difference).fold(0.0, f64::max) / magnitude
}

#[test]
fn float_graph_matches_every_golden_map() {
    for name in ["even_windows.safetensors", "padded_windows.safetensors"] {
        let Some((path, weights, config)) = golden(name) else { continue };
        let shape = &weights.tensors["input.image"].shape;
        let graph = build(&config, &weights, &path, (shape[2], shape[3])).unwrap();
        let maps = float::run(&graph, &weights.tensors["input.image"].data, &weights.tensors["input.coarse"].data);
        let mut compared = 0;
        for (node, map) in graph.nodes.iter().zip(&maps) {
            let trace = weights.tensors.get(&format!("trace.{}", node.name));
            let Some(expected) = trace.or(weights.tensors.get(&node.name)) else { continue };
            let error = relative_error(expected, map);
            println!("{name} {}: {error:.2e}", node.name);
            assert!(error < 1e-4, "{name} {}: {error:e}", node.name);
            compared += 1;
        }
        assert_eq!(compared, 13);
    }
}

fn run_model(bytes: &[u8], tile: &CalibrationTile) -> Vec<f32> {
    let model = Model::new(bytes).unwrap();
    let mut arena = vec![0xa5; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    runner.begin(&tile.image, &tile.coarse).unwrap();
    while runner.step(1 << 20).unwrap() == Progress::Running {}
    let mut out = vec![0.0; tile.image.len()];
    runner.output(&mut out).unwrap();
    println!("telemetry {:?}", runner.telemetry());
    out
}

#[test]
fn runner_follows_the_float_network_on_golden_files() {
    for name in ["even_windows.safetensors", "padded_windows.safetensors"] {
        let Some((path, weights, config)) = golden(name) else { continue };
        let shape = &weights.tensors["input.image"].shape;
        let tile = CalibrationTile {
            image: weights.tensors["input.image"].data.clone(),
            coarse: weights.tensors["input.coarse"].data.clone(),
            metres_per_unit: None,
        };
        for precision in [Precision::Int8, Precision::Mixed, Precision::Int16] {
            let options = Options { tile: (shape[2], shape[3]), precision, name: "golden".into() };
            let export =
                export(&config, &weights, Path::new(&path), std::slice::from_ref(&tile), &options, |_| {}).unwrap();
            let found = run_model(&export.bytes, &tile);
            let expected = &weights.tensors["output"].data;
            let rms = |f: &dyn Fn(usize) -> f32| {
                ((0..found.len()).map(|i| (f(i) as f64).powi(2)).sum::<f64>() / found.len() as f64).sqrt()
            };
            let mean = expected.iter().sum::<f32>() / expected.len() as f32;
            let (error, spread) = (rms(&|i| found[i] - expected[i]), rms(&|i| expected[i] - mean));
            println!("{name} {precision:?}: rmse {error:.4} of spread {spread:.3}");
            assert!(error < 0.10 * spread, "{name} {precision:?}: {error} of {spread}");
        }
    }
}
