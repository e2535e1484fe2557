//! All stages of the export in order, from weights to the bytes of a model file.

use super::build::build;
use super::calibrate::{CalibrationTile, Range, calibrate};
use super::codes::{MapBits, wide_by_rule};
use super::graph::{Graph, Operation};
use super::plan::order_and_plan;
use super::quantise::{Program, quantise};
use crate::config::NetConfig;
use crate::weights::NetWeights;
use elunar_base::{Error, Result};
use elunar_core::nn::file::{Content, NONE, Operator};
use elunar_core::nn::{Model, Progress, Runner, required};
use std::path::Path;

/// Seed of every self-test tile.
const SELF_TEST_SEED: u32 = 0x454c_4431;

/// Options of an export.
#[derive(Debug, Clone)]
pub struct CompileOptions {
    /// Tile rows and columns, multiples of 32.
    pub tile: (usize, usize),
    /// Bits of the maps.
    pub precision: MapBits,
    /// Name stored in the file.
    pub name: String,
}

/// A finished export.
#[derive(Debug, Clone)]
pub struct Export {
    /// The model file.
    pub bytes: Vec<u8>,
    /// The network before quantisation.
    pub graph: Graph,
    /// The quantised network.
    pub program: Program,
}

/// Compiles a network: builds, calibrates, quantises, plans, writes, and runs the self test to store its result. Messages call the weights
/// `path`. Calls `progress` with the number of calibration tiles done.
///
/// # Errors
/// As [`build`](super::build::build), [`calibrate`](super::calibrate::calibrate), [`quantise`](super::quantise::quantise); [`Error::Input`]
/// if the runner would refuse the result (a network beyond its limits).
pub fn export(
    config: &NetConfig,
    weights: &NetWeights,
    path: &Path,
    tiles: &[CalibrationTile],
    options: &CompileOptions,
    progress: impl Fn(usize),
) -> Result<Export> {
    let graph = build(config, weights, path, options.tile)?;
    let ranges = calibrate(&graph, tiles, progress)?;
    let wide = wide_by_rule(&graph, options.precision);
    finish(config, graph, &ranges, &wide, options)
}

/// Runs the stages after calibration. `wide` says which maps keep 16 bits (see [`quantise`]). If it differs from the rule of
/// `options.precision`, the file calls its precision "chosen".
///
/// # Errors
/// As [`export`].
pub fn finish(
    config: &NetConfig,
    graph: Graph,
    ranges: &[Range],
    wide: &[bool],
    options: &CompileOptions,
) -> Result<Export> {
    let mut program = quantise(&graph, ranges, config.coarse_limit(), wide)?;
    let roles = roles(&graph, &program);
    let schedule = order_and_plan(&mut program.tensors, &program.operators, &roles[..2], roles[2]);
    let by_rule = wide == wide_by_rule(&graph, options.precision);
    let precision = if by_rule { format!("{:?}", options.precision).to_lowercase() } else { "chosen".into() };
    let text = text(config, &program, &options.name, &precision);
    let mut content = Content {
        text: &text,
        tensors: &program.tensors,
        operators: &program.operators,
        schedule: &schedule,
        constants: &program.constants,
        tile: options.tile,
        nr: config.nr,
        range_margin: config.range_margin,
        truth_range: config.target_range,
        illumination: config.illumination,
        roles,
        self_test: (SELF_TEST_SEED, 0),
        alignment: 8,
    };
    content.self_test.1 = self_test(&file_bytes(&content)?)?;
    let bytes = file_bytes(&content)?;
    Ok(Export { bytes, graph, program })
}

/// Returns the numbers of the image, coarse and output tensors. The number of the coarse codes is set only if an operator reads them.
fn roles(graph: &Graph, program: &Program) -> [u32; 3] {
    let read = |t: &u32| program.operators.iter().any(|op| op.inputs().contains(&Some(*t)));
    let coarse = graph.nodes.iter().position(|node| node.operation == Operation::Coarse);
    let coarse = coarse.map(|id| program.tensor_of[id]).filter(read).unwrap_or(NONE);
    let output = program.operators.last().map_or(NONE, Operator::output);
    [program.tensor_of[0], coarse, output]
}

fn text(config: &NetConfig, program: &Program, name: &str, precision: &str) -> String {
    serde_json::json!({
        "name": name,
        "config": config,
        "precision": precision,
        "operators": program.names,
    })
    .to_string()
}

fn file_bytes(content: &Content<'_>) -> Result<Vec<u8>> {
    let mut bytes = vec![0; content.file_bytes()];
    let written = content.write(&mut bytes);
    written.ok_or_else(|| Error::input(format!("export: expected a file below 4 GiB, found {} bytes", bytes.len())))?;
    Ok(bytes)
}

/// Returns the checksum of the self-test tile's output.
fn self_test(bytes: &[u8]) -> Result<u32> {
    let model =
        Model::new(bytes).map_err(|e| Error::input(format!("export: the network is beyond the runner: {e}")))?;
    let mut arena = vec![0; required(&model)];
    let fault = |e| Error::input(format!("export: self test: {e}"));
    let mut runner = Runner::new(model, &mut arena).map_err(fault)?;
    runner.begin_self_test().map_err(fault)?;
    while runner.step(u64::MAX).map_err(fault)? == Progress::Running {}
    runner.output_crc().map_err(fault)
}
