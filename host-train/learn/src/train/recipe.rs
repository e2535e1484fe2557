//! Hyper-parameters: the paper's for the presets of the paper, ours for the small ones.

use super::adversarial::Adversarial;
use super::elevation_only::ElevationOnly;
use super::loss::{Elevation, LossWeights};
use super::sample::RawTile;
use crate::model::precision::Precision;
use elunar_core::tile::TILE;
use elunar_net::config::Preset;
use elunar_raster::{Error, Result};
use serde::{Deserialize, Serialize};

/// Target of the training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Target {
    /// The unchanged truth (the paper).
    Truth,
    /// The truth with the low frequencies of the coarse DTM (our choice).
    Anchored,
}

impl Target {
    /// Replaces the tile's truth by the target.
    ///
    /// # Errors
    /// If the tile's maps differ in size.
    pub fn of(self, tile: RawTile) -> Result<RawTile> {
        match self {
            Self::Truth => Ok(tile),
            Self::Anchored => tile.anchored(),
        }
    }
}

/// Everything that determines a training run, together with the data and the seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recipe {
    /// Number of tiles (or crops) per step.
    pub batch: usize,
    /// Number of parts into which a device's batch of a step is divided. They are processed one after the other, to save memory. Batch
    /// normalisation uses one part at a time.
    #[serde(default = "one")]
    pub accumulate: usize,
    /// Number of devices that share a step's batch. Each processes `accumulate` parts of it. `accumulate` times `devices` divides `batch`.
    #[serde(default = "one")]
    pub devices: usize,
    /// Whether cheap operations are computed again for the gradients, to save memory.
    #[serde(default)]
    pub checkpointing: bool,
    /// Precision of the network.
    #[serde(default)]
    pub precision: Precision,
    /// Number of optimiser steps. The cosine ends at the last one.
    pub steps: usize,
    /// Learning rate at the start of the cosine, after warm-up.
    pub learning_rate: f64,
    /// Number of steps of linear warm-up.
    pub warm_up: usize,
    /// Weight decay of AdamW.
    pub weight_decay: f32,
    /// Greatest norm of the gradients, parameter by parameter. Larger ones are scaled down.
    pub clip_norm: f32,
    /// First steps, which train the elevation term alone (the paper: 5,000).
    pub elevation_only: ElevationOnly,
    /// Weights of the loss terms (Eq. 5).
    pub weights: LossWeights,
    /// Elevation term.
    pub elevation: Elevation,
    /// Whether every sample's loss is divided by the slope error that it begins with ([`super::loss::balance`]). Heights must be in pixels.
    #[serde(default)]
    pub balanced: bool,
    /// Target of training and validation.
    pub target: Target,
    /// Critic of adversarial training, used after the elevation-only steps; `None` without it.
    #[serde(default)]
    pub adversarial: Option<Adversarial>,
    /// Stochastic depth: share of a residual branch's samples that the last Swin block leaves out; it grows linearly from 0 in the first block.
    /// Swin's segmentation code has 0.2, the paper is silent. 0 leaves out nothing.
    #[serde(default)]
    pub drop_path: f64,
    /// Share of the tiles whose known Sun is given to the network. For the others, the light is fitted.
    pub known_sun: f64,
    /// Rows and columns of the random crop of each 256x320 tile after normalisation; multiples of 32.
    pub crop: [usize; 2],
    /// Number of crops of one tile.
    pub crops_per_tile: usize,
    /// Number of the latest tiles from which every crop's tile is drawn, so that a tile serves several steps; 0: each step's own tiles.
    #[serde(default)]
    pub pool: usize,
    /// Whether half of the crops have rows and columns exchanged.
    #[serde(default)]
    pub transpose: bool,
    /// Number of steps over which the weights are averaged ([`super::average::Average`]), at most a quarter of the run's steps. The mean is
    /// validated and written. 0: no mean.
    #[serde(default)]
    pub average_steps: usize,
    /// Number of steps between validations.
    pub validate_every: usize,
    /// Number of tiles of the fixed validation set.
    pub validation_tiles: usize,
    /// Number of steps between checkpoints.
    pub checkpoint_every: usize,
    /// Greatest time between checkpoints, minutes. The time does not change the result.
    #[serde(default = "minutes")]
    pub checkpoint_minutes: f64,
}

fn one() -> usize {
    1
}

fn minutes() -> f64 {
    5.0
}

impl Recipe {
    /// Returns the recipe of a preset: the paper's for `paper` and `small`; short, cropped and fast for `tiny` and `nano`.
    pub fn preset(preset: Preset) -> Self {
        let paper = Self {
            batch: 4,
            accumulate: 1,
            devices: 1,
            checkpointing: false,
            precision: Precision::F32,
            steps: 60_000,
            learning_rate: 1e-4,
            warm_up: 0,
            weight_decay: 1e-4,
            clip_norm: 1.0,
            elevation_only: ElevationOnly::Steps(5_000),
            weights: LossWeights::PAPER,
            elevation: Elevation::MeanNormalised,
            balanced: false,
            target: Target::Truth,
            adversarial: None,
            drop_path: 0.2,
            known_sun: 0.5,
            crop: [256, 320],
            crops_per_tile: 1,
            pool: 0,
            transpose: false,
            average_steps: 0,
            validate_every: 5_000,
            validation_tiles: 64,
            checkpoint_every: 1_000,
            checkpoint_minutes: minutes(),
        };
        match preset {
            Preset::Paper | Preset::Small => paper,
            Preset::Tiny | Preset::Nano => Self {
                batch: 2,
                steps: 2_400,
                learning_rate: 1e-3,
                warm_up: 100,
                elevation_only: ElevationOnly::Steps(0),
                // Small networks, trained for few steps on tiles that never repeat, do not overfit (our choice).
                drop_path: 0.0,
                weights: LossWeights::PIXELS,
                elevation: Elevation::L1,
                balanced: true,
                target: Target::Anchored,
                // The whole height of a tile, twice: the transformer sees relief as wide as in a prediction (our choice).
                crop: [256, 256],
                crops_per_tile: 2,
                pool: 32,
                transpose: true,
                average_steps: 1_000,
                validate_every: 200,
                validation_tiles: 32,
                checkpoint_every: 100,
                ..paper
            },
        }
    }

    /// Returns the number of micro-batches of a step.
    pub fn parts(&self) -> usize {
        self.accumulate.saturating_mul(self.devices)
    }

    /// Returns the learning rate of a step, counted from 0: linear warm-up, then one cosine to zero.
    pub fn learning_rate_at(&self, step: usize) -> f64 {
        if step < self.warm_up {
            return self.learning_rate * (step + 1) as f64 / self.warm_up as f64;
        }
        let done = (step - self.warm_up) as f64 / (self.steps.saturating_sub(self.warm_up)).max(1) as f64;
        self.learning_rate * 0.5 * (1.0 + (std::f64::consts::PI * done.min(1.0)).cos())
    }

    /// Returns whether a step uses the elevation term alone.
    pub fn elevation_alone(&self, step: usize) -> bool {
        self.elevation_only.has(step, self.steps)
    }

    /// Returns the loss weights of a step.
    pub fn weights_at(&self, step: usize) -> LossWeights {
        if self.elevation_alone(step) {
            LossWeights { gradient: 0.0, normal: 0.0, ..self.weights }
        } else {
            self.weights
        }
    }

    /// Checks the recipe.
    ///
    /// # Errors
    /// One line with the field, what was expected and what was found.
    pub fn check(&self) -> std::result::Result<(), String> {
        for (name, n) in [("crop rows", self.crop[0]), ("crop columns", self.crop[1])] {
            if n == 0 || !n.is_multiple_of(32) {
                return Err(format!("{name}: expected a multiple of 32, found {n}"));
            }
        }
        let counts = [
            ("batch", self.batch),
            ("steps", self.steps),
            ("crops per tile", self.crops_per_tile),
            ("validate every", self.validate_every),
            ("validation tiles", self.validation_tiles),
            ("checkpoint every", self.checkpoint_every),
        ];
        for (name, n) in counts {
            if n == 0 {
                return Err(format!("{name}: expected at least 1, found 0"));
            }
        }
        if self.parts() == 0 || !self.batch.is_multiple_of(self.parts()) {
            let Self { batch, accumulate, devices, .. } = self;
            return Err(format!(
                "accumulate times devices: expected a divisor of batch {batch}, found {accumulate} times {devices}"
            ));
        }
        if let Some(adversarial) = &self.adversarial {
            adversarial.check()?;
            for (name, n) in [("accumulate", self.accumulate), ("devices", self.devices)] {
                if n > 1 {
                    return Err(format!("{name}: expected 1 with a critic, found {n}"));
                }
            }
        }
        self.elevation_only.check()?;
        if !(0.0..1.0).contains(&self.drop_path) {
            return Err(format!("drop path: expected a share in 0..1, found {}", self.drop_path));
        }
        if !(0.0..=1.0).contains(&self.known_sun) {
            return Err(format!("known sun: expected a share in 0..=1, found {}", self.known_sun));
        }
        if self.checkpoint_minutes.is_nan() || self.checkpoint_minutes < 0.0 {
            return Err(format!("checkpoint minutes: expected at least 0, found {}", self.checkpoint_minutes));
        }
        if !(self.learning_rate.is_finite() && self.learning_rate > 0.0) {
            return Err(format!("learning rate: expected a number above 0, found {}", self.learning_rate));
        }
        Ok(())
    }
}

/// Changes to a recipe, as command-line options.
#[derive(Debug, Clone, Default, PartialEq, clap::Args)]
pub struct RecipeFlags {
    /// Number of optimiser steps [default: the preset's].
    #[arg(long)]
    pub steps: Option<usize>,
    /// Number of tiles or crops per step [default: the preset's].
    #[arg(long)]
    pub batch: Option<usize>,
    /// Number of parts into which the batch is divided to save memory. Batch normalisation uses one part at a time [default: 1].
    #[arg(long, value_name = "N")]
    pub accumulate: Option<usize>,
    /// Number of devices that share a batch: GPUs, or parts of the processor's threads. Batch normalisation uses one part at a time
    /// [default: 1].
    #[arg(long, value_name = "N")]
    pub devices: Option<usize>,
    /// Compute cheap operations again for the gradients, to save memory.
    #[arg(long)]
    pub checkpointing: bool,
    /// Precision of products and convolutions [default: f32].
    #[arg(long)]
    pub precision: Option<Precision>,
    /// Learning rate at the start of the cosine [default: the preset's].
    #[arg(long)]
    pub learning_rate: Option<f64>,
    /// Number of steps of linear warm-up [default: the preset's].
    #[arg(long)]
    pub warm_up: Option<usize>,
    /// Rows and columns of the crop [default: the preset's].
    #[arg(long, num_args = 2, value_names = ["ROWS", "COLS"])]
    pub crop: Option<Vec<usize>>,
    /// Number of crops of one tile [default: the preset's].
    #[arg(long)]
    pub crops_per_tile: Option<usize>,
    /// Number of the latest tiles from which every crop's tile is drawn; 0: each step's own tiles [default: the preset's].
    #[arg(long, value_name = "TILES")]
    pub pool: Option<usize>,
    /// Exchange rows and columns of half of the crops [default: the preset's; no, if a turned crop is higher than a tile].
    #[arg(long, num_args = 0..=1, default_missing_value = "true", value_name = "BOOL")]
    pub transpose: Option<bool>,
    /// Validate and write the mean of the weights of so many steps; 0: the weights [default: the preset's].
    #[arg(long, value_name = "STEPS")]
    pub average_steps: Option<usize>,
    /// First steps, which use the elevation term alone: a whole number of steps, or a share of them with a decimal point (0.25) [default: the
    /// preset's].
    #[arg(long, value_name = "STEPS")]
    pub elevation_only: Option<ElevationOnly>,
    /// Stochastic depth: share of the samples for which the last Swin block's branches are left out [default: the preset's].
    #[arg(long, value_name = "SHARE")]
    pub drop_path: Option<f64>,
    /// Elevation term of the loss [default: mean-normalised].
    #[arg(long)]
    pub elevation: Option<Elevation>,
    /// Divide every sample's loss by the slope error that it begins with: rough and smooth ground count alike [default: the preset's].
    #[arg(long, num_args = 0..=1, default_missing_value = "true", value_name = "BOOL")]
    pub balanced: Option<bool>,
    /// Target of training and validation [default: the preset's].
    #[arg(long)]
    pub target: Option<Target>,
    /// Share of the tiles whose known Sun is given to the network [default: the preset's].
    #[arg(long)]
    pub known_sun: Option<f64>,
    /// Weights of elevation, gradient and normal term [default: the preset's].
    #[arg(long, num_args = 3, value_names = ["ELEVATION", "GRADIENT", "NORMAL"])]
    pub loss_weights: Option<Vec<f32>>,
    /// Number of steps between validations [default: the preset's].
    #[arg(long)]
    pub validate_every: Option<usize>,
    /// Number of tiles of the validation set [default: the preset's].
    #[arg(long)]
    pub validation_tiles: Option<usize>,
    /// Number of steps between checkpoints [default: the preset's].
    #[arg(long)]
    pub checkpoint_every: Option<usize>,
    /// Greatest time between checkpoints, minutes [default: 5].
    #[arg(long, value_name = "MINUTES")]
    pub checkpoint_minutes: Option<f64>,
}

impl RecipeFlags {
    /// Returns `recipe` with the given options set.
    ///
    /// # Errors
    /// [`Error::Input`] with the option that is out of range.
    pub fn apply(&self, mut recipe: Recipe) -> Result<Recipe> {
        recipe.steps = self.steps.unwrap_or(recipe.steps);
        recipe.batch = self.batch.unwrap_or(recipe.batch);
        recipe.accumulate = self.accumulate.unwrap_or(recipe.accumulate);
        recipe.devices = self.devices.unwrap_or(recipe.devices);
        recipe.checkpointing |= self.checkpointing;
        recipe.precision = self.precision.unwrap_or(recipe.precision);
        recipe.learning_rate = self.learning_rate.unwrap_or(recipe.learning_rate);
        recipe.warm_up = self.warm_up.unwrap_or(recipe.warm_up).min(recipe.steps / 2);
        if let Some([rows, cols]) = self.crop.as_deref() {
            recipe.crop = [*rows, *cols];
        }
        recipe.crops_per_tile = self.crops_per_tile.unwrap_or(recipe.crops_per_tile);
        recipe.pool = self.pool.unwrap_or(recipe.pool);
        // Turned, the crop must still fit a tile.
        recipe.transpose = self.transpose.unwrap_or(recipe.transpose && recipe.crop[1] <= TILE.rows);
        recipe.average_steps = self.average_steps.unwrap_or(recipe.average_steps);
        recipe.elevation_only = self.elevation_only.unwrap_or(recipe.elevation_only);
        recipe.drop_path = self.drop_path.unwrap_or(recipe.drop_path);
        recipe.elevation = self.elevation.unwrap_or(recipe.elevation);
        recipe.balanced = self.balanced.unwrap_or(recipe.balanced);
        recipe.target = self.target.unwrap_or(recipe.target);
        recipe.known_sun = self.known_sun.unwrap_or(recipe.known_sun);
        if let Some([elevation, gradient, normal]) = self.loss_weights.as_deref() {
            recipe.weights = LossWeights { elevation: *elevation, gradient: *gradient, normal: *normal };
        }
        recipe.validate_every = self.validate_every.unwrap_or(recipe.validate_every);
        recipe.validation_tiles = self.validation_tiles.unwrap_or(recipe.validation_tiles);
        recipe.checkpoint_every = self.checkpoint_every.unwrap_or(recipe.checkpoint_every);
        recipe.checkpoint_minutes = self.checkpoint_minutes.unwrap_or(recipe.checkpoint_minutes);
        recipe.check().map_err(Error::input)?;
        Ok(recipe)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cosine_ends_at_zero_and_never_restarts() {
        let recipe = Recipe::preset(Preset::Nano);
        let rates: Vec<f64> = (recipe.warm_up..=recipe.steps).map(|s| recipe.learning_rate_at(s)).collect();
        assert!(rates.windows(2).all(|w| w[1] <= w[0]), "must fall monotonically");
        assert!(rates[rates.len() - 1].abs() < 1e-12);
    }

    #[test]
    fn crops_are_turned_where_they_fit_unless_stated() {
        let of = |crop: Option<[usize; 2]>, transpose| {
            let options = RecipeFlags { crop: crop.map(Vec::from), transpose, ..RecipeFlags::default() };
            options.apply(Recipe::preset(Preset::Nano)).unwrap().transpose
        };
        assert_eq!([of(None, None), of(Some([128, 160]), None), of(Some([256, 320]), None)], [true, true, false]);
        assert_eq!([of(None, Some(false)), of(Some([256, 320]), Some(true))], [false, true]);
    }

    #[test]
    fn the_papers_recipe_is_the_papers() {
        for recipe in [Preset::Paper, Preset::Small].map(Recipe::preset) {
            // The paper: batch 4, 60,000 iterations at 1e-4 on a cosine, validated every 5,000; whole tiles.
            assert_eq!((recipe.batch, recipe.steps, recipe.validate_every, recipe.warm_up), (4, 60_000, 5_000, 0));
            assert_eq!((recipe.crop, recipe.crops_per_tile, recipe.target), ([256, 320], 1, Target::Truth));
            assert_eq!([0, 30_000].map(|step| recipe.learning_rate_at(step)), [1e-4, 0.5e-4]);
            // Eq. 5: 10 l_mn + l_grad + l_norm; the first 5,000 iterations l_mn alone.
            let all = LossWeights { elevation: 10.0, gradient: 1.0, normal: 1.0 };
            let alone = LossWeights { gradient: 0.0, normal: 0.0, ..all };
            assert_eq!([0, 4_999, 5_000, 59_999].map(|step| recipe.weights_at(step)), [alone, alone, all, all]);
            assert_eq!(
                (recipe.elevation, recipe.adversarial, recipe.drop_path),
                (Elevation::MeanNormalised, None, 0.2)
            );
        }
        // The small ones do without.
        for recipe in [Preset::Tiny, Preset::Nano].map(Recipe::preset) {
            assert_eq!((recipe.weights_at(0), recipe.drop_path), (recipe.weights, 0.0));
        }
    }

    #[test]
    fn recipes_of_older_programs_are_read() {
        let mut old = serde_json::to_value(Recipe::preset(Preset::Paper)).unwrap();
        old["elevation_only"] = serde_json::json!(0.25);
        old.as_object_mut().unwrap().remove("drop_path");
        let recipe: Recipe = serde_json::from_value(old).unwrap();
        assert!(recipe.elevation_alone(14_999) && !recipe.elevation_alone(15_000));
        assert_eq!(recipe.drop_path, 0.0);
    }
}
