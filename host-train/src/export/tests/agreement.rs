//! The integer runner against the f64 emulation, operator by operator, on random networks of every kind.

use super::super::compile::{Export, Precision};
use super::super::graph::{Activation, Operation};
use super::emulate::Emulator;
use super::{CalibrationTile, random_export, small_config};
use crate::model::config::{DecoderKind, Head, ImageEncoderKind, NetConfig};
use elunar_core::nn::{Dtype, Model, Progress, Runner, required};
use std::collections::BTreeMap;

/// What the comparison found, per operator kind.
#[derive(Debug, Default, Clone, Copy)]
struct Agreement {
    samples: usize,
    exact: usize,
    /// Largest difference in code steps (16-bit maps of attention and norms: in coarser ones, see below; the head: relative).
    largest: f64,
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

fn agreement(made: &Export, tile: &CalibrationTile, found: &mut BTreeMap<&'static str, Agreement>) {
    let model = Model::new(&made.bytes).unwrap();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    runner.begin(&tile.image, &tile.coarse).unwrap();
    let (graph, program) = (&made.graph, &made.program);
    let inputs = graph.nodes.len() - program.operators.len();
    // Coarse codes that nobody reads are not loaded; the emulation does not read them either.
    let maps = (0..inputs).map(|id| codes_now(&runner, program.tensor_of[id])).collect();
    let mut emulator = Emulator { graph, program, maps, coarse: tile.coarse.clone() };
    for id in inputs..graph.nodes.len() {
        while runner.position() == Some(id - inputs) && runner.step(1).unwrap() == Progress::Running {}
        let codes = codes_now(&runner, program.tensor_of[id]);
        let (kind, step) = match &graph.nodes[id].operation {
            _ if id == graph.output() => ("head", 0.0),
            Operation::Conv { activation: Activation::Gelu, .. } => ("gelu", 1.0),
            Operation::Attention { .. } => ("attention", (program.codes[id].hi as f64 / 512.0).max(1.0)),
            Operation::LayerNorm { .. } => {
                (program.operators[id - inputs].name(), (program.codes[id].hi as f64 / 8192.0).max(1.0))
            }
            _ => (program.operators[id - inputs].name(), 1.0),
        };
        let entry = found.entry(kind).or_default();
        for (a, b) in codes.iter().zip(&emulator.node(id)) {
            let scale = if kind == "head" { b.abs().max(1.0) } else { step };
            entry.samples += 1;
            entry.exact += (a == b) as usize;
            entry.largest = entry.largest.max((a - b).abs() / scale);
        }
        emulator.maps.push(codes);
    }
}

fn networks() -> [NetConfig; 6] {
    let small = small_config();
    [
        small.clone(),
        NetConfig { head: Head::Residual, window: 5, ..small.clone() },
        NetConfig { image_encoder: ImageEncoderKind::Resnet, ..small.clone() },
        NetConfig { decoder_kind: DecoderKind::Upb, window: 4, ..small.clone() },
        NetConfig { use_coarse: false, window: 2, ..small.clone() },
        NetConfig {
            image_encoder: ImageEncoderKind::Resnet,
            use_coarse: false,
            decoder_kind: DecoderKind::Upb,
            ..small
        },
    ]
}

#[test]
fn runner_agrees_with_the_emulation_of_every_operator() {
    for precision in [Precision::Int8, Precision::Mixed, Precision::Int16] {
        let mut found = BTreeMap::new();
        for (seed, config) in networks().iter().enumerate() {
            let (made, tile) = random_export(config, (64, 32), precision, seed as u64);
            agreement(&made, &tile, &mut found);
        }
        println!("{precision:?} {found:#?}");
        let wide = precision == Precision::Int16;
        // Convolutions and norms differ only where the exact value lies within the multipliers' rounding of a tie. C²ε is an
        // integer, so that a norm of nearly constant pixels is within one step of 8 bits, but only within 1/8192 of a 16-bit
        // range. Logits have 8 fraction bits: attention is within one step of 8 bits, and within 1/512 of a 16-bit range.
        let limits = [
            ("conv", 1.0, 0.999),
            ("layer-norm", 1.0, if wide { 0.9 } else { 0.98 }),
            ("merge-norm", 1.0, if wide { 0.9 } else { 0.98 }),
            ("gelu", 2.0, 0.99),
            ("attention", 1.0, if wide { 0.0 } else { 0.8 }),
            ("head", 1e-6, 0.0),
        ];
        assert_eq!(found.len(), limits.len());
        for (kind, largest, exact) in limits {
            let got = found[kind];
            assert!(got.largest <= largest, "{precision:?} {kind}: {got:?}");
            assert!(got.exact as f64 >= exact * got.samples as f64, "{precision:?} {kind}: {got:?}");
        }
    }
}
