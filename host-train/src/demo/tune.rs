//! Step 2: a short training run on other Moons with the scene's kind of ground and about its Sun. Both are known of any image.

use super::console::say;
use super::folder::{FLOAT_MODEL, Folder, RUN, STARTED_BY};
use super::{InitialWeights, Seeds, TourSettings};
use elunar_base::{Error, Result};
use elunar_data::source::DataSpec;
use elunar_learn::model::backend::Backend;
use elunar_learn::model::init::initial_weights;
use elunar_learn::model::store;
use elunar_learn::train::curves::{CURVES, History};
use elunar_learn::train::run::{BEST, Run, RunRecord};
use elunar_learn::train::validate::{ValidationResult, ValidationScores, ValidationSet};
use elunar_net::config::{NetConfig, config_of};
use elunar_net::weights::NetWeights;
use elunar_synth::{SceneEntry, SynthOptions};
use std::path::{Path, PathBuf};

/// Greatest difference between the tiles' Sun elevation and the scene's, degrees (our choice).
const SUN_SPREAD_DEG: f64 = 5.0;

/// Result of the training.
pub(super) struct Tuned {
    /// Number of trainable parameters of the network.
    pub parameters: usize,
    /// Origin of the initial weights.
    pub started_from: String,
    /// Sun elevations of the tiles, degrees.
    pub sun_deg: (f64, f64),
    /// Validation before the first step.
    pub before: ValidationResult,
    /// The best validation of the run.
    pub after: ValidationResult,
    /// Whether the run's best weights are used from here on, and not those it started from.
    pub improved: bool,
    /// Steps per second, validation included.
    pub steps_per_s: f64,
}

/// Returns the step's title.
pub(super) fn title(settings: &TourSettings) -> &'static str {
    match settings.start {
        InitialWeights::Weights(_) => "Fine-tuning the float network",
        InitialWeights::Scratch(_) => "Training a float network from random weights",
    }
}

/// Reads the weights of step 0 and their network, before anything is written.
///
/// # Errors
/// If the file is absent, broken, or not a network.
pub(super) fn start(settings: &TourSettings) -> Result<(NetConfig, NetWeights)> {
    match &settings.start {
        InitialWeights::Scratch(network) => Ok((network.clone(), initial_weights(network, settings.seed))),
        InitialWeights::Weights(path) if !path.exists() => Err(Error::input(format!(
            "{}: expected the weights to start from, found no such file; --from-scratch does without",
            path.display()
        ))),
        InitialWeights::Weights(path) => {
            let weights = NetWeights::read(path)?;
            let network = config_of(&weights, path)?;
            // This also fails early if tensors are missing or do not fit.
            store::load(&network, &weights, path, &Backend::Flex.device()?)?;
            Ok((network, weights))
        }
    }
}

/// Returns the synthetic Moon for training, validation and calibration: the scene's ground, and about its Sun.
pub(super) fn moon(seed: u64, scene: &SceneEntry) -> DataSpec {
    let options = SynthOptions { kind: Some(scene.kind), sun_elevation_deg: sun_deg(scene), ..SynthOptions::default() };
    DataSpec::Synth { seed, options }
}

fn sun_deg(scene: &SceneEntry) -> (f64, f64) {
    let sun = scene.sun_elevation_deg.round();
    ((sun - SUN_SPREAD_DEG).max(5.0), (sun + SUN_SPREAD_DEG).min(85.0))
}

/// Trains, and writes the better of the old and the new weights.
///
/// # Errors
/// If tiles cannot be made, or training or writing fails.
pub(super) fn run(
    settings: &TourSettings,
    folder: &Folder,
    seeds: Seeds,
    scene: &SceneEntry,
    (network, initial): (NetConfig, NetWeights),
) -> Result<Tuned> {
    let started_from = match &settings.start {
        InitialWeights::Weights(path) => path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
        InitialWeights::Scratch(_) => format!("random weights of seed {}", settings.seed),
    };
    let record = RunRecord {
        network: network.clone(),
        recipe: settings.recipe.clone(),
        data: moon(seeds.training, scene),
        validation_data: moon(seeds.validation, scene),
        seed: settings.seed,
        backend: Backend::Flex,
        started_from: format!("{STARTED_BY}{started_from}"),
    };
    let sun_deg = sun_deg(scene);
    say(format!(
        "{} steps from {started_from}, on tiles of other Moons: same kind of ground, Sun {:.0}° to {:.0}° high",
        record.recipe.steps, sun_deg.0, sun_deg.1
    ));
    let (training, validation) = (record.data.open()?, record.validation_data.open()?);
    let device = record.backend.device()?;
    let net = store::load(&network, &initial, Path::new(&started_from), &device)?;
    let recipe = &record.recipe;
    let before =
        ValidationSet::new(&*validation, &network, recipe.target, recipe.validation_tiles)?.run(&net, &device)?;
    say(figures("before", &before));
    let run_folder = folder.file(RUN);
    let run = Run {
        folder: run_folder.clone(),
        record,
        initial: Some(initial.clone()),
        training,
        validation,
        stop_after: None,
    };
    let outcome = run.train()?;
    if !outcome.finished {
        return Err(Error::stopped("training was stopped"));
    }
    let after = outcome.best.ok_or_else(|| Error::input("training: expected a validation, found none"))?;
    say(figures("after ", &after));
    // The criterion is the RMSE in metres, which the tour reports.
    let improved = after.network.rmse_m < before.network.rmse_m;
    let weights = if improved { NetWeights::read(&run_folder.join(BEST))? } else { initial };
    weights.write(&folder.file(FLOAT_MODEL))?;
    if !improved {
        say("training found nothing better: the tour goes on with the weights it started from");
    }
    draw_with_start(&run_folder, &before)?;
    let trainable = weights.tensors.iter().filter(|(name, _)| !name.contains(".running_"));
    let parameters = trainable.map(|(_, array)| array.data.len()).sum();
    Ok(Tuned { parameters, started_from, sun_deg, before, after, improved, steps_per_s: outcome.steps_per_s })
}

/// Draws the run's curves, with the validation before the first step as their first point.
fn draw_with_start(run: &Path, before: &ValidationResult) -> Result<()> {
    let mut history = History::read(run)?;
    for (points, figure) in [
        (&mut history.rmse_m, before.network.rmse_m),
        (&mut history.coarse_rmse_m, before.coarse.rmse_m),
        (&mut history.slope_deg, before.network.slope_mae_deg),
        (&mut history.coarse_slope_deg, before.coarse.slope_mae_deg),
    ] {
        points.insert(0, (0.0, figure));
    }
    history.write(&curves(run))
}

/// Returns the path of the curves in a run's folder.
pub(super) fn curves(run: &Path) -> PathBuf {
    run.join(CURVES)
}

fn figures(when: &str, found: &ValidationResult) -> String {
    let untrained = |figure: fn(&ValidationScores) -> f64, unit: &str| {
        found.untrained.map_or_else(String::new, |scores| format!("untrained {:.2}{unit}, ", figure(&scores)))
    };
    format!(
        "{when}: height RMSE {:.2} m ({}coarse DTM {:.2}), mean slope error {:.2}° ({}coarse DTM {:.2}°) on tiles held out",
        found.network.rmse_m,
        untrained(|scores| scores.rmse_m, ""),
        found.coarse.rmse_m,
        found.network.slope_mae_deg,
        untrained(|scores| scores.slope_mae_deg, "°"),
        found.coarse.slope_mae_deg
    )
}
