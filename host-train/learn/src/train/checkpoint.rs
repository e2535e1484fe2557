//! Checkpoints. With one, a killed run continues with the same result as an uninterrupted run.

use super::average::Average;
use super::step::Trainer;
use elunar_base::digest::sha256_hex;
use elunar_base::output::remove_folder;
use elunar_base::{Error, Result, atomic_write, read};
use elunar_net::weights::NetWeights;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

const FOLDER: &str = "checkpoint";
const SPARE: &str = "checkpoint.old";
const FRESH: &str = "checkpoint.new";
const WEIGHTS: &str = "weights.safetensors";
const OPTIMISER: &str = "optimiser.safetensors";
const AVERAGE: &str = "average.safetensors";
/// Files of an adversarial run's critic.
const CRITIC: [&str; 2] = ["critic.safetensors", "critic-optimiser.safetensors"];
const STATE: &str = "state.json";
/// Most bytes of a file of a checkpoint: an optimiser has several numbers for every weight.
const MOST_STATE_BYTES: u64 = 2 * read::MOST_WEIGHTS_BYTES;

/// All files of a checkpoint.
const FILES: [&str; 6] = [WEIGHTS, OPTIMISER, AVERAGE, CRITIC[0], CRITIC[1], STATE];

/// Returns the names of the folders and files of checkpoints in a run's folder.
pub(super) fn files() -> impl Iterator<Item = String> {
    let all = |folder: &'static str| FILES.iter().map(move |file| format!("{folder}/{file}"));
    [FOLDER, SPARE, FRESH].into_iter().flat_map(move |folder| all(folder).chain([format!("{folder}/")]))
}

/// State of the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunState {
    /// Number of steps done.
    pub step: usize,
    /// Lowest validation RMSE so far, normalised units.
    pub best_rmse: Option<f64>,
    /// SHA-256 of the weights file.
    pub weights_sha256: String,
    /// SHA-256 of the optimiser file.
    pub optimiser_sha256: String,
    /// SHA-256 of the averaged weights, if there are any.
    #[serde(default)]
    pub average_sha256: Option<String>,
    /// SHA-256 of the critic's weights and of its optimiser's file, if there is one.
    #[serde(default)]
    pub critic_sha256: Option<[String; 2]>,
}

/// A checkpoint as read from disk.
pub struct Checkpoint {
    /// State of the run.
    pub state: RunState,
    /// Weights of the network.
    pub weights: NetWeights,
    /// Averaged weights, if there are any.
    pub average: Option<NetWeights>,
    /// The optimiser's file.
    optimiser: Vec<u8>,
    /// The critic's weights and its optimiser's file.
    critic: Option<(NetWeights, Vec<u8>)>,
}

/// Writes a checkpoint beside the old one, then swaps them. A kill at any moment leaves one complete checkpoint.
///
/// # Errors
/// If the run folder cannot be written.
pub fn save(
    run: &Path,
    (step, best_rmse): (usize, Option<f64>),
    weights: &NetWeights,
    average: Option<&Average>,
    trainer: &Trainer,
) -> Result<()> {
    let fresh = run.join(FRESH);
    remove_folder(&fresh, &FILES)?;
    std::fs::create_dir_all(&fresh).map_err(Error::io(&fresh))?;
    let weights = weights.to_bytes();
    let optimiser = trainer.optimiser.to_bytes();
    let critic = trainer.opponent.as_ref().map(|it| [it.weights().to_bytes(), it.optimiser.to_bytes()]);
    let average = average.map(|average| average.weights.to_bytes());
    let average_sha256 = average.as_ref().map(sha256_hex);
    let critic_sha256 = critic.as_ref().map(|parts| parts.each_ref().map(sha256_hex));
    let (weights_sha256, optimiser_sha256) = (sha256_hex(&weights), sha256_hex(&optimiser));
    let state = RunState { step, best_rmse, weights_sha256, optimiser_sha256, average_sha256, critic_sha256 };
    atomic_write(&fresh.join(WEIGHTS), &weights)?;
    atomic_write(&fresh.join(OPTIMISER), &optimiser)?;
    if let Some(bytes) = &average {
        atomic_write(&fresh.join(AVERAGE), bytes)?;
    }
    for (name, bytes) in CRITIC.iter().zip(critic.iter().flatten()) {
        atomic_write(&fresh.join(name), bytes)?;
    }
    atomic_write(&fresh.join(STATE), &serde_json::to_vec_pretty(&state).expect("plain struct"))?;
    let (folder, spare) = (run.join(FOLDER), run.join(SPARE));
    // After a kill between the renames the spare one is the only one, and stays until the fresh one is in place.
    if folder.exists() {
        remove_folder(&spare, &FILES)?;
        std::fs::rename(&folder, &spare).map_err(Error::io(&folder))?;
    }
    std::fs::rename(&fresh, &folder).map_err(Error::io(&folder))?;
    remove_folder(&spare, &FILES)
}

/// Returns whether a run has a checkpoint.
#[must_use]
pub fn exists(run: &Path) -> bool {
    latest(run).is_some()
}

fn latest(run: &Path) -> Option<PathBuf> {
    [FOLDER, SPARE].map(|name| run.join(name)).into_iter().find(|path| path.exists())
}

/// Reads the latest complete checkpoint of a run; `None` if it has none.
///
/// # Errors
/// If one exists but is broken.
pub fn load(run: &Path) -> Result<Option<Checkpoint>> {
    let Some(folder) = latest(run) else { return Ok(None) };
    let read = |name: &str| -> Result<(PathBuf, Vec<u8>)> {
        let path = folder.join(name);
        let bytes = read::bytes(&path, MOST_STATE_BYTES)?;
        Ok((path, bytes))
    };
    // Earlier versions had files of other names and forms for optimisers.
    if !folder.join(OPTIMISER).exists() {
        let what =
            format!("expected {OPTIMISER}, found none; go on with the version of the program that began the run");
        return Err(Error::broken(&folder, what));
    }
    let (state_path, state) = read(STATE)?;
    let state: RunState = serde_json::from_slice(&state).map_err(|e| Error::broken(&state_path, e.to_string()))?;
    let whole = |name: &str, expected: &str| -> Result<(PathBuf, Vec<u8>)> {
        let (path, bytes) = read(name)?;
        let found = sha256_hex(&bytes);
        if found == expected {
            return Ok((path, bytes));
        }
        Err(Error::broken(&path, format!("expected SHA-256 {expected}, found {found}")))
    };
    let weights = |name: &str, expected: &str| -> Result<NetWeights> {
        let (path, bytes) = whole(name, expected)?;
        NetWeights::from_bytes(&path, &bytes)
    };
    let critic = match &state.critic_sha256 {
        Some([first, second]) => Some((weights(CRITIC[0], first)?, whole(CRITIC[1], second)?.1)),
        None => None,
    };
    let average = state.average_sha256.as_ref().map(|expected| weights(AVERAGE, expected)).transpose()?;
    let (_, optimiser) = whole(OPTIMISER, &state.optimiser_sha256)?;
    Ok(Some(Checkpoint { weights: weights(WEIGHTS, &state.weights_sha256)?, average, optimiser, critic, state }))
}

impl Checkpoint {
    /// Sets the saved moments of `trainer`, and its critic if it has one.
    ///
    /// # Errors
    /// If a critic is missing or does not fit, or a file is not an optimiser's.
    pub fn restore(&self, trainer: &mut Trainer) -> Result<()> {
        trainer.optimiser.restore(Path::new(OPTIMISER), &self.optimiser, &trainer.device)?;
        let Some(opponent) = &mut trainer.opponent else { return Ok(()) };
        let (weights, moments) =
            self.critic.as_ref().ok_or_else(|| Error::input("checkpoint: expected a critic, found none"))?;
        opponent.restore(weights, Path::new(CRITIC[0]), &trainer.device)?;
        opponent.optimiser.restore(Path::new(CRITIC[1]), moments, &trainer.device)
    }
}
