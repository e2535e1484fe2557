//! `elunar export`: makes the model file of the int8 runner from float weights.

use crate::outputs as output;
use crate::picture::costs;
use elunar_base::{Error, Result, atomic_write, progress};
use elunar_core::nn::{Model, required};
use elunar_core::tile::{TILE_COLS, TILE_ROWS};
use elunar_data::calibration::calibration_tiles;
use elunar_data::prepare::Split;
use elunar_data::source::DataSpec;
use elunar_net::config::config_of;
use elunar_net::export::build::build;
use elunar_net::export::calibrate::{Range, calibrate};
use elunar_net::export::choose::{ExportJob, ExportTrial, choose};
use elunar_net::export::codes::wide_by_rule;
use elunar_net::export::compile::finish;
use elunar_net::export::graph::Graph;
use elunar_net::export::report::{RunnerDifferences, compare};
use elunar_net::export::sensitivity::{self, Sensitivity};
use elunar_net::export::{CalibrationTile, CompileOptions, MapBits};
use elunar_net::weights::NetWeights;
use elunar_picture::write_png;
use std::path::{Path, PathBuf};

/// Seed of the synthetic tiles for calibration. No training run uses it by default.
const SYNTH_SEED: u64 = 0xCA11;

/// Options of `export`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Measures the ranges of the network's maps on the first tiles of the calibration data, and compares int8 and float on the tiles \
behind them.

Example:
  elunar export --weights nano.safetensors --calibrate synth -o nano.eld")]
pub struct Args {
    /// Float weights with their configuration.
    #[arg(long, value_name = "W.safetensors")]
    pub weights: PathBuf,
    /// Folder of *_image.tif, *_coarse.tif, *_truth.tif triples, or `synth`.
    #[arg(long, value_name = "DIR|synth", default_value = "synth")]
    pub calibrate: PathBuf,
    /// Model file to write.
    #[arg(short, long, value_name = "M.eld")]
    pub output: PathBuf,
    /// Number of tiles for measuring ranges.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u64).range(1..=4096))]
    pub tiles: u64,
    /// Number of tiles for comparing int8 with float; 0 skips the comparison.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u64).range(0..=4096))]
    pub compare: u64,
    /// Bits of the network's maps.
    #[arg(long, value_enum, default_value = "mixed")]
    pub precision: MapBits,
    /// Measure the effect of each layer's precision: round one map, or the weights of one layer, in the float network.
    #[arg(long)]
    pub sensitivity: bool,
    /// Write the sensitivity to a file: figures (.json) or bars (.png).
    #[arg(long, value_name = "R.json|R.png", requires = "sensitivity")]
    pub report: Vec<PathBuf>,
    /// Choose the maps of 16 bits by their sensitivity: as few as possible, most sensitive first, until the slope error on the tiles of
    /// --compare grows by no more than this, percent.
    #[arg(long, value_name = "PERCENT", requires = "sensitivity", conflicts_with = "precision")]
    pub slope_growth: Option<f64>,
    /// Print the report as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// If weights or tiles cannot be read, or the network does not fit the runner. Then no output file exists.
pub fn run(args: Args) -> Result<()> {
    for report in &args.report {
        output::extension(report, &["json", "png"])?;
    }
    let _owners = output::take_all(std::iter::once(&args.output).chain(&args.report), &[&args.weights])?;
    let weights = NetWeights::read(&args.weights)?;
    let config = config_of(&weights, &args.weights)?;
    let source = DataSpec::parse(Some(args.calibrate.clone()), SYNTH_SEED, Split::Train)?.open()?;
    let tiles = calibration_tiles(source.as_ref(), &config, 0, args.tiles)?;
    let graph = build(&config, &weights, &args.weights, (TILE_ROWS, TILE_COLS))?;
    let bar = progress::bar("calibrating", args.tiles, "tiles");
    let ranges = calibrate(&graph, &tiles, |done| bar.set_position(done as u64))
        .map_err(|error| error.about(&args.weights.display().to_string()))?;
    bar.finish_and_clear();
    let held_out = calibration_tiles(source.as_ref(), &config, args.tiles, args.compare)?;
    let wide = wide_by_rule(&graph, args.precision);
    let mut sensitivity = measure(&args, &graph, &ranges, config.coarse_limit(), &wide, &held_out)?;
    let options = CompileOptions { tile: (TILE_ROWS, TILE_COLS), precision: args.precision, name: name(&args.output) };
    let mut trials = Vec::new();
    let made = if let (Some(sensitivity), Some(percent)) = (&mut sensitivity, args.slope_growth) {
        let job = ExportJob { config: &config, graph: &graph, ranges: &ranges, options: &options, tiles: &held_out };
        let bar = progress::bar("choosing", sensitivity.by_gain().len() as u64, "trials at most");
        let chosen = choose(&job, sensitivity, percent, |done| bar.set_position(done as u64))?;
        bar.finish_and_clear();
        sensitivity.set_wide(&chosen.wide);
        trials = chosen.trials;
        chosen.export
    } else {
        finish(&config, graph.clone(), &ranges, &wide, &options)?
    };
    let bar = progress::bar("comparing", args.compare, "tiles");
    let comparison = compare(&made, &held_out, |done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    let model = Model::new(&made.bytes).map_err(|e| Error::usage(format!("export: {e}")))?;
    if let Some(sensitivity) = &sensitivity {
        write_reports(&args.report, sensitivity)?;
    }
    atomic_write(&args.output, &made.bytes)?;
    print(&args, (&model, &made.bytes), &comparison, sensitivity.as_ref(), &trials);
    Ok(())
}

/// Measures the effect of each layer's precision and, if requested, chooses the maps that keep 16 bits.
fn measure(
    args: &Args,
    graph: &Graph,
    ranges: &[Range],
    coarse_limit: f32,
    wide: &[bool],
    held_out: &[CalibrationTile],
) -> Result<Option<Sensitivity>> {
    if !args.sensitivity {
        return Ok(None);
    }
    let plan = sensitivity::SensitivityPlan::new(graph, ranges, coarse_limit, wide);
    let bar = progress::bar("roundings", plan.roundings() as u64 * args.compare, "roundings");
    let measured = plan.measure(held_out, |done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    Ok(Some(measured))
}

fn write_reports(files: &[PathBuf], sensitivity: &Sensitivity) -> Result<()> {
    for file in files {
        if output::extension(file, &["json", "png"])? == "png" {
            write_png(file, costs(sensitivity)?)?;
        } else {
            let json = serde_json::to_vec_pretty(sensitivity).map_err(|e| Error::usage(format!("export: {e}")))?;
            atomic_write(file, &json)?;
        }
    }
    Ok(())
}

fn print(
    args: &Args,
    (model, bytes): (&Model<'_>, &[u8]),
    comparison: &RunnerDifferences,
    sensitivity: Option<&Sensitivity>,
    trials: &[ExportTrial],
) {
    let (flash, ram) = (bytes.len(), required(model));
    if args.json {
        let report = serde_json::json!({
            "flash_bytes": flash, "arena_bytes": ram, "macs": model.macs(), "operators": model.operator_count(),
            "int8_against_float": comparison, "sensitivity": sensitivity, "trials": trials,
        });
        println!("{report}");
        return;
    }
    println!("{}: {} operators", args.output.display(), model.operator_count());
    println!("  flash {flash} bytes, arena {ram} bytes, {:.3} GMAC per tile", model.macs() as f64 / 1e9);
    if comparison.tiles > 0 {
        println!("{comparison}");
    }
    if let Some(sensitivity) = sensitivity {
        println!("{sensitivity}");
    }
    if !trials.is_empty() {
        println!("chosen:");
    }
    trials.iter().for_each(|trial| println!("{trial}"));
}

fn name(output: &Path) -> String {
    output.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
}
