//! `host-train train`: train a network.

use crate::config::{Configuration, random_weights};
use elunar_base::output::Owner;
use elunar_base::{Error, Result, atomic_write};
use elunar_core::tile::{TILE_COLS, TILE_ROWS};
use elunar_data::prepare::Split;
use elunar_data::source::{DataSpec, TileSource, VALIDATION_SEED};
use elunar_learn::model::backend::Backend;
use elunar_learn::model::init::initial_weights;
use elunar_learn::model::store;
use elunar_learn::stopwatch;
use elunar_learn::train::run::{BEST, COMMAND, LAST, PROFILE, RECORD, Run, RunRecord, TrainingResult, begun};
use elunar_net::config::{NetConfig, Preset, TruthRange, config_of};
use elunar_net::published;
use elunar_net::weights::NetWeights;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Options of `train`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The configuration says what is trained: by default the preset nano; paper and small are the paper's. --print-config shows every \
key, host-train/models/presets/paper.toml explains them, and --set changes one. Ctrl-C writes a checkpoint and stops; --resume \
goes on.

Examples:
  host-train train --preset nano --data synth --out runs/nano
  host-train train --config my.toml --set recipe.pool=64 network.detail=32 --out runs/mine
  host-train train --out runs/nano --resume
  host-train train --preset paper --data tiles/ --validation held-out/ --out runs/paper --backend cuda")]
pub struct Args {
    /// Folder of the run: record, checkpoints, weights, curves.
    #[arg(long, value_name = "RUN", required_unless_present = "print_config")]
    pub out: Option<PathBuf>,
    /// Print the configuration and stop. After a line `preset = ...` it is a file for --config.
    #[arg(long, conflicts_with = "resume")]
    pub print_config: bool,
    /// Continue from the folder's checkpoint. All other options come from its record.
    #[arg(long)]
    pub resume: bool,
    /// Print the time of each part of the steps at the end. It is also written to the run's profile.md.
    #[arg(long)]
    pub profile: bool,
    /// Options of a new run.
    #[command(flatten)]
    pub start: NewRun,
}

/// Options that determine a new run.
#[derive(Debug, Clone, Default, PartialEq, clap::Args)]
pub struct NewRun {
    /// Network, recipe, data and use of a preset [default: nano].
    #[arg(long)]
    pub preset: Option<Preset>,
    /// The configuration of a file instead.
    #[arg(long, value_name = "FILE.toml", conflicts_with = "preset")]
    pub config: Option<PathBuf>,
    /// Change keys of the configuration, as recipe.crop=[64,64] network.head=relu.
    #[arg(long = "set", value_name = "KEY=VALUE", num_args = 1..)]
    pub settings: Vec<String>,
    /// `synth`, a folder of `prepare`, or a folder of *_image.tif, *_coarse.tif, *_truth.tif triples [default: the configuration's].
    #[arg(long, value_name = "DIR|synth")]
    pub data: Option<PathBuf>,
    /// Tiles for validation: `synth` (a Moon of another seed) or a folder [default: the configuration's; the validation tiles of a prepared
    /// folder, otherwise synth].
    #[arg(long, value_name = "DIR|synth")]
    pub validation: Option<PathBuf>,
    /// Seed of weights, data and cropping [default: the configuration's].
    #[arg(long)]
    pub seed: Option<u64>,
    /// Number of optimiser steps [default: the configuration's].
    #[arg(long)]
    pub steps: Option<usize>,
    /// Number of tiles or crops per step [default: the configuration's].
    #[arg(long)]
    pub batch: Option<usize>,
    /// Learning rate at the start of the cosine [default: the configuration's].
    #[arg(long)]
    pub learning_rate: Option<f64>,
    /// Start from these weights and their network, instead of random weights.
    #[arg(long, value_name = "W.safetensors")]
    pub start_from: Option<PathBuf>,
    /// Start the image encoder from a published Swin checkpoint (timm or original names).
    #[arg(long, value_name = "SWIN.safetensors")]
    pub swin: Option<PathBuf>,
    /// Backend [default: flex].
    #[arg(long, value_parser = Backend::parser())]
    pub backend: Option<Backend>,
}

/// Runs the command.
///
/// # Errors
/// If options contradict each other, data or weights cannot be read, or the run fails.
pub fn run(args: Args) -> Result<()> {
    let run = match &args.out {
        Some(out) if args.resume => resume(&args.start, out)?,
        Some(out) if !args.print_config => start(args.start, out)?,
        _ => {
            let (configuration, _) = configured(&args.start)?;
            print!("{}", configuration.text()?);
            return Ok(());
        }
    };
    let (record, folder) = (run.record.clone(), run.folder.clone());
    elunar_base::say::note(&format!(
        "{}: {} parameters, {} steps of {} crops {}x{}, {}",
        folder.display(),
        parameters(&store::outline(&record.network, &Backend::Flex.device()?)),
        record.recipe.steps,
        record.recipe.batch,
        record.recipe.crop[0],
        record.recipe.crop[1],
        record.backend.name()
    ));
    say(&*run.training, "training");
    say(&*run.validation, "validation");
    let begun = Instant::now();
    if args.profile {
        stopwatch::start();
    }
    let outcome = run.train()?;
    report(&folder, &outcome);
    if args.profile {
        profile(&folder, &outcome, begun.elapsed())?;
    }
    if outcome.finished {
        return Ok(());
    }
    let at = folder.display();
    Err(Error::stopped(format!(
        "stopped after step {}; go on with: host-train train --out {at} --resume",
        outcome.steps
    )))
}

/// Says how many tiles a source has, and which images give none.
fn say(source: &dyn TileSource, what: &str) {
    if let Some(count) = source.count() {
        elunar_base::say::note(&format!("{what}: {count} tiles"));
    }
    for image in source.unused() {
        elunar_base::say::warning(&format!(
            "{}: no {TILE_ROWS}x{TILE_COLS} pixels of image, DTM and coarse DTM are valid; {what} does not use it",
            image.display()
        ));
    }
}

fn profile(folder: &Path, outcome: &TrainingResult, wall: Duration) -> Result<()> {
    let threads = rayon::current_num_threads();
    let steps = outcome.steps_here;
    let text = format!("{steps} steps, {threads} threads\n\n{}", stopwatch::table(steps, wall));
    print!("\n{text}");
    let _owner = Owner::of_folder(folder, COMMAND, [PROFILE.into()])?;
    atomic_write(&folder.join(PROFILE), text.as_bytes())
}

/// Returns the number of trainable parameters: all numbers except the running statistics.
fn parameters(shapes: &BTreeMap<String, Vec<usize>>) -> usize {
    let trainable = shapes.iter().filter(|(name, _)| !name.contains(".running_"));
    trainable.map(|(_, shape)| shape.iter().product::<usize>()).sum()
}

fn report(folder: &Path, outcome: &TrainingResult) {
    println!("{} steps done, {:.2} steps/s", outcome.steps, outcome.steps_per_s);
    if let Some(v) = outcome.best.or(outcome.last) {
        println!("validation: RMSE {:.3} m, slope error {:.3}°", v.network.rmse_m, v.network.slope_mae_deg);
        if let Some(untrained) = v.untrained {
            println!("untrained:  RMSE {:.3} m, slope error {:.3}°", untrained.rmse_m, untrained.slope_mae_deg);
        }
        println!("coarse DTM: RMSE {:.3} m, slope error {:.3}°", v.coarse.rmse_m, v.coarse.slope_mae_deg);
    }
    println!("{}", weights(folder));
}

/// Names the weights of a run. One that was stopped before its first validation has no best ones.
fn weights(folder: &Path) -> String {
    let at = folder.display();
    let best =
        if folder.join(BEST).is_file() { format!("{at}/{BEST} (lowest validation RMSE), ") } else { String::new() };
    format!("weights: {best}{at}/{LAST}")
}

fn resume(start: &NewRun, out: &Path) -> Result<Run> {
    if *start != NewRun::default() {
        return Err(Error::usage("--resume takes everything from the run's record: leave out all options but --out"));
    }
    if !out.join(RECORD).exists() {
        let what = "expected a run to resume, found none; a run that was stopped before its first checkpoint begins anew without --resume";
        return Err(Error::usage(format!("{}: {what}", out.display())));
    }
    let record = RunRecord::read(out)?;
    let initial = if begun(out) { None } else { Some(again(&record, out)?) };
    let (training, validation) = (record.data.open()?, record.validation_data.open()?);
    Ok(Run { folder: out.into(), record, initial, training, validation, stop_after: None })
}

/// Returns the initial weights of a run that has a record alone, as older programs left them: made again if they were random.
fn again(record: &RunRecord, out: &Path) -> Result<NetWeights> {
    if record.started_from == random_weights(record.seed) {
        elunar_base::say::note(&format!("{}: no checkpoint yet, beginning anew", out.display()));
        return Ok(initial_weights(&record.network, record.seed));
    }
    let what = format!("expected a checkpoint, found none, and the run started from {}", record.started_from);
    Err(Error::usage(format!("{}: {what}; give its options again without --resume to begin anew", out.display())))
}

/// Returns the network with the NR of a prepared set (Eq. 1), and says so. Other data, and networks whose heights have no range, change
/// nothing.
fn in_range_of(network: NetConfig, data: &DataSpec) -> Result<NetConfig> {
    let nr = if network.target_range == TruthRange::Pixel { None } else { data.nr()? };
    let Some(nr) = nr else { return Ok(network) };
    let network = NetConfig { nr, ..network };
    network.check().map_err(Error::usage)?;
    elunar_base::say::note(&format!(
        "NR {nr:.2}: that of the prepared tiles (Eq. 1); --set network.nr=... takes another"
    ));
    Ok(network)
}

/// Returns the configuration that the options state, and the weights to start from, if there are any.
fn configured(start: &NewRun) -> Result<(Configuration, Option<NetWeights>)> {
    let mut made = match &start.config {
        Some(path) => Configuration::read(path)?,
        None => Configuration::preset(start.preset.unwrap_or(Preset::Nano))?,
    };
    let loaded = start.start_from.as_ref().map(|path| NetWeights::read(path)).transpose()?;
    if let (Some(weights), Some(path)) = (&loaded, &start.start_from) {
        made.network = config_of(weights, path)?;
    }
    if let Some(seed) = start.seed {
        made.seed = seed;
        if let DataSpec::Synth { seed: moon, .. } = &mut made.data {
            *moon = seed;
        }
    }
    if start.data.is_some() {
        made.data = DataSpec::parse(start.data.clone(), made.seed, Split::Train)?;
    }
    if start.validation.is_some() {
        let seed = made.seed.wrapping_add(VALIDATION_SEED);
        made.validation_data = Some(DataSpec::parse(start.validation.clone(), seed, Split::Validation)?);
    }
    let typed = [
        ("steps", start.steps.map(|n| n.to_string())),
        ("batch", start.batch.map(|n| n.to_string())),
        ("learning_rate", start.learning_rate.map(|rate| format!("{rate:e}"))),
    ];
    let typed = typed.into_iter().filter_map(|(key, value)| value.map(|value| format!("recipe.{key}={value}")));
    for setting in typed.chain(start.settings.iter().cloned()) {
        made = made.set(&setting)?;
    }
    if loaded.is_none() && !start.settings.iter().any(|setting| setting.trim_start().starts_with("network.nr")) {
        made.network = in_range_of(made.network, &made.data)?;
    }
    made.check().map_err(Error::usage)?;
    Ok((made, loaded))
}

/// Makes a new run from the options.
///
/// # Errors
/// If options contradict each other, or data or weights cannot be read.
pub fn start(start: NewRun, out: &Path) -> Result<Run> {
    let (configuration, loaded) = configured(&start)?;
    let mut started_from = match &start.start_from {
        Some(path) => path.display().to_string(),
        None => configuration.random_weights(),
    };
    let mut initial = loaded.unwrap_or_else(|| initial_weights(&configuration.network, configuration.seed));
    if let Some(path) = &start.swin {
        published::load_swin(&mut initial, &NetWeights::read(path)?, path)?;
        started_from += &format!(", image encoder {}", path.display());
    }
    let record = configuration.record(start.backend.unwrap_or(Backend::Flex), started_from);
    let (training, validation) = (record.data.open()?, record.validation_data.open()?);
    Ok(Run { folder: out.into(), record, initial: Some(initial), training, validation, stop_after: None })
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_data::prepare::PrepareOptions;
    use elunar_data::prepare::manifest::{FORMAT, MANIFEST};
    use elunar_net::config::trained_network;
    use elunar_synth::SynthOptions;
    use serde_json::json;

    #[test]
    fn only_weights_that_exist_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().display();
        assert_eq!(weights(folder.path()), format!("weights: {at}/{LAST}"));
        std::fs::write(folder.path().join(BEST), "").unwrap();
        assert_eq!(weights(folder.path()), format!("weights: {at}/{BEST} (lowest validation RMSE), {at}/{LAST}"));
    }

    #[test]
    fn a_prepared_set_gives_its_nr() {
        let folder = tempfile::tempdir().unwrap();
        let manifest = json!({
            "format": FORMAT, "made_by": "test", "tile": [256, 320], "parameters": PrepareOptions::default(), "nr": 37.5,
            "three_sigma": { "mean_m": 1.0, "sigma_m": 2.0 }, "tiles": 2, "kept": 2, "dropped": {}, "divided_by": "site",
            "splits": {}, "scenes": [],
        });
        std::fs::write(folder.path().join(MANIFEST), manifest.to_string()).unwrap();
        let data = DataSpec::parse(Some(folder.path().into()), 0, Split::Train).unwrap();
        let [paper, nano] = [Preset::Paper, Preset::Nano].map(trained_network);
        assert_eq!(in_range_of(paper.clone(), &data).unwrap(), NetConfig { nr: 37.5, ..paper.clone() });
        // Heights in pixels have no range.
        assert_eq!(in_range_of(nano.clone(), &data).unwrap(), nano);
        let moon = DataSpec::parse(None, 0, Split::Train).unwrap();
        assert_eq!(in_range_of(paper.clone(), &moon).unwrap(), paper);
    }

    #[test]
    fn a_moon_has_the_options_of_its_file_and_the_others_of_the_training_moon() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/models/wide-moon.toml");
        let of = |config: Option<&str>| {
            let start = NewRun { config: config.map(Into::into), seed: Some(7), ..NewRun::default() };
            configured(&start).unwrap().0
        };
        let (plain, found) = (of(None), of(Some(path)));
        let DataSpec::Synth { options, .. } = plain.data else { panic!("no Moon") };
        let wide = SynthOptions { complex_craters: 0.35, albedo_features: 0.5, ..options };
        assert_eq!(found.data, DataSpec::Synth { seed: 7, options: wide.clone() });
        assert_eq!(found.validation(), DataSpec::Synth { seed: 7 + VALIDATION_SEED, options: wide });
        assert_eq!((found.network, found.recipe), (plain.network, plain.recipe));
    }

    #[test]
    fn a_run_that_was_killed_before_its_first_checkpoint_is_no_dead_end() {
        let folder = tempfile::tempdir().unwrap();
        let resume = || resume(&NewRun::default(), folder.path());
        let refused = || resume().err().expect("an error").to_string();
        assert!(refused().contains("begins anew without --resume"), "{}", refused());
        let run = start(NewRun { seed: Some(3), ..NewRun::default() }, folder.path()).unwrap();
        let write = |record: &RunRecord| {
            std::fs::write(folder.path().join(RECORD), serde_json::to_vec(record).unwrap()).unwrap()
        };
        write(&run.record);
        let again = resume().unwrap();
        assert!(again.record == run.record && again.initial.unwrap().to_bytes() == run.initial.unwrap().to_bytes());
        // Weights from a file are not made again.
        write(&RunRecord { started_from: "w.safetensors".into(), ..run.record });
        assert!(
            refused().contains("the run started from w.safetensors; give its options again without --resume"),
            "{}",
            refused()
        );
    }
}
