//! The training loop: steps, validation, checkpoints, progress. Ctrl-C or a kill leaves a run that can be resumed.

use super::average::Average;
use super::checkpoint::{self, Checkpoint};
use super::curves;
use super::feed::{Feed, tensors};
use super::journal::{STEPS, TrainingJournal, VALIDATIONS};
use super::recipe::Recipe;
use super::sample::Sample;
use super::source::{DataSpec, TileSource};
use super::step::Trainer;
use super::validate::{ValidationResult, ValidationSet};
use crate::model::backend::{Backend, on_processor};
use crate::model::store;
use crate::stopwatch::{TrainingPart, pause, time};
use burn::module::Module;
use elunar_base::output::Owner;
use elunar_base::progress::Bar;
use elunar_base::{Error, Result, interrupt, read};
use elunar_net::config::NetConfig;
use elunar_net::weights::NetWeights;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// File name of the weights with the lowest validation RMSE.
pub const BEST: &str = "best.safetensors";
/// File name of the weights after the last step.
pub const LAST: &str = "last.safetensors";
/// File name of the run's record: network, recipe, data, seed, backend.
pub const RECORD: &str = "run.json";

/// File name of the times of a run's parts.
pub const PROFILE: &str = "profile.md";
/// The command whose files these are.
pub const COMMAND: &str = "train";

/// Returns the names of all files of a run.
pub fn files() -> impl Iterator<Item = String> {
    let fixed = [RECORD, BEST, LAST, STEPS, VALIDATIONS, curves::CURVES, PROFILE].map(String::from);
    fixed.into_iter().chain(checkpoint::files())
}

/// Removes the files of a run. Its record is removed last: with it, what is left is still recognised.
///
/// # Errors
/// If another process writes the folder, something in it is another's, or a file cannot be removed.
pub fn discard(folder: &Path) -> Result<()> {
    let owner = Owner::of_folder(folder, COMMAND, files())?;
    files().filter(|name| name != RECORD).try_for_each(|name| owner.remove(&name))?;
    owner.remove(RECORD)
}

/// Everything that determines a run. It is written to the run's folder before the first step, once there is a checkpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    /// The network.
    pub network: NetConfig,
    /// The hyper-parameters.
    pub recipe: Recipe,
    /// Source of the training tiles.
    pub data: DataSpec,
    /// Source of the validation tiles.
    pub validation_data: DataSpec,
    /// Seed of initial weights and of cropping.
    pub seed: u64,
    /// Backend.
    pub backend: Backend,
    /// Origin of the initial weights.
    pub started_from: String,
}

impl RunRecord {
    /// Reads the record of a run folder.
    ///
    /// # Errors
    /// If the record is missing or malformed.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(RECORD);
        let text = read::bytes(&path, read::MOST_SETTINGS_BYTES)?;
        serde_json::from_slice(&text).map_err(|e| Error::broken(&path, format!("run record: {e}")))
    }
}

/// A run to be started or resumed.
pub struct Run {
    /// Folder of the run.
    pub folder: PathBuf,
    /// Record of the run.
    pub record: RunRecord,
    /// Weights of step 0; `None` to continue from the folder's checkpoint.
    pub initial: Option<NetWeights>,
    /// Training tiles.
    pub training: Arc<dyn TileSource>,
    /// Validation tiles.
    pub validation: Arc<dyn TileSource>,
    /// Step after which to stop before the recipe's end, as if killed; `None` runs to the end.
    pub stop_after: Option<usize>,
}

/// Result of a run.
#[derive(Debug, Clone)]
pub struct TrainingResult {
    /// Number of all steps done.
    pub steps: usize,
    /// Number of steps done since the run was started or resumed.
    pub steps_here: usize,
    /// Whether the recipe was finished.
    pub finished: bool,
    /// The last validation.
    pub last: Option<ValidationResult>,
    /// Validation of the best weights since the run was started or resumed.
    pub best: Option<ValidationResult>,
    /// Training steps per second since the run was started or resumed, validation and checkpoints included.
    pub steps_per_s: f64,
}

struct Loop {
    trainer: Trainer,
    average: Option<Average>,
    journal: TrainingJournal,
    set: ValidationSet,
    best_rmse: Option<f64>,
    best: Option<ValidationResult>,
    last: Option<ValidationResult>,
}

impl Loop {
    fn checkpoint(&self, run: &Run, step: usize) -> Result<()> {
        run.checkpoint((step, self.best_rmse), self.average.as_ref(), &self.trainer)
    }
}

impl Run {
    /// Trains until the recipe is finished, the user interrupts, or `stop_after`.
    ///
    /// # Errors
    /// If the folder holds another run or another process writes it, tiles cannot be made, the loss is not finite, or files cannot be written.
    pub fn train(self) -> Result<TrainingResult> {
        self.record.recipe.check().map_err(Error::input)?;
        interrupt::listen();
        let _owner = Owner::of_folder(&self.folder, COMMAND, files())?;
        let (mut state, first) = self.open()?;
        let recipe = &self.record.recipe;
        let feed = Feed::new(self.training.clone(), self.record.network.clone(), recipe.clone(), self.record.seed);
        // While a GPU has the work, all threads make batches. On the processor they belong to the network.
        let makers = if on_processor(&state.trainer.device.clone().inner()) { 1 } else { rayon::current_num_threads() };
        let mut batches = feed.ahead(first, makers);
        let bar = progress(first, recipe.steps);
        let (start, mut done) = (Instant::now(), first);
        let mut saved = Instant::now();
        while done < recipe.steps && !interrupt::requested() && self.stop_after != Some(done) {
            let batch = time(TrainingPart::Tiles, || batches.next());
            let batch = batch.ok_or_else(|| Error::input("the data feed stopped early"))??;
            let parts = recipe.parts();
            let micro = batch.chunks(recipe.batch / parts).enumerate();
            let place = |(i, samples): (usize, &[Sample])| tensors(samples, state.trainer.device_of(i, parts));
            let micro = time(TrainingPart::Tensors, || micro.map(place).collect());
            let figures = state.trainer.step(recipe, done, micro)?;
            done += 1;
            let Loop { average, trainer, .. } = &mut state;
            average.iter_mut().for_each(|average| average.add(done, &self.record.network, &trainer.net));
            state.journal.step(&figures)?;
            bar.set_message(format!("loss {:.4}", figures.loss));
            bar.set_position(done as u64);
            if done.is_multiple_of(recipe.validate_every) || done == recipe.steps {
                self.validate(&mut state, done, &bar)?;
            }
            let due = saved.elapsed().as_secs_f64() >= 60.0 * recipe.checkpoint_minutes;
            if due || done.is_multiple_of(recipe.checkpoint_every) || done == recipe.steps {
                state.checkpoint(&self, done)?;
                saved = Instant::now();
            }
        }
        let finished = done == recipe.steps;
        if !finished {
            state.checkpoint(&self, done)?;
            curves::draw(&self.folder)?;
        }
        bar.abandon();
        self.result(&state).write(&self.folder.join(LAST))?;
        let steps_per_s = (done - first) as f64 / start.elapsed().as_secs_f64();
        Ok(TrainingResult {
            steps: done,
            steps_here: done - first,
            finished,
            last: state.last,
            best: state.best,
            steps_per_s,
        })
    }

    /// Prepares the loop at step 0 or at the checkpoint. A new run's first checkpoint is written before anything slow, and its record after
    /// that: who finds a record finds a checkpoint.
    fn open(&self) -> Result<(Loop, usize)> {
        let saved = match &self.initial {
            Some(_) => self.clear().map(|()| None)?,
            None => Some(self.checkpointed()?),
        };
        let recipe = &self.record.recipe;
        let (first, best_rmse) = saved.as_ref().map_or((0, None), |c| (c.state.step, c.state.best_rmse));
        let weights = saved.as_ref().map(|c| &c.weights).or(self.initial.as_ref());
        let weights = weights.ok_or_else(|| Error::input("a run needs initial weights or a checkpoint"))?;
        let devices = self.record.backend.devices(recipe.devices)?;
        let trainer = Trainer::new(&self.record.network, recipe, weights, &self.folder, devices)?;
        let mut trainer = trainer.seeded(self.record.seed);
        let begun = saved.as_ref().and_then(|c| c.average.as_ref()).unwrap_or(weights);
        let average = Average::new(begun.clone(), recipe.average_steps, recipe.steps);
        match &saved {
            Some(saved) => saved.restore(&mut trainer)?,
            None => {
                self.checkpoint((0, None), average.as_ref(), &trainer)?;
                let record = serde_json::to_vec_pretty(&self.record).expect("plain struct");
                elunar_base::atomic_write(&self.folder.join(RECORD), &record)?;
            }
        }
        let set = ValidationSet::new(&*self.validation, &self.record.network, recipe.target, recipe.validation_tiles)?;
        let journal = TrainingJournal::open(&self.folder, first)?;
        Ok((Loop { trainer, average, journal, set, best_rmse, best: None, last: None }, first))
    }

    /// Refuses a folder with a run. What a run left that was killed before its first checkpoint is removed.
    fn clear(&self) -> Result<()> {
        if begun(&self.folder) {
            let what = "expected a new folder, found a run in it; choose another --out or add --resume";
            return Err(Error::input(format!("{}: {what}", self.folder.display())));
        }
        let record = self.folder.join(RECORD);
        match std::fs::remove_file(&record) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(Error::io(&record)(error)),
            _ => Ok(()),
        }
    }

    /// Returns the folder's checkpoint, if the folder belongs to this run.
    fn checkpointed(&self) -> Result<Checkpoint> {
        if RunRecord::read(&self.folder)? != self.record {
            let what = format!("{}: expected the record of the run to resume, found another", self.folder.display());
            return Err(Error::input(what));
        }
        let found = checkpoint::load(&self.folder)?;
        found.ok_or_else(|| Error::input(format!("{}: expected a checkpoint, found none", self.folder.display())))
    }

    fn validate(&self, state: &mut Loop, step: usize, bar: &Bar) -> Result<()> {
        let device = state.trainer.device.clone().inner();
        let net = match &state.average {
            Some(average) => store::load(&self.record.network, &average.weights, &self.folder, &device)?,
            None => state.trainer.net.valid(),
        };
        let found = pause(|| state.set.run(&net, &device))?;
        state.journal.validation(step, &found)?;
        let best = state.best_rmse.is_none_or(|best| found.rmse < best);
        bar.suspend(|| {
            elunar_base::say::note(&format!(
                "step {step:6}  validation: RMSE {:.2} m (untrained {:.2}, coarse {:.2}), slope {:.2}° (untrained {:.2}°, coarse {:.2}°){}",
                found.network.rmse_m,
                found.untrained.map_or(f64::NAN, |scores| scores.rmse_m),
                found.coarse.rmse_m,
                found.network.slope_mae_deg,
                found.untrained.map_or(f64::NAN, |scores| scores.slope_mae_deg),
                found.coarse.slope_mae_deg,
                if best { "  best" } else { "" }
            ));
        });
        if best {
            state.best_rmse = Some(found.rmse);
            state.best = Some(found);
            self.result(state).write(&self.folder.join(BEST))?;
        }
        state.last = Some(found);
        curves::draw(&self.folder)
    }

    /// Returns the weights that the run is for: their mean, or the latest.
    fn result(&self, state: &Loop) -> NetWeights {
        match &state.average {
            Some(average) => average.weights.clone(),
            None => store::save(&self.record.network, &state.trainer.net),
        }
    }

    fn checkpoint(&self, state: (usize, Option<f64>), average: Option<&Average>, trainer: &Trainer) -> Result<()> {
        let weights = store::save(&self.record.network, &trainer.net);
        checkpoint::save(&self.folder, state, &weights, average, trainer)
    }
}

/// Returns whether a folder holds a run that can go on, or whose weights must not be overwritten.
#[must_use]
pub fn begun(folder: &Path) -> bool {
    let weights = || [BEST, LAST].iter().any(|name| folder.join(name).exists());
    folder.join(RECORD).exists() && (checkpoint::exists(folder) || weights())
}

fn progress(first: usize, steps: usize) -> Bar {
    let bar = elunar_base::progress::bar("training", steps as u64, "steps").with_position(first as u64);
    bar.reset_eta();
    bar
}
