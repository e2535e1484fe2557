//! The integer runner agrees with the f64 emulation, operator by operator, on random networks of every kind.

use super::super::MapBits;
use super::super::compile::Export;
use super::super::graph::{Activation, Operation};
use super::emulate::Emulator;
use super::{CalibrationTile, random_export, small_config};
use crate::config::{DecoderKind, ImageEncoderKind, NetConfig, OutputHead};
use elunar_core::nn::file::{Dtype, NONE};
use elunar_core::nn::{Model, Progress, Runner, required};
use std::collections::BTreeMap;
use std::ops::Range;

/// Result of the comparison for one kind of operator.
#[derive(Debug, Default, Clone, Copy)]
struct Agreement {
    samples: usize,
    exact: usize,
    /// Largest difference in code steps. For 16-bit maps of attention and norms the steps are coarser, see below; for the head it is
    /// relative.
    largest: f64,
}

/// Returns rows `rows` of a tensor from the runner's memory: codes (or floats) without margins.
fn rows_now(runner: &Runner<'_, '_>, tensor: u32, rows: Range<usize>, codes: &mut Vec<f64>) {
    let (t, bytes) = (runner.model().tensor(tensor), runner.tensor_bytes(tensor));
    for row in rows {
        let start = row % t.ring * t.pitch;
        let row = &bytes[start..start + t.row_bytes()];
        let (first, samples) = (t.margin * t.channels, t.cols * t.channels);
        match t.dtype {
            Dtype::U8 => codes.extend(row[first..first + samples].iter().map(|&b| b as f64)),
            Dtype::I16 => {
                let (low, high) = row.split_at(row.len() / 2);
                let planes = low[first..first + samples].iter().zip(&high[first..first + samples]);
                codes.extend(planes.map(|(&low, &high)| 256.0 * (high as f64 - 128.0) + low as f64));
            }
            Dtype::F32 => codes.extend(row.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b) as f64)),
        }
    }
}

/// Runs a tile unit by unit and keeps every row of every tensor at the time when it is written.
fn record(made: &Export, tile: &CalibrationTile) -> Vec<Vec<f64>> {
    let model = Model::new(&made.bytes).unwrap();
    let mut arena = vec![0xa5; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    // Each step has one unit. No step follows the last one.
    runner.protect(false);
    runner.begin(&tile.image, &tile.coarse).unwrap();
    let mut maps = vec![Vec::new(); model.tensor_count()];
    for input in [model.image_tensor(), model.coarse_tensor()].into_iter().filter(|t| *t != NONE) {
        rows_now(&runner, input, 0..model.tile().rows, &mut maps[input as usize]);
    }
    let mut progress = Progress::Running;
    for number in 0..model.entry_count() {
        let entry = model.entry(number).unwrap();
        let operator = model.operator(entry.operator).unwrap();
        let out = model.tensor(operator.output());
        for step in entry.first..entry.first + entry.count {
            for _ in 0..model.units(&operator) {
                assert_eq!((progress, runner.position()), (Progress::Running, Some(number)));
                progress = runner.step(1).unwrap();
            }
            let rows = operator.rows_after(&out, step)..operator.rows_after(&out, step + 1);
            rows_now(&runner, operator.output(), rows, &mut maps[operator.output() as usize]);
        }
    }
    assert_eq!(progress, Progress::Done);
    for (index, map) in maps.iter().enumerate() {
        let used = made
            .program
            .operators
            .iter()
            .any(|op| op.output() == index as u32 || op.inputs().contains(&Some(index as u32)));
        assert!(!used || map.len() == model.tensor(index as u32).len(), "tensor {index} is complete");
    }
    maps
}

fn compare(found: &mut Agreement, codes: &[f64], expected: &[f64], scale: impl Fn(f64) -> f64) {
    assert_eq!(codes.len(), expected.len());
    for (a, b) in codes.iter().zip(expected) {
        found.samples += 1;
        found.exact += (a == b) as usize;
        found.largest = found.largest.max((a - b).abs() / scale(*b));
    }
}

fn agreement(made: &Export, tile: &CalibrationTile, found: &mut BTreeMap<&'static str, Agreement>) {
    let (graph, program) = (&made.graph, &made.program);
    let recorded = record(made, tile);
    let maps = program.tensor_of.iter().map(|&t| recorded[t as usize].clone()).collect();
    let emulator = Emulator { graph, program, maps };
    for operator in &program.operators {
        let codes = &recorded[operator.output() as usize];
        let Some(id) = program.tensor_of.iter().position(|&t| t == operator.output()) else {
            let small = program.tensor_of.iter().position(|&t| Some(t) == operator.inputs()[0]).unwrap();
            compare(found.entry(operator.name()).or_default(), codes, &emulator.upsampled(small), |_| 1.0);
            continue;
        };
        let hi = program.codes[id].hi as f64;
        let (kind, step) = match &graph.nodes[id].operation {
            _ if id == graph.output() => ("head", 0.0),
            Operation::Conv { activation: Activation::Gelu, .. } => ("gelu", 1.0),
            Operation::Attention { .. } => ("attention", (hi / 512.0).max(1.0)),
            Operation::LayerNorm { .. } => (operator.name(), (hi / 8192.0).max(1.0)),
            _ => (operator.name(), 1.0),
        };
        let scale = |expected: f64| if kind == "head" { expected.abs().max(1.0) } else { step };
        compare(found.entry(kind).or_default(), codes, &emulator.node(id), scale);
    }
}

fn networks() -> [NetConfig; 7] {
    let small = small_config();
    [
        small.clone(),
        NetConfig { head: OutputHead::Residual, window: 5, ..small.clone() },
        NetConfig { image_encoder: ImageEncoderKind::Resnet, ..small.clone() },
        NetConfig { decoder_kind: DecoderKind::Upb, window: 4, ..small.clone() },
        NetConfig { use_coarse: false, window: 2, ..small.clone() },
        NetConfig {
            image_encoder: ImageEncoderKind::Resnet,
            use_coarse: false,
            decoder_kind: DecoderKind::Upb,
            ..small.clone()
        },
        NetConfig { detail: 5, detail_inner: 3, detail_blocks: 2, ..small },
    ]
}

#[test]
fn runner_agrees_with_the_emulation_of_every_operator() {
    for precision in [MapBits::Int8, MapBits::Mixed, MapBits::Int16] {
        let mut found = BTreeMap::new();
        for (seed, config) in networks().iter().enumerate() {
            let (made, tile) = random_export(config, (64, 32), precision, seed as u64);
            agreement(&made, &tile, &mut found);
        }
        println!("{precision:?} {found:#?}");
        let wide = precision == MapBits::Int16;
        // Convolutions and norms differ only if the exact value is within the multipliers' rounding of a tie. C²ε is an integer, so the
        // error of a norm of nearly constant pixels is within one step of 8 bits, but only within 1/8192 of a 16-bit range. Logits have 8
        // fraction bits: attention is within one step of 8 bits, and within 1/512 of a 16-bit range.
        let limits = [
            ("conv", 1.0, 0.9999),
            ("up-conv", 1.0, 0.9999),
            // Four fraction bits, rounded once: the codes are always equal.
            ("upsampling", 0.0, 1.0),
            ("layer-norm", 1.0, if wide { 0.9 } else { 0.99 }),
            ("merge-norm", 1.0, if wide { 0.9 } else { 0.98 }),
            ("gelu", 1.0, 0.999),
            ("attention", 1.0, if wide { 0.2 } else { 0.97 }),
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
