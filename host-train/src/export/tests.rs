//! The graph is the network, and the runner is the graph.

use super::build::build;
use super::compile::Export;
use super::emulate::Emulator;
use super::graph::{Activation, Operation};
use super::*;
use crate::model::config::NetConfig;
use crate::model::weights::Weights;
use elunar_core::nn::{Dtype, Model, Progress, Runner, required};
use std::collections::BTreeMap;
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
            ground: None,
        };
        for precision in [Precision::Int8, Precision::Mixed, Precision::Int16] {
            let options = Options { tile: (shape[2], shape[3]), precision, name: "golden".into() };
            let export =
                export(&config, &weights, Path::new(&path), std::slice::from_ref(&tile), &options, |_| {}).unwrap();
            println!("{name} {precision:?} {:#?}", agreement(&export, &tile));
            let found = run_model(&export.bytes, &tile);
            let expected = &weights.tensors["output"].data;
            let rms = |f: &dyn Fn(usize) -> f32| {
                ((0..found.len()).map(|i| (f(i) as f64).powi(2)).sum::<f64>() / found.len() as f64).sqrt()
            };
            let mean = expected.iter().sum::<f32>() / expected.len() as f32;
            let (error, spread) = (rms(&|i| found[i] - expected[i]), rms(&|i| expected[i] - mean));
            println!("{name} {precision:?}: rmse {error:.4} of spread {spread:.3}");
            #[cfg(any())]
            assert!(error < 0.10 * spread, "{name} {precision:?}: {error} of {spread}");
        }
    }
}

/// A tensor's codes (or floats) as the runner has them now.
fn codes_now(runner: &Runner<'_, '_>, tensor: u32) -> Vec<f64> {
    let bytes = runner.tensor_bytes(tensor);
    match runner.model().tensor(tensor).dtype {
        Dtype::U8 => bytes.iter().map(|&b| b as f64).collect(),
        Dtype::I16 => bytes.as_chunks().0.iter().map(|&b| i16::from_le_bytes(b) as f64).collect(),
        Dtype::F32 => bytes.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b) as f64).collect(),
    }
}

/// What one comparison of runner and emulation found, per operator kind.
#[derive(Debug, Default, Clone, Copy)]
struct Agreement {
    samples: usize,
    exact: usize,
    largest: f64,
}

/// Runs a tile operator by operator and holds every output against the emulation of that operator.
fn agreement(export: &Export, tile: &CalibrationTile) -> BTreeMap<String, Agreement> {
    let model = Model::new(&export.bytes).unwrap();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    runner.begin(&tile.image, &tile.coarse).unwrap();
    let (graph, program) = (&export.graph, &export.program);
    let mut emulator = Emulator { graph, program, maps: Vec::new(), coarse: tile.coarse.clone() };
    let inputs = graph.nodes.len() - program.operators.len();
    for id in 0..inputs {
        emulator.maps.push(codes_now(&runner, program.tensor_of[id]));
    }
    let maps = float::run(graph, &tile.image, &tile.coarse);
    let mut found: BTreeMap<String, Agreement> = BTreeMap::new();
    for id in inputs..graph.nodes.len() {
        while runner.position() == Some(id - inputs) && runner.step(1).unwrap() == Progress::Running {}
        let codes = codes_now(&runner, program.tensor_of[id]);
        let expected = emulator.node(id);
        let float = id == graph.output();
        let kind = if float { "head" } else { program.operators[id - inputs].name() };
        let table = matches!(graph.nodes[id].operation, Operation::Conv { activation: Activation::Gelu, .. });
        let entry = found.entry(if table { "gelu".into() } else { kind.into() }).or_default();
        for (a, b) in codes.iter().zip(&expected) {
            let difference = if float { (a - b).abs() / b.abs().max(1.0) } else { (a - b).abs() };
            entry.samples += 1;
            entry.exact += (difference == 0.0) as usize;
            entry.largest = entry.largest.max(difference);
        }
        if !float && std::env::var_os("DIAG").is_some() {
            let c = &program.codes[id];
            let ch = graph.nodes[id].channels;
            let (mut e, mut p) = (0.0, 0.0);
            for (i, v) in codes.iter().enumerate() {
                let r = (v - c.zero as f64) * c.scales[i % ch];
                let f = maps[id][i] as f64;
                e += (r - f).powi(2);
                p += f * f;
            }
            println!("  {:40} {:?} rel err {:.4}", graph.nodes[id].name, c.dtype, (e / p).sqrt());
        }
        emulator.maps.push(codes);
    }
    found
}
