//! `host-train train-speed`: measures training steps per second, and how fast their tiles are made.

use elunar_base::{Error, Result};
use elunar_data::prepare::Split;
use elunar_data::source::{DataSpec, VALIDATION_SEED};
use elunar_learn::model::backend::Backend;
use elunar_learn::model::init::initial_weights;
use elunar_learn::model::precision::TrainingPrecision;
use elunar_learn::train::feed::Feed;
use elunar_learn::train::recipe::Recipe;
use elunar_learn::train::speed;
use elunar_net::config::{Preset, config_of, trained_network};
use elunar_net::weights::NetWeights;
use serde_json::json;
use std::path::PathBuf;

/// Options of `train-speed`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Prints one line of JSON. Steps run on one batch of synthetic tiles, so that making tiles does not count. \
With --makers only tiles are made, by so many threads.

Examples:
  host-train train-speed --preset nano --backend cuda --precision bf16
  host-train train-speed --preset nano --makers 16")]
pub struct Args {
    /// Size of the network, and its recipe.
    #[arg(long, default_value = "nano")]
    pub preset: Preset,
    /// Network and its weights [default: random weights of the preset's network].
    #[arg(long, value_name = "W.safetensors")]
    pub start_from: Option<PathBuf>,
    /// Backend of the steps.
    #[arg(long, default_value = "flex", value_parser = Backend::parser())]
    pub backend: Backend,
    /// Number of steps (or batches) that are timed.
    #[arg(long, default_value_t = 20)]
    pub count: usize,
    /// Precision of the steps.
    #[arg(long, value_enum, default_value_t)]
    pub precision: TrainingPrecision,
    /// Make batches with so many threads instead, without a network.
    #[arg(long, value_name = "THREADS")]
    pub makers: Option<usize>,
}

/// Number of steps before the timed ones. A GPU's kernels are compiled and chosen in them.
const UNTIMED: usize = 3;

/// Runs the command.
///
/// # Errors
/// If a number is 0, there is no device or it lacks the precision, or a step fails.
pub fn run(args: &Args) -> Result<()> {
    if args.count == 0 || args.makers == Some(0) {
        return Err(Error::usage("--count and --makers: expected at least 1, found 0"));
    }
    let loaded = args.start_from.as_ref().map(|path| NetWeights::read(path)).transpose()?;
    let network = match (&loaded, &args.start_from) {
        (Some(weights), Some(path)) => config_of(weights, path)?,
        _ => trained_network(args.preset),
    };
    // So many steps that the learning rate stays as it is.
    let recipe = Recipe { steps: 1_000_000_000, precision: args.precision, ..Recipe::preset(args.preset) };
    let tiles = DataSpec::parse(None, VALIDATION_SEED, Split::Train)?.open()?;
    let feed = Feed::new(tiles, network.clone(), recipe.clone(), 0);
    let preset = args.preset.name();
    let batch = json!({ "preset": preset, "batch": recipe.batch, "crop": recipe.crop });
    let line = match args.makers {
        Some(makers) => {
            let batches_per_s = speed::batches(&feed, makers, args.count)?;
            json!({ "makers": makers, "crops_per_tile": recipe.crops_per_tile, "batches_per_s": batches_per_s })
        }
        None => {
            let mut say = |step: usize, loss: f64| {
                if step <= UNTIMED {
                    elunar_base::say::note(&format!("step {step} of {UNTIMED} untimed: loss {loss:.6}"));
                }
            };
            let counts = [UNTIMED, args.count];
            let weights = loaded.unwrap_or_else(|| initial_weights(&network, 0));
            let found = speed::steps(&feed, (&network, &weights), &recipe, args.backend, counts, &mut say)?;
            let mut line = json!({ "backend": args.backend, "precision": recipe.precision, "devices": recipe.devices });
            merge(&mut line, json!(found));
            line
        }
    };
    let mut whole = batch;
    merge(&mut whole, line);
    println!("{whole}");
    Ok(())
}

/// Adds the fields of `more`.
fn merge(line: &mut serde_json::Value, more: serde_json::Value) {
    if let (Some(line), serde_json::Value::Object(more)) = (line.as_object_mut(), more) {
        line.extend(more);
    }
}
