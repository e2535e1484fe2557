//! Training against a critic, as in LDEMGAN and MADNet: least-squares losses (Mao et al. 2017) with a patch critic. Its input is image,
//! coarse DTM and the DTM to be scored.
//!
//! ```text
//! critic:   mean((C(truth) - 1)²)/2 + mean(C(prediction)²)/2          the prediction as a constant
//! network:  hybrid loss + weight * mean((C(prediction) - 1)²)          the critic as it is then
//! ```

use super::adamw::{AdamW, Rule};
use crate::model::critic::Critic;
use crate::model::init::normal_weights;
use crate::model::store;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};
use elunar_base::Result;
use elunar_net::config::NetConfig;
use elunar_net::weights::NetWeights;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The part of a recipe for training against a critic.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Adversarial {
    /// Weight of the adversarial term, which is added to the hybrid loss.
    pub weight: f64,
    /// Learning rate of the critic, constant.
    pub learning_rate: f64,
    /// Channels of the critic after its first halving.
    pub width: usize,
}

impl Adversarial {
    /// Checks the fields.
    ///
    /// # Errors
    /// One line with the field, what was expected and what was found.
    pub fn check(&self) -> std::result::Result<(), String> {
        let positive = |name: &str, value: f64| {
            let sound = value.is_finite() && value > 0.0;
            if sound { Ok(()) } else { Err(format!("adversarial {name}: expected a number above 0, found {value}")) }
        };
        positive("weight", self.weight)?;
        positive("learning rate", self.learning_rate)?;
        if (1..=1024).contains(&self.width) {
            Ok(())
        } else {
            Err(format!("adversarial width: expected 1..=1024, found {}", self.width))
        }
    }
}

/// A critic and its optimiser.
pub struct Opponent {
    critic: Critic,
    pub(super) optimiser: AdamW,
    recipe: Adversarial,
    /// Factor that brings normalised elevation to [0, 1].
    scale: f64,
}

/// Input of the critic besides the DTM.
pub struct CriticInput {
    /// `[B, maps, H, W]`.
    pub image: Tensor<4>,
    /// `[B, 1, H, W]` in [0, NR].
    pub coarse: Tensor<4>,
}

impl Opponent {
    /// Makes a critic with weights from `seed`, on `device`.
    ///
    /// # Errors
    /// Never, because the weights are made here.
    pub fn new(config: &NetConfig, recipe: Adversarial, seed: u64, device: &Device) -> Result<Self> {
        let critic = Critic::new(config.image_maps() + 2, recipe.width, device);
        let weights = normal_weights(store::arrays(&critic), seed);
        let critic = store::put(critic, &weights, Path::new("critic"), device)?;
        // Adam; the first moment's decay is 0.5, as usual for critics.
        let optimiser = AdamW::new(Rule { betas: [0.5, 0.999], weight_decay: 0.0, clip_norm: f32::INFINITY });
        Ok(Self { critic, optimiser, recipe, scale: 1.0 / f64::from(config.nr) })
    }

    /// Returns the critic's weights.
    pub fn weights(&self) -> NetWeights {
        store::arrays(&self.critic)
    }

    /// Replaces the critic's weights. Messages call the new weights `path`.
    ///
    /// # Errors
    /// If the weights do not fit.
    pub fn restore(&mut self, weights: &NetWeights, path: &Path, device: &Device) -> Result<()> {
        self.critic = store::put(self.critic.clone(), weights, path, device)?;
        Ok(())
    }

    fn score(&self, scene: &CriticInput, dtm: Tensor<4>) -> Tensor<4> {
        let [coarse, dtm] = [scene.coarse.clone(), dtm].map(|z| z.mul_scalar(self.scale));
        self.critic.forward(Tensor::cat(vec![scene.image.clone(), coarse, dtm], 1))
    }

    /// Trains the critic on a truth and a prediction. Then returns the weighted adversarial term of the prediction, `[1]`.
    ///
    /// # Errors
    /// If the optimiser's moments are those of another critic.
    pub fn term(&mut self, scene: &CriticInput, truth: Tensor<4>, prediction: Tensor<4>) -> Result<Tensor<1>> {
        let halved = |scores: Tensor<4>| scores.powi_scalar(2).mean().mul_scalar(0.5);
        let real = halved(self.score(scene, truth).sub_scalar(1.0));
        let made = halved(self.score(scene, prediction.clone().detach()));
        let gradients = GradientsParams::from_grads(real.add(made).backward(), &self.critic);
        self.critic = self.optimiser.step(self.recipe.learning_rate, self.critic.clone(), gradients)?;
        let term = self.score(scene, prediction).sub_scalar(1.0).powi_scalar(2).mean();
        Ok(term.mul_scalar(self.recipe.weight))
    }
}
