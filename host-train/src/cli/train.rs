//! `host-train train`: train a network.

use crate::toml_file;
use elunar_core::tile::{TILE_COLS, TILE_ROWS};
use elunar_learn::model::backend::Backend;
use elunar_learn::model::init::initial_weights;
use elunar_learn::model::store;
use elunar_learn::stopwatch;
use elunar_learn::train::recipe::{Recipe, RecipeFlags};
use elunar_learn::train::run::{BEST, COMMAND, LAST, Outcome, PROFILE, RECORD, Record, Run, begun};
use elunar_net::config::{NetConfig, Preset, Switches, TruthRange, config_of, trained_network};
use elunar_net::published;
use elunar_net::weights::Weights;
use elunar_raster::output::Owner;
use elunar_raster::{Error, Result, atomic_write};
use elunar_scene::data::source::{DataSpec, TileSource, VALIDATION_SEED};
use elunar_scene::prepare::Split;
use elunar_synth::SynthOptions;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Options of `train`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The paper's network and recipe are those of the presets paper and small. The presets tiny and nano depart from it: head \
residual, target range pixel, illumination weighed, batch-norm momentum 0.02, target anchored. Ctrl-C writes a checkpoint and \
stops; --resume goes on.

Examples:
  host-train train --preset nano --data synth --out runs/nano
  host-train train --out runs/nano --resume
  host-train train --preset paper --data tiles/ --validation held-out/ --out runs/paper --backend cuda")]
pub struct Args {
    /// Folder of the run: record, checkpoints, weights, curves.
    #[arg(long, value_name = "RUN")]
    pub out: PathBuf,
    /// Continue from the folder's checkpoint. All other options come from its record.
    #[arg(long)]
    pub resume: bool,
    /// Print the time of each part of the steps at the end. It is also written to the run's profile.md.
    #[arg(long)]
    pub profile: bool,
    /// Options of a new run.
    #[command(flatten)]
    pub start: Start,
}

/// Options that determine a new run.
#[derive(Debug, Clone, Default, PartialEq, clap::Args)]
pub struct Start {
    /// Size of the network, and its recipe [default: nano].
    #[arg(long)]
    pub preset: Option<Preset>,
    /// `synth`, a folder of `prepare`, or a folder of *_image.tif, *_coarse.tif, *_truth.tif triples [default: synth].
    #[arg(long, value_name = "DIR|synth")]
    pub data: Option<PathBuf>,
    /// Tiles for validation: `synth` (a Moon of another seed) or a folder [default: the validation tiles of a prepared folder, otherwise
    /// synth].
    #[arg(long, value_name = "DIR|synth")]
    pub validation: Option<PathBuf>,
    /// Options of the synthetic Moon that differ from those of the training Moon (keys of `SynthOptions`).
    #[arg(long, value_name = "MOON.toml")]
    pub moon: Option<PathBuf>,
    /// Seed of weights, data and cropping [default: 0].
    #[arg(long)]
    pub seed: Option<u64>,
    /// Start from these weights and their configuration, instead of random weights.
    #[arg(long, value_name = "W.safetensors")]
    pub start_from: Option<PathBuf>,
    /// Start the image encoder from a published Swin checkpoint (timm or original names).
    #[arg(long, value_name = "SWIN.safetensors")]
    pub swin: Option<PathBuf>,
    /// Backend [default: flex].
    #[arg(long, value_parser = Backend::parser())]
    pub backend: Option<Backend>,
    /// Changes to the preset's recipe.
    #[command(flatten)]
    pub recipe: RecipeFlags,
    /// Changes to the preset's network.
    #[command(flatten)]
    pub switches: Switches,
}

/// Runs the command.
///
/// # Errors
/// If options contradict each other, data or weights cannot be read, or the run fails.
pub fn run(args: Args) -> Result<()> {
    let run = if args.resume { resume(&args)? } else { start(args.start, &args.out)? };
    let (record, folder) = (run.record.clone(), run.folder.clone());
    eprintln!(
        "{}: {} parameters, {} steps of {} crops {}x{}, {}",
        folder.display(),
        parameters(&store::outline(&record.network, &Backend::Flex.device()?)),
        record.recipe.steps,
        record.recipe.batch,
        record.recipe.crop[0],
        record.recipe.crop[1],
        record.backend.name()
    );
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
        eprintln!("{what}: {count} tiles");
    }
    for image in source.unused() {
        eprintln!(
            "WARNING: {}: no {TILE_ROWS}x{TILE_COLS} pixels of image, DTM and coarse DTM are valid; {what} does not use it",
            image.display()
        );
    }
}

fn profile(folder: &Path, outcome: &Outcome, wall: Duration) -> Result<()> {
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

fn report(folder: &Path, outcome: &Outcome) {
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

fn resume(args: &Args) -> Result<Run> {
    if args.start != Start::default() {
        return Err(Error::usage("--resume takes everything from the run's record: leave out all options but --out"));
    }
    if !args.out.join(RECORD).exists() {
        let what = "expected a run to resume, found none; a run that was stopped before its first checkpoint begins anew without --resume";
        return Err(Error::usage(format!("{}: {what}", args.out.display())));
    }
    let record = Record::read(&args.out)?;
    let initial = if begun(&args.out) { None } else { Some(again(&record, &args.out)?) };
    let (training, validation) = (record.data.open()?, record.validation_data.open()?);
    Ok(Run { folder: args.out.clone(), record, initial, training, validation, stop_after: None })
}

/// Returns the initial weights of a run that has a record alone, as older programs left them: made again if they were random.
fn again(record: &Record, out: &Path) -> Result<Weights> {
    if record.started_from == random(record.seed) {
        eprintln!("{}: no checkpoint yet, beginning anew", out.display());
        return Ok(initial_weights(&record.network, record.seed));
    }
    let what = format!("expected a checkpoint, found none, and the run started from {}", record.started_from);
    Err(Error::usage(format!("{}: {what}; give its options again without --resume to begin anew", out.display())))
}

/// Returns what a record says of random weights.
fn random(seed: u64) -> String {
    format!("random weights, seed {seed}")
}

/// Returns the network with the NR of a prepared set (Eq. 1), and says so. Other data, and networks whose heights have no range, change
/// nothing.
fn in_range_of(network: NetConfig, data: &DataSpec) -> Result<NetConfig> {
    let nr = if network.target_range == TruthRange::Pixel { None } else { data.nr()? };
    let Some(nr) = nr else { return Ok(network) };
    let network = NetConfig { nr, ..network };
    network.check().map_err(Error::usage)?;
    eprintln!("NR {nr:.2}: that of the prepared tiles (Eq. 1); --nr takes another");
    Ok(network)
}

/// Returns the synthetic Moon with the options that a file states.
fn on_moon(data: DataSpec, path: &Path) -> Result<DataSpec> {
    let DataSpec::Synth { seed, options } = data else {
        return Err(Error::usage("--moon: expected with the synthetic Moon alone, --data names a folder"));
    };
    // Alone they are read first, so that an error has its line.
    toml_file::read::<SynthOptions>(path)?;
    let wrong = |e: &dyn std::fmt::Display| Error::broken(path, e.to_string());
    let mut all = toml::Table::try_from(&options).map_err(|e| wrong(&e))?;
    all.extend(toml_file::read::<toml::Table>(path)?);
    let options: SynthOptions = all.try_into().map_err(|e: toml::de::Error| wrong(&e))?;
    options.validate().map_err(|e| e.about(&path.display().to_string()))?;
    Ok(DataSpec::Synth { seed, options })
}

/// Makes a new run from the options.
///
/// # Errors
/// If options contradict each other, or data or weights cannot be read.
pub fn start(start: Start, out: &Path) -> Result<Run> {
    let preset = start.preset.unwrap_or(Preset::Nano);
    let seed = start.seed.unwrap_or(0);
    let loaded = start.start_from.as_ref().map(|path| Weights::read(path)).transpose()?;
    let network = match (&loaded, &start.start_from) {
        (Some(weights), Some(path)) => config_of(weights, path)?,
        _ => trained_network(preset),
    };
    let data = DataSpec::parse(start.data, seed, Split::Train)?;
    let data = match &start.moon {
        Some(path) => on_moon(data, path)?,
        None => data,
    };
    let mut network = start.switches.apply(network)?;
    if loaded.is_none() && start.switches.nr.is_none() {
        network = in_range_of(network, &data)?;
    }
    let mut started_from = match &start.start_from {
        Some(path) => path.display().to_string(),
        None => random(seed),
    };
    let mut initial = loaded.unwrap_or_else(|| initial_weights(&network, seed));
    if let Some(path) = &start.swin {
        published::load_swin(&mut initial, &Weights::read(path)?, path)?;
        started_from += &format!(", image encoder {}", path.display());
    }
    // The validation Moon and the training Moon share only their statistics.
    let validation_seed = seed.wrapping_add(VALIDATION_SEED);
    let validation_data = match start.validation {
        None => data.validation(validation_seed),
        named => DataSpec::parse(named, validation_seed, Split::Validation)?,
    };
    let record = Record {
        network,
        recipe: start.recipe.apply(Recipe::preset(preset))?,
        data,
        validation_data,
        seed,
        backend: start.backend.unwrap_or(Backend::Flex),
        started_from,
    };
    let (training, validation) = (record.data.open()?, record.validation_data.open()?);
    Ok(Run { folder: out.into(), record, initial: Some(initial), training, validation, stop_after: None })
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_scene::prepare::Parameters;
    use elunar_scene::prepare::manifest::{FORMAT, MANIFEST};
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
            "format": FORMAT, "made_by": "test", "tile": [256, 320], "parameters": Parameters::default(), "nr": 37.5,
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
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("moon.toml");
        let plain = DataSpec::parse(None, 7, Split::Train).unwrap();
        let DataSpec::Synth { options, .. } = plain.clone() else { panic!("no Moon") };
        let of = |text: &str| {
            std::fs::write(&path, text).unwrap();
            on_moon(plain.clone(), &path)
        };
        assert_eq!(of("").unwrap(), plain);
        let wide = SynthOptions { complex_craters: 0.25, also_pixel_m: vec![4.0], ..options };
        let found = of("complex_craters = 0.25\nalso_pixel_m = [4]").unwrap();
        assert_eq!(found, DataSpec::Synth { seed: 7, options: wide });
        assert_ne!(found, plain);
        for (text, expected) in
            [("craters = 1", "line 1"), ("relief = 3", "line 1"), ("complex_craters = 2", "moon.toml")]
        {
            let error = of(text).unwrap_err().to_string();
            assert!(error.contains("moon.toml") && error.contains(expected), "{error}");
        }
        let elsewhere = DataSpec::Folder { path: folder.path().into() };
        assert!(on_moon(elsewhere, &path).unwrap_err().to_string().contains("--data names a folder"));
        // The one that is at hand.
        let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/models/wide-moon.toml");
        assert_ne!(on_moon(plain.clone(), Path::new(shipped)).unwrap(), plain);
    }

    #[test]
    fn a_run_that_was_killed_before_its_first_checkpoint_is_no_dead_end() {
        let folder = tempfile::tempdir().unwrap();
        let args = Args { out: folder.path().into(), resume: true, profile: false, start: Start::default() };
        let refused = || resume(&args).err().expect("an error").to_string();
        assert!(refused().contains("begins anew without --resume"), "{}", refused());
        let run = start(Start { seed: Some(3), ..Start::default() }, folder.path()).unwrap();
        let write =
            |record: &Record| std::fs::write(folder.path().join(RECORD), serde_json::to_vec(record).unwrap()).unwrap();
        write(&run.record);
        let again = resume(&args).unwrap();
        assert!(again.record == run.record && again.initial.unwrap().to_bytes() == run.initial.unwrap().to_bytes());
        // Weights from a file are not made again.
        write(&Record { started_from: "w.safetensors".into(), ..run.record });
        assert!(
            refused().contains("the run started from w.safetensors; give its options again without --resume"),
            "{}",
            refused()
        );
    }
}
