//! Hyper-parameters: the paper's for the presets of the paper, ours for the small ones.

use super::adversarial::Adversarial;
use super::elevation_only::ElevationOnly;
use super::loss::{Elevation, LossWeights};
use super::sample::RawTile;
use crate::model::precision::TrainingPrecision;
use elunar_base::Result;
use elunar_core::tile::TILE;
use elunar_net::config::Preset;
use serde::{Deserialize, Serialize};

/// Target of the training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TrainingTarget {
    /// The unchanged truth (the paper).
    Truth,
    /// The truth with the low frequencies of the coarse DTM (our choice).
    Anchored,
}

impl TrainingTarget {
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
    pub accumulate: usize,
    /// Number of devices that share a step's batch. Each processes `accumulate` parts of it. `accumulate` times `devices` divides `batch`.
    pub devices: usize,
    /// Whether cheap operations are computed again for the gradients, to save memory.
    pub checkpointing: bool,
    /// Precision of the network.
    pub precision: TrainingPrecision,
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
    pub balanced: bool,
    /// Target of training and validation.
    pub target: TrainingTarget,
    /// Critic of adversarial training, used after the elevation-only steps; `None` without it.
    pub adversarial: Option<Adversarial>,
    /// Stochastic depth: share of a residual branch's samples that the last Swin block leaves out; it grows linearly from 0 in the first block.
    /// Swin's segmentation code has 0.2, the paper is silent. 0 leaves out nothing.
    pub drop_path: f64,
    /// Share of the tiles whose known Sun is given to the network. For the others, the light is fitted.
    pub known_sun: f64,
    /// Rows and columns of the random crop of each 256x320 tile after normalisation; multiples of 32.
    pub crop: [usize; 2],
    /// Number of crops of one tile.
    pub crops_per_tile: usize,
    /// Number of the latest tiles from which every crop's tile is drawn, so that a tile serves several steps; 0: each step's own tiles.
    pub pool: usize,
    /// Whether half of the crops have rows and columns exchanged.
    pub transpose: bool,
    /// Number of steps over which the weights are averaged ([`super::average::Average`]), at most a quarter of the run's steps. The mean is
    /// validated and written. 0: no mean.
    pub average_steps: usize,
    /// Number of steps between validations.
    pub validate_every: usize,
    /// Number of tiles of the fixed validation set.
    pub validation_tiles: usize,
    /// Number of steps between checkpoints.
    pub checkpoint_every: usize,
    /// Greatest time between checkpoints, minutes. The time does not change the result.
    pub checkpoint_minutes: f64,
}

impl Recipe {
    /// Returns the recipe of a preset's document: the paper's for `paper` and `small`; short, cropped and fast for `tiny` and `nano`.
    #[must_use]
    pub fn preset(preset: Preset) -> Self {
        preset.table("recipe")
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
        if self.transpose && self.crop[1] > TILE.rows {
            let (rows, cols) = (TILE.rows, self.crop[1]);
            return Err(format!(
                "transpose: expected crops of at most {rows} columns, which fit a tile turned, found {cols}"
            ));
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
    fn turned_crops_fit_a_tile() {
        let nano = Recipe::preset(Preset::Nano);
        assert_eq!(nano.check(), Ok(()));
        let whole = Recipe { crop: [256, 320], ..nano };
        assert!(whole.check().unwrap_err().contains("at most 256 columns"));
        assert_eq!(Recipe { transpose: false, ..whole }.check(), Ok(()));
    }

    #[test]
    fn the_papers_recipe_is_the_papers() {
        for recipe in [Preset::Paper, Preset::Small].map(Recipe::preset) {
            // The paper: batch 4, 60,000 iterations at 1e-4 on a cosine, validated every 5,000; whole tiles.
            assert_eq!((recipe.batch, recipe.steps, recipe.validate_every, recipe.warm_up), (4, 60_000, 5_000, 0));
            assert_eq!((recipe.crop, recipe.crops_per_tile, recipe.target), ([256, 320], 1, TrainingTarget::Truth));
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
    fn a_first_part_is_a_number_of_steps_or_a_share() {
        let mut stated = serde_json::to_value(Recipe::preset(Preset::Paper)).unwrap();
        stated["elevation_only"] = serde_json::json!(0.25);
        let recipe: Recipe = serde_json::from_value(stated).unwrap();
        assert!(recipe.elevation_alone(14_999) && !recipe.elevation_alone(15_000));
    }
}
