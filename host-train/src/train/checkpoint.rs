//! What a killed run needs to go on as if nothing had happened.

use crate::digest::sha256_hex;
use crate::model::weights::Weights;
use crate::raster::atomic_write;
use crate::{Error, Result};
use burn::optim::ModuleOptimizer;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

const FOLDER: &str = "checkpoint";
const SPARE: &str = "checkpoint.old";
const FRESH: &str = "checkpoint.new";
const WEIGHTS: &str = "weights.safetensors";
const OPTIMISER: &str = "optimiser.bpk";
const STATE: &str = "state.json";

/// Where the run stood.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Steps done.
    pub step: usize,
    /// Lowest validation RMSE so far, normalised units.
    pub best_rmse: Option<f64>,
    /// SHA-256 of the weights file.
    pub weights_sha256: String,
    /// SHA-256 of the optimiser file.
    pub optimiser_sha256: String,
}

/// A checkpoint read back.
pub struct Checkpoint {
    /// Where the run stood.
    pub state: State,
    /// The network.
    pub weights: Weights,
    /// Burn's record of the optimiser.
    optimiser: Vec<u8>,
}

/// Writes a checkpoint beside the old one, then swaps them: a kill at any moment leaves one that is whole.
///
/// # Errors
/// If the run folder cannot be written.
pub fn save(
    run: &Path,
    step: usize,
    best_rmse: Option<f64>,
    weights: &Weights,
    optimiser: &ModuleOptimizer,
) -> Result<()> {
    let fresh = run.join(FRESH);
    remove(&fresh)?;
    std::fs::create_dir_all(&fresh).map_err(Error::io(&fresh))?;
    let weights = weights.to_bytes();
    let optimiser = optimiser.into_bytes().map_err(|e| Error::usage(format!("optimiser state: {e}")))?;
    let state =
        State { step, best_rmse, weights_sha256: sha256_hex(&weights), optimiser_sha256: sha256_hex(&optimiser) };
    atomic_write(&fresh.join(WEIGHTS), &weights)?;
    atomic_write(&fresh.join(OPTIMISER), &optimiser)?;
    atomic_write(&fresh.join(STATE), &serde_json::to_vec_pretty(&state).expect("plain struct"))?;
    let (folder, spare) = (run.join(FOLDER), run.join(SPARE));
    remove(&spare)?;
    if folder.exists() {
        std::fs::rename(&folder, &spare).map_err(Error::io(&folder))?;
    }
    std::fs::rename(&fresh, &folder).map_err(Error::io(&folder))?;
    remove(&spare)
}

/// The latest whole checkpoint of a run; `None` if it has none.
///
/// # Errors
/// If one exists but is broken.
pub fn load(run: &Path) -> Result<Option<Checkpoint>> {
    let Some(folder) = [FOLDER, SPARE].map(|name| run.join(name)).into_iter().find(|p| p.exists()) else {
        return Ok(None);
    };
    let read = |name: &str| -> Result<(PathBuf, Vec<u8>)> {
        let path = folder.join(name);
        let bytes = std::fs::read(&path).map_err(Error::io(&path))?;
        Ok((path, bytes))
    };
    let (state_path, state) = read(STATE)?;
    let state: State = serde_json::from_slice(&state).map_err(|e| Error::broken(&state_path, e.to_string()))?;
    let (weights_path, weights) = read(WEIGHTS)?;
    let (optimiser_path, optimiser) = read(OPTIMISER)?;
    for (path, bytes, expected) in
        [(&weights_path, &weights, &state.weights_sha256), (&optimiser_path, &optimiser, &state.optimiser_sha256)]
    {
        let found = sha256_hex(bytes);
        if found != *expected {
            return Err(Error::broken(path, format!("expected SHA-256 {expected}, found {found}")));
        }
    }
    Ok(Some(Checkpoint { state, weights: Weights::from_bytes(&weights_path, &weights)?, optimiser }))
}

impl Checkpoint {
    /// `optimiser` with the saved moments.
    ///
    /// # Errors
    /// If Burn cannot read its record.
    pub fn restore(&self, optimiser: ModuleOptimizer) -> Result<ModuleOptimizer> {
        let bytes = burn::tensor::Bytes::from_bytes_vec(self.optimiser.clone());
        optimiser.from_bytes(bytes).map_err(|e| Error::usage(format!("optimiser state: {e}")))
    }
}

fn remove(folder: &Path) -> Result<()> {
    match std::fs::remove_dir_all(folder) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::Io { path: folder.into(), source: e }),
        _ => Ok(()),
    }
}
