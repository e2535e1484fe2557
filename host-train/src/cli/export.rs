//! `host-train export`: float weights in, the int8 runner's model file out.

use super::output;
use crate::export::build::build;
use crate::export::calibrate::{Ground, Range, calibrate};
use crate::export::choose::{Job, Trial, choose};
use crate::export::codes::wide_by_rule;
use crate::export::compile::finish;
use crate::export::graph::Graph;
use crate::export::report::{Comparison, compare};
use crate::export::sensitivity::{self, Sensitivity};
use crate::export::{CalibrationTile, Options, Precision, costs};
use crate::model::config::NetConfig;
use crate::model::store;
use crate::model::weights::Weights;
use crate::picture::write_png;
use crate::prepare::Split;
use crate::raster::atomic_write;
use crate::train::feed::TileSource;
use crate::train::sample::{RawTile, Sample};
use crate::train::source::DataSpec;
use crate::{Error, Result};
use elunar_core::nn::{Model, required};
use elunar_core::tile::{TILE_COLS, TILE_ROWS};
use indicatif::{ProgressBar, ProgressStyle};
use std::path::{Path, PathBuf};

/// Seed of the synthetic tiles for calibration: no training run uses it by default.
const SYNTH_SEED: u64 = 0xCA11;

/// Options of `export`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:
  host-train export --weights nano.safetensors --calibrate synth -o nano.eld

Ranges are measured on the first tiles of the calibration data; the report compares int8 and float on the tiles behind them.")]
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
    /// Tiles to measure ranges on.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u64).range(1..=4096))]
    pub tiles: u64,
    /// Tiles to compare int8 and float on; 0 skips the comparison.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u64).range(0..=4096))]
    pub compare: u64,
    /// Bits that maps keep.
    #[arg(long, value_enum, default_value = "mixed")]
    pub precision: Precision,
    /// Measure what each layer's precision costs: round one map, or the weights of one layer, in the float network.
    #[arg(long)]
    pub sensitivity: bool,
    /// Write the sensitivity to files: figures (.json) or bars (.png).
    #[arg(long, value_name = "R.json|R.png", requires = "sensitivity")]
    pub report: Vec<PathBuf>,
    /// Choose the maps of 16 bits by their sensitivity instead: the fewest, most sensitive first, with which the slope error on
    /// the tiles of --compare grows by no more than so many percent.
    #[arg(long, value_name = "PERCENT", requires = "sensitivity", conflicts_with = "precision")]
    pub slope_growth: Option<f64>,
    /// Print the report as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// From reading weights and tiles, or if the network does not fit the runner; no file is left behind then.
pub fn run(args: Args) -> Result<()> {
    for report in &args.report {
        output::extension(report, &["json", "png"])?;
        output::check(report, &[&args.weights])?;
    }
    let weights = Weights::read(&args.weights)?;
    let config = store::config_of(&weights, &args.weights)?;
    let source = DataSpec::parse(Some(args.calibrate.clone()), SYNTH_SEED, Split::Train)?.open()?;
    let tiles = calibration_tiles(source.as_ref(), &config, 0, args.tiles)?;
    let graph = build(&config, &weights, &args.weights, (TILE_ROWS, TILE_COLS))?;
    let bar = bar("calibrating", args.tiles, "tiles");
    let ranges = calibrate(&graph, &tiles, |done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    let held_out = calibration_tiles(source.as_ref(), &config, args.tiles, args.compare)?;
    let wide = wide_by_rule(&graph, args.precision);
    let mut sensitivity = measure(&args, &graph, &ranges, config.coarse_limit(), &wide, &held_out)?;
    let options = Options { tile: (TILE_ROWS, TILE_COLS), precision: args.precision, name: name(&args.output) };
    let mut trials = Vec::new();
    let made = if let (Some(sensitivity), Some(percent)) = (&mut sensitivity, args.slope_growth) {
        let job = Job { config: &config, graph: &graph, ranges: &ranges, options: &options, tiles: &held_out };
        let bar = self::bar("choosing", sensitivity.by_gain().len() as u64, "trials at most");
        let chosen = choose(&job, sensitivity, percent, |done| bar.set_position(done as u64))?;
        bar.finish_and_clear();
        sensitivity.set_wide(&chosen.wide);
        trials = chosen.trials;
        chosen.export
    } else {
        finish(&config, graph.clone(), &ranges, &wide, &options)?
    };
    let bar = self::bar("comparing", args.compare, "tiles");
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

/// What each layer's precision costs, and if asked for, the choice of those that keep 16 bits.
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
    let plan = sensitivity::Plan::new(graph, ranges, coarse_limit, wide);
    let bar = bar("roundings", plan.roundings() as u64 * args.compare, "roundings");
    let measured = plan.measure(held_out, |done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    Ok(Some(measured))
}

fn write_reports(files: &[PathBuf], sensitivity: &Sensitivity) -> Result<()> {
    for file in files {
        if output::extension(file, &["json", "png"])? == "png" {
            write_png(file, costs::picture(sensitivity)?)?;
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
    comparison: &Comparison,
    sensitivity: Option<&Sensitivity>,
    trials: &[Trial],
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

/// Tiles `first..first + count` of a source, normalised as the network wants them.
///
/// # Errors
/// If a tile cannot be made or has the wrong size; tiles without relief are skipped.
pub fn calibration_tiles(
    source: &dyn TileSource,
    config: &NetConfig,
    first: u64,
    count: u64,
) -> Result<Vec<CalibrationTile>> {
    (first..first + count)
        .map(|index| {
            let raw = source.tile(index)?;
            if (raw.rows, raw.cols) != (TILE_ROWS, TILE_COLS) {
                let found = (raw.rows, raw.cols);
                return Err(Error::usage(format!("tile {index}: expected {TILE_ROWS} x {TILE_COLS}, found {found:?}")));
            }
            calibration_tile(config, &raw.lit_for(config.illumination))
        })
        .collect()
}

fn calibration_tile(config: &NetConfig, raw: &RawTile) -> Result<CalibrationTile> {
    let sample = Sample::new(config, raw)?;
    let mut truth = vec![0.0; raw.truth_m.len()];
    let bad = |e| Error::usage(format!("tile cannot be normalised: {e}"));
    sample.scale.normalise(&raw.truth_m, &mut truth).map_err(bad)?;
    let ground = Ground { metres_per_unit: sample.scale.metres_per_unit(), pixel_m: raw.pixel_m, truth };
    Ok(CalibrationTile { image: sample.image, coarse: sample.coarse, ground: Some(ground) })
}

fn name(output: &Path) -> String {
    output.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
}

fn bar(what: &str, len: u64, unit: &str) -> ProgressBar {
    let style = format!("{what} {{bar:40}} {{pos}}/{{len}} {unit}, {{per_sec}}, {{eta}} left");
    let style = ProgressStyle::with_template(&style).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(len).with_style(style)
}
