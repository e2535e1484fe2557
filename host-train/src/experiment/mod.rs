//! Experiments from files: each is trained, validated and tested, and one table compares them.
//!
//! A [`Configuration`] describes an experiment. [`train`] trains it once and validates it (Table V). [`run`] tests all of them on the scenes of a
//! suite (Table VI). [`table`] makes the tables.

pub mod table;
pub mod train;

use crate::config::Configuration;
use crate::inner::check_inner;
use crate::suite::list::List;
use crate::suite::method::{Method, Usage};
use crate::suite::results::{RESULTS, SuiteResults};
use crate::suite::{self, Baselines};
use elunar_base::output::{Owner, check_names};
use elunar_base::{Error, Result, atomic_write, read};
use serde::{Deserialize, Serialize};
use std::path::Path;
pub use train::Trained;

/// File name of the comparison, which `report` reads.
pub const COMPARISON: &str = "comparison.json";
/// The command whose files these are.
const COMMAND: &str = "experiment";
/// The files beside the experiments' folders.
const FILES: [&str; 5] = ["comparison.md", "comparison.csv", "test.csv", COMPARISON, table::CURVES];
/// Folder of the suite's results, within the comparison's folder.
pub const TEST: &str = "test";

/// Results of all experiments of a folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ExperimentResults {
    /// Every trained experiment.
    pub trained: Vec<Trained>,
    /// The results of all experiments on the test scenes.
    pub test: SuiteResults,
}

impl ExperimentResults {
    /// Reads the comparison of a folder.
    ///
    /// # Errors
    /// If the file is missing or malformed.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(COMPARISON);
        let text = read::bytes(&path, read::MOST_BYTES)?;
        serde_json::from_slice(&text).map_err(|e| Error::broken(&path, format!("comparison of experiments: {e}")))
    }
}

/// Options of [`run`].
#[derive(Debug, Clone, Copy, Default)]
pub struct ExperimentOptions {
    /// Continue experiments that were started. Otherwise an unfinished experiment is refused.
    pub resume: bool,
    /// Number of threads for the test scenes; 0 takes as many as the machine offers.
    pub threads: usize,
}

/// Trains experiments that are not trained yet, tests all, and writes the comparison into `out`. Calls `say` with messages about progress.
///
/// # Errors
/// If two experiments share a name, or training, testing or writing fails. After an interrupted training, the error says how to continue.
pub fn run(
    experiments: &[Configuration],
    list: &List,
    out: &Path,
    manner: ExperimentOptions,
    say: &mut dyn FnMut(&str),
) -> Result<ExperimentResults> {
    for (k, one) in experiments.iter().enumerate() {
        if experiments[..k].iter().any(|other| other.name == one.name) {
            return Err(Error::input(format!("{}: expected experiments of different names, found it twice", one.name)));
        }
    }
    let _owner = Owner::of_folder(out, COMMAND, FILES.map(String::from))?;
    let folder = out.join(TEST);
    // Every experiment uses its network in its own way. The pipeline without training is used as the shipped networks are.
    let usage = Usage { threads: manner.threads, ..Usage::default() };
    let baselines = Baselines { usage, ..Baselines::default() };
    check_files(experiments, list, out, baselines)?;
    let mut trained = vec![];
    for experiment in experiments {
        let folder = out.join(&experiment.name);
        trained.push(train::train(experiment, &folder, manner.resume, say)?);
    }
    let methods = experiments.iter().map(|experiment| {
        let model = train::model(&out.join(&experiment.name));
        Method::network(&experiment.name, &model, experiment.evaluation.usage(manner.threads))
    });
    let methods: Vec<Method> = methods.collect::<Result<_>>()?;
    let test = match known(&folder, list, baselines, &methods) {
        Some(test) => {
            say("test scenes: scored before");
            test
        }
        None => suite::run(list, baselines, &methods, &folder, &mut |scene| say(&format!("test scene {scene}")))?,
    };
    let comparison = ExperimentResults { trained, test };
    table::curves(&comparison, out)?;
    for (file, text) in [
        (FILES[0], table::markdown(&comparison).into_bytes()),
        (FILES[1], table::validation(&comparison).csv()?),
        (FILES[2], suite::tables::sums(&comparison.test).csv()?),
    ] {
        atomic_write(&out.join(file), &text)?;
    }
    let path = out.join(COMPARISON);
    let text = serde_json::to_vec_pretty(&comparison).map_err(|e| Error::broken(&path, e.to_string()))?;
    atomic_write(&path, &text)?;
    Ok(comparison)
}

/// Checks that neither a training nor the test would replace anything of others, before the first one begins.
fn check_files(experiments: &[Configuration], list: &List, out: &Path, baselines: Baselines) -> Result<()> {
    experiments.iter().try_for_each(|experiment| train::check_files(&out.join(&experiment.name)))?;
    check_inner(&out.join(TEST))?;
    let own = baselines.methods();
    let own = own.iter().map(|method| method.name.as_str());
    let methods: Vec<&str> = own.chain(experiments.iter().map(|experiment| experiment.name.as_str())).collect();
    check_names(&out.join(TEST), suite::files::COMMAND, suite::files::of_suite(&list.scene, &methods))
}

/// Returns stored results of the same methods on the same scenes, if they exist. Models are compared by their hashes.
fn known(folder: &Path, list: &List, baselines: Baselines, methods: &[Method]) -> Option<SuiteResults> {
    if !folder.join(RESULTS).exists() {
        return None;
    }
    let found = SuiteResults::read(folder).ok()?;
    let own = baselines.methods();
    let same = found.methods.iter().skip(1).cloned().eq(own.iter().chain(methods).map(Method::info));
    (same && found.list_sha256 == list.sha256()).then_some(found)
}

#[cfg(test)]
mod tests;
