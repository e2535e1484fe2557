//! Training of one experiment from random weights, and its scores on the validation tiles.

use super::COMMAND;
use crate::config::Configuration;
use crate::inner::check_inner;
use elunar_base::output::{Owner, check_names, settle};
use elunar_base::{Error, Result, atomic_write, read};
use elunar_learn::model::backend::Backend;
use elunar_learn::model::init::initial_weights;
use elunar_learn::model::store;
use elunar_learn::train::recipe::TrainingTarget;
use elunar_learn::train::run::{self, BEST, Run, RunRecord, begun};
use elunar_learn::train::validate::{ValidationResult, ValidationSet};
use elunar_net::weights::NetWeights;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Folder of the training run within the experiment's folder.
pub const TRAINING: &str = "training";
/// File name of the experiment and its scores; written when it is finished.
const FINISHED: &str = "experiment.json";

/// A finished experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trained {
    /// The experiment.
    pub experiment: Configuration,
    /// Number of trainable parameters of the network.
    pub parameters: usize,
    /// Scores of its best weights on the validation tiles, against the unchanged truth, whatever the recipe's target.
    pub validation: ValidationResult,
    /// Seconds of training since it was last started or resumed.
    pub seconds: f64,
    /// Steps per second in the same time.
    pub steps_per_s: f64,
}

/// Checks that training into `folder`, and its scores, would replace nothing of others.
///
/// # Errors
/// [`Error::Usage`] with the first file in the place of one.
pub(super) fn check_files(folder: &Path) -> Result<()> {
    if finished(folder)?.is_some() {
        return Ok(());
    }
    check_inner(folder)?;
    check_inner(&folder.join(TRAINING))?;
    check_names(folder, COMMAND, [FINISHED.into()])?;
    check_names(&folder.join(TRAINING), run::COMMAND, run::files())
}

/// Returns the path of the final weights in an experiment's folder.
#[must_use]
pub fn model(folder: &Path) -> PathBuf {
    folder.join(TRAINING).join(BEST)
}

/// Trains and validates, unless `folder` already holds the finished experiment.
///
/// # Errors
/// [`Error::Input`] if the folder holds another experiment, or an unfinished one without `resume`, or training was interrupted. Errors of
/// the training are passed on.
pub fn train(experiment: &Configuration, folder: &Path, resume: bool, say: &mut dyn FnMut(&str)) -> Result<Trained> {
    let name = &experiment.name;
    if let Some(found) = finished(folder)? {
        if !same(&found.experiment, experiment) {
            return Err(another(folder));
        }
        say(&format!("{name}: trained before"));
        return Ok(found);
    }
    check_files(folder)?;
    let run_folder = folder.join(TRAINING);
    // A run that was killed before its first checkpoint begins anew.
    let begun = begun(&run_folder);
    let record = record_of(experiment);
    if begun && RunRecord::read(&run_folder)? != record {
        return Err(another(folder));
    }
    if begun && !resume {
        let what =
            "expected a new folder or a finished experiment, found an unfinished one; add --resume to go on with it";
        return Err(Error::input(format!("{}: {what}", folder.display())));
    }
    let _owner = Owner::of_folder(folder, COMMAND, [FINISHED.into()])?;
    say(&format!("{name}: {} steps{}", record.recipe.steps, if begun { ", going on" } else { "" }));
    let initial = (!begun).then(|| initial_weights(&experiment.network, experiment.seed));
    let (training, validation) = (record.data.open()?, record.validation_data.open()?);
    let start = Instant::now();
    let run = Run { folder: run_folder, record, initial, training, validation: validation.clone(), stop_after: None };
    let outcome = run.train()?;
    if !outcome.finished {
        return Err(Error::stopped(format!("{name}: stopped after step {}; add --resume to go on", outcome.steps)));
    }
    let seconds = start.elapsed().as_secs_f64();
    let path = model(folder);
    let weights = NetWeights::read(&path)?;
    let device = Backend::Flex.device()?;
    let net = store::load(&experiment.network, &weights, &path, &device)?;
    let tiles = experiment.recipe.validation_tiles;
    let found =
        ValidationSet::new(&*validation, &experiment.network, TrainingTarget::Truth, tiles)?.run(&net, &device)?;
    let trainable = weights.tensors.iter().filter(|(name, _)| !name.contains(".running_"));
    let trained = Trained {
        experiment: experiment.clone(),
        parameters: trainable.map(|(_, array)| array.data.len()).sum(),
        validation: found,
        seconds,
        steps_per_s: outcome.steps_per_s,
    };
    let path = folder.join(FINISHED);
    let text = serde_json::to_vec_pretty(&trained).map_err(|e| Error::broken(&path, e.to_string()))?;
    atomic_write(&path, &text)?;
    Ok(trained)
}

fn record_of(experiment: &Configuration) -> RunRecord {
    let started_from = format!("{}; experiment {}", experiment.random_weights(), experiment.name);
    experiment.record(Backend::Flex, started_from)
}

fn finished(folder: &Path) -> Result<Option<Trained>> {
    let path = folder.join(FINISHED);
    if !path.exists() {
        return Ok(None);
    }
    settle(&path)?;
    let text = read::bytes(&path, read::MOST_BYTES)?;
    serde_json::from_slice(&text).map(Some).map_err(|e| Error::broken(&path, format!("finished experiment: {e}")))
}

/// Returns whether training would be the same. Descriptions, and the use of the trained network, may differ.
fn same(a: &Configuration, b: &Configuration) -> bool {
    record_of(a) == record_of(b)
}

fn another(folder: &Path) -> Error {
    let what = "expected this experiment or nothing, found one of other settings; choose another --out";
    Error::input(format!("{}: {what}", folder.display()))
}
