//! Experiments as data: each file trained, validated and tested, and one table of them all.
//!
//! A [`file`] says what; [`train`] trains it, once, and validates it (Table V); [`run`] then lets all of them work on the scenes of a
//! suite (Table VI); [`table`] puts both side by side.

pub mod file;
pub mod table;
pub mod train;

use crate::suite;
use crate::suite::list::List;
use crate::suite::method::Method;
use crate::suite::results::{RESULTS, Results};
use elunar_raster::{Error, Result, atomic_write};
pub use file::Experiment;
use serde::{Deserialize, Serialize};
use std::path::Path;
pub use train::Trained;

/// The comparison, for programs and for `report`.
pub const COMPARISON: &str = "comparison.json";
/// Folder of the suite's results in that of the comparison.
pub const TEST: &str = "test";

/// What all experiments of a folder found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Every experiment as it was trained.
    pub trained: Vec<Trained>,
    /// All of them on the test scenes.
    pub test: Results,
}

impl Comparison {
    /// Reads that of a folder.
    ///
    /// # Errors
    /// If the file is missing or malformed.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(COMPARISON);
        let text = std::fs::read(&path).map_err(Error::io(&path))?;
        serde_json::from_slice(&text).map_err(|e| Error::broken(&path, format!("comparison of experiments: {e}")))
    }
}

/// How [`run`] goes about it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Manner {
    /// Go on with experiments that were begun; else one that was begun and not finished is refused.
    pub resume: bool,
    /// Threads for the test scenes; 0 takes as many as the machine offers.
    pub threads: usize,
}

/// Trains what is not trained yet, tests all, and writes the comparison into `out`. `say` hears what is done.
///
/// # Errors
/// If two experiments share a name; from training, testing and writing. An interrupted training is an error that says how to go on.
pub fn run(
    experiments: &[Experiment],
    list: &List,
    out: &Path,
    manner: Manner,
    say: &mut dyn FnMut(&str),
) -> Result<Comparison> {
    for (k, one) in experiments.iter().enumerate() {
        if experiments[..k].iter().any(|other| other.name == one.name) {
            return Err(Error::usage(format!("{}: expected experiments of different names, found it twice", one.name)));
        }
    }
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
    let folder = out.join(TEST);
    let test = match known(&folder, list, &methods) {
        Some(test) => {
            say("test scenes: scored before");
            test
        }
        None => suite::run(list, &methods, &folder, &mut |scene| say(&format!("test scene {scene}")))?,
    };
    let comparison = Comparison { trained, test };
    table::curves(&comparison, out)?;
    for (file, text) in [
        ("comparison.md", table::markdown(&comparison).into_bytes()),
        ("comparison.csv", table::validation(&comparison).csv()?),
        ("test.csv", suite::tables::sums(&comparison.test).csv()?),
    ] {
        atomic_write(&out.join(file), &text)?;
    }
    let path = out.join(COMPARISON);
    let text = serde_json::to_vec_pretty(&comparison).map_err(|e| Error::broken(&path, e.to_string()))?;
    atomic_write(&path, &text)?;
    Ok(comparison)
}

/// Results of the same methods on the same scenes, if they are there. Models are compared by their hashes.
fn known(folder: &Path, list: &List, methods: &[Method]) -> Option<Results> {
    if !folder.join(RESULTS).exists() {
        return None;
    }
    let found = Results::read(folder).ok()?;
    let same = found.methods.iter().skip(1).cloned().eq(methods.iter().map(Method::info));
    (same && found.list_sha256 == list.sha256()).then_some(found)
}

#[cfg(test)]
mod tests;
