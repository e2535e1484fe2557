//! One optimiser step: forward, loss, backward, AdamW.

use super::adversarial::{Opponent, Scene};
use super::checkpoint::Checkpoint;
use super::journal::StepRecord;
use super::loss::terms;
use super::recipe::Recipe;
use crate::model::config::NetConfig;
use crate::model::elunar::ELunarDtmNet;
use crate::model::store;
use crate::model::weights::Weights;
use crate::stopwatch::{Part, time};
use crate::{Error, Result};
use burn::grad_clipping::GradientClippingConfig;
use burn::optim::{AdamWConfig, GradientsAccumulator, GradientsParams, ModuleOptimizer};
use burn::tensor::{Device, Tensor, TensorData};
use std::path::Path;

/// A network and its optimiser on a device with automatic differentiation.
pub struct Trainer {
    /// Where both are.
    pub device: Device,
    /// The network.
    pub net: ELunarDtmNet,
    /// AdamW and its moments.
    pub optimiser: ModuleOptimizer,
    /// The recipe's opponent.
    pub opponent: Option<Opponent>,
}

/// Seed of an opponent's weights: its own stream beside any network's, by the names of its tensors.
const OPPONENT_SEED: u64 = 1;

impl Trainer {
    /// A network with these weights, named `path` in messages, and a fresh optimiser on `device`, where `recipe` wants gradients
    /// to be computed.
    ///
    /// # Errors
    /// If the weights do not fit the configuration.
    pub fn new(config: &NetConfig, recipe: &Recipe, weights: &Weights, path: &Path, device: Device) -> Result<Self> {
        let device = device.autodiff();
        let device = if recipe.checkpointing { device.gradient_checkpointing() } else { device };
        let optimiser = AdamWConfig::new()
            .with_weight_decay(recipe.weight_decay)
            .with_epsilon(1e-8)
            .with_grad_clipping(Some(GradientClippingConfig::Norm(recipe.clip_norm)))
            .init();
        let net = store::load(config, weights, path, &device)?;
        let opponent = recipe.adversarial.map(|a| Opponent::new(config, a, OPPONENT_SEED, &device)).transpose()?;
        Ok(Self { device, net, optimiser, opponent })
    }

    /// Goes on with a checkpoint's moments.
    ///
    /// # Errors
    /// If Burn cannot read its record.
    pub fn restore(&mut self, saved: &Checkpoint) -> Result<()> {
        self.optimiser = saved.restore(self.optimiser.clone())?;
        if let Some(opponent) = &mut self.opponent {
            saved.restore_opponent(opponent, &self.device)?;
        }
        Ok(())
    }

    /// Image, coarse DTM and truth, each `[B, maps, H, W]` with as many maps as the numbers make, as tensors on the device.
    ///
    /// # Panics
    /// If they make no whole number of maps.
    pub fn tensors(&self, maps: [Vec<f32>; 3], [batch, rows, cols]: [usize; 3]) -> [Tensor<4>; 3] {
        maps.map(|map| {
            let channels = map.len() / (batch * rows * cols);
            Tensor::from_data(TensorData::new(map, [batch, channels, rows, cols]), &self.device)
        })
    }

    /// Step `step` (from 0) of `recipe` on micro-batches of image, coarse DTM and truth, each `[B, maps, H, W]`. Gradients and figures
    /// are means over the micro-batches; batch normalisation sees one at a time.
    ///
    /// # Errors
    /// If the loss is not finite; nothing has been learnt then.
    pub fn step(&mut self, recipe: &Recipe, step: usize, batches: Vec<[Tensor<4>; 3]>) -> Result<StepRecord> {
        let learning_rate = recipe.learning_rate_at(step);
        let (mut loss, mut elevation, mut gradient, mut normal) = (0.0, 0.0, 0.0, 0.0);
        let share = 1.0 / batches.len() as f64;
        let mut gradients = GradientsAccumulator::new();
        for [image, coarse, truth] in batches {
            let prediction = time(Part::Forward, || self.net.forward(image.clone(), coarse.clone()));
            let terms = time(Part::Loss, || terms(truth.clone(), prediction.clone(), recipe.elevation));
            let mut total = recipe.weights_at(step).total(&terms);
            if let Some(opponent) = self.opponent.as_mut().filter(|_| !recipe.elevation_alone(step)) {
                total = total.add(opponent.term(&Scene { image, coarse }, truth, prediction));
            }
            let number = |t: &Tensor<1>| share * f64::from(t.clone().into_scalar::<f32>());
            loss += number(&total);
            elevation += number(&terms.elevation);
            gradient += number(&terms.gradient);
            normal += number(&terms.normal);
            if !loss.is_finite() {
                let what = "expected a finite loss; lower the learning rate or look at the data";
                return Err(Error::usage(format!("step {}: {what}, found {loss}", step + 1)));
            }
            let total = if share < 1.0 { total.mul_scalar(share) } else { total };
            let found = time(Part::Backward, || GradientsParams::from_grads(total.backward(), &self.net));
            gradients.accumulate(&self.net, found);
        }
        let learn = || self.optimiser.step(learning_rate, self.net.clone(), gradients.grads());
        self.net = time(Part::Optimiser, learn);
        Ok(StepRecord { step: step + 1, learning_rate, loss, elevation, gradient, normal })
    }
}
