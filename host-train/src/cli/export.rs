//! `host-train export`: float weights in, the int8 runner's model file out.

use crate::export::calibrate::Ground;
use crate::export::report::compare;
use crate::export::{CalibrationTile, Options, Precision, export};
use crate::model::config::NetConfig;
use crate::model::store;
use crate::model::weights::Weights;
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
    /// Print the report as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// From reading weights and tiles, or if the network does not fit the runner; no file is left behind then.
pub fn run(args: Args) -> Result<()> {
    let weights = Weights::read(&args.weights)?;
    let config = store::config_of(&weights, &args.weights)?;
    let source = DataSpec::parse(Some(args.calibrate.clone()), SYNTH_SEED, Split::Train)?.open()?;
    let tiles = calibration_tiles(source.as_ref(), &config, 0, args.tiles)?;
    let options = Options { tile: (TILE_ROWS, TILE_COLS), precision: args.precision, name: name(&args.output) };
    let bar = bar("calibrating", args.tiles);
    let made = export(&config, &weights, &args.weights, &tiles, &options, |done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    let held_out = calibration_tiles(source.as_ref(), &config, args.tiles, args.compare)?;
    let bar = self::bar("comparing", args.compare);
    let comparison = compare(&made, &held_out, |done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    let model = Model::new(&made.bytes).map_err(|e| Error::usage(format!("export: {e}")))?;
    atomic_write(&args.output, &made.bytes)?;
    let (flash, ram) = (made.bytes.len(), required(&model));
    if args.json {
        let report = serde_json::json!({
            "flash_bytes": flash, "arena_bytes": ram, "macs": model.macs(), "operators": model.operator_count(),
            "int8_against_float": comparison,
        });
        println!("{report}");
        return Ok(());
    }
    println!("{}: {} operators", args.output.display(), model.operator_count());
    println!("  flash {flash} bytes, arena {ram} bytes, {:.3} GMAC per tile", model.macs() as f64 / 1e9);
    if comparison.tiles > 0 {
        println!("{comparison}");
    }
    Ok(())
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

fn bar(what: &str, len: u64) -> ProgressBar {
    let style = format!("{what} {{bar:40}} {{pos}}/{{len}} tiles, {{per_sec}}, {{eta}} left");
    let style = ProgressStyle::with_template(&style).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(len).with_style(style)
}
