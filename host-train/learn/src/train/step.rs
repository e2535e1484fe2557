//! One optimiser step: forward, loss, backward, AdamW.

use super::adamw::{AdamW, Rule};
use super::adversarial::{CriticInput, Opponent};
use super::journal::StepRecord;
use super::loss::{balance, terms};
use super::parallel::DeviceGroup;
use super::recipe::Recipe;
use crate::model::backend::describe;
use crate::model::elunar::ELunarDtmNet;
use crate::model::store;
use crate::model::swin::depth::factors;
use crate::stopwatch::{TrainingPart, time};
use burn::optim::{GradientsAccumulator, GradientsParams};
use burn::tensor::{Device, Tensor, TensorData};
use elunar_base::{Error, Result};
use elunar_net::config::{ImageEncoderKind, NetConfig, TruthRange};
use elunar_net::weights::NetWeights;
use std::path::Path;

/// Image, coarse DTM and truth, each `[B, maps, H, W]`.
pub type BatchMaps = [Tensor<4>; 3];
/// A micro-batch, with its number in the step.
type Placed = (usize, BatchMaps);

/// A network and its optimiser on devices with automatic differentiation.
pub struct Trainer {
    /// Device of the network and the optimiser; with several devices, the first of them.
    pub device: Device,
    /// The network.
    pub net: ELunarDtmNet,
    pub(super) optimiser: AdamW,
    /// Critic of an adversarial recipe.
    pub opponent: Option<Opponent>,
    /// Devices of the micro-batches.
    devices: Vec<Device>,
    /// The devices, if there are several.
    group: Option<DeviceGroup>,
    /// Seed of stochastic depth.
    seed: u64,
    /// Number of Swin blocks.
    blocks: usize,
}

/// Weighted loss, elevation, gradient and normal term.
type Figures = [f64; 4];

fn add(sum: &mut Figures, more: Figures) {
    sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
}

/// Shares of AdamW's old moments; the defaults of PyTorch and of Burn.
const BETAS: [f32; 2] = [0.9, 0.999];
/// Seed of a critic's weights. Their random streams differ from any network's by the names of its tensors.
const OPPONENT_SEED: u64 = 1;

impl Trainer {
    /// Makes a network with these weights, which messages call `path`, and a new optimiser on the first of `devices`. There must be at
    /// least one device. Each computes gradients as `recipe` says.
    ///
    /// # Errors
    /// If the weights do not fit the configuration, or a device does not compute in the recipe's precision.
    pub fn new(
        config: &NetConfig,
        recipe: &Recipe,
        weights: &NetWeights,
        path: &Path,
        devices: Vec<Device>,
    ) -> Result<Self> {
        if recipe.balanced && config.target_range != TruthRange::Pixel {
            let found = config.target_range;
            return Err(Error::input(format!(
                "balanced: expected heights in pixels (network.target_range pixel), found {found:?}; take recipe.balanced=false"
            )));
        }
        let differentiate = |device: Device| {
            let device = device.autodiff();
            if recipe.checkpointing { device.gradient_checkpointing() } else { device }
        };
        if let Some(device) = devices.iter().find(|device| !recipe.precision.runs_on(device)) {
            let what = "precision bf16: expected a device that computes in bfloat16, found";
            return Err(Error::input(format!("{what} {}; take recipe.precision=f32", describe(device).name)));
        }
        let devices: Vec<Device> = devices.into_iter().map(differentiate).collect();
        let device = devices.first().ok_or_else(|| Error::input("devices: expected at least one, found none"))?.clone();
        let group = if devices.len() > 1 { Some(DeviceGroup::new(&devices)?) } else { None };
        let rule = Rule { betas: BETAS, weight_decay: recipe.weight_decay, clip_norm: recipe.clip_norm };
        let net = store::load(config, weights, path, &device)?;
        let opponent = recipe.adversarial.map(|a| Opponent::new(config, a, OPPONENT_SEED, &device)).transpose()?;
        let swin = config.image_encoder == ImageEncoderKind::Swin;
        let blocks = if swin { config.depths.iter().sum() } else { 0 };
        Ok(Self { device, net, optimiser: AdamW::new(rule), opponent, devices, group, seed: 0, blocks })
    }

    /// Sets the seed of stochastic depth [default: 0].
    #[must_use]
    pub fn seeded(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// Returns the device of micro-batch `index` of `count`.
    pub fn device_of(&self, index: usize, count: usize) -> &Device {
        &self.devices[index * self.devices.len() / count]
    }

    /// Returns image, coarse DTM and truth as tensors on the device, each `[B, maps, H, W]`. The number of values determines the number of
    /// maps.
    ///
    /// # Panics
    /// If the number of maps is not whole.
    pub fn tensors(&self, maps: [Vec<f32>; 3], [batch, rows, cols]: [usize; 3]) -> [Tensor<4>; 3] {
        maps.map(|map| {
            let channels = map.len() / (batch * rows * cols);
            Tensor::from_data(TensorData::new(map, [batch, channels, rows, cols]), &self.device)
        })
    }

    /// Runs step `step` (from 0) of `recipe` on micro-batches. Each device gets the same number, as [`Self::device_of`] says. Gradients and
    /// figures are means over the micro-batches. Batch normalisation uses one at a time.
    ///
    /// # Errors
    /// If the loss is not finite, or the optimiser's moments are those of another network. Then no weight has changed.
    ///
    /// # Panics
    /// If the devices cannot have the same number each.
    pub fn step(&mut self, recipe: &Recipe, step: usize, batches: Vec<BatchMaps>) -> Result<StepRecord> {
        assert!(batches.len().is_multiple_of(self.devices.len()), "every device works on as many micro-batches");
        let share = 1.0 / batches.len() as f64;
        let task = Task { recipe, step, share, seed: self.seed, blocks: self.blocks };
        let batches: Vec<Placed> = batches.into_iter().enumerate().collect();
        let found = match &self.group {
            None => {
                let Self { net, opponent, .. } = self;
                vec![in_pool(|| task.work(net, batches, opponent.as_mut()))?]
            }
            Some(group) => group.work(&mut self.net, batches, |net, batches| task.work(net, batches, None))?,
        };
        let mut figures = Figures::default();
        let mut gradients = GradientsAccumulator::new();
        for (of_device, more) in found {
            add(&mut figures, more);
            gradients.accumulate(&self.net, of_device);
        }
        let learning_rate = recipe.learning_rate_at(step);
        let learn = || self.optimiser.step(learning_rate, self.net.clone(), gradients.grads());
        self.net = time(TrainingPart::Optimiser, || in_pool(learn))?;
        let [loss, elevation, gradient, normal] = figures;
        Ok(StepRecord { step: step + 1, learning_rate, loss, elevation, gradient, normal })
    }
}

/// Runs `work` on a thread of the pool. From elsewhere, every parallel operator would wake the pool and wait for it: some thousand switches
/// of threads per step.
fn in_pool<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    rayon::scope(|_| work())
}

/// Reads scalars from the device, in one transfer.
fn numbers<const N: usize>(scalars: [Tensor<1>; N]) -> Result<[f64; N]> {
    let found = Tensor::cat(scalars.into(), 0).into_data().try_to_vec::<f32>();
    let found = found.map_err(|e| Error::input(format!("figures of a step: {e:?}")))?;
    Ok(std::array::from_fn(|i| f64::from(found[i])))
}

/// Work on the micro-batches of a step.
struct Task<'a> {
    recipe: &'a Recipe,
    step: usize,
    /// Weight of one micro-batch.
    share: f64,
    /// Seed of stochastic depth.
    seed: u64,
    /// Number of Swin blocks.
    blocks: usize,
}

impl Task<'_> {
    /// Runs forward, loss and backward, one micro-batch after the other. Returns gradients and figures, weighted by their share of the batch.
    fn work(
        &self,
        net: &ELunarDtmNet,
        batches: Vec<Placed>,
        mut opponent: Option<&mut Opponent>,
    ) -> Result<(GradientsParams, Figures)> {
        let Self { recipe, step, share, seed, blocks } = *self;
        let mut gradients = GradientsAccumulator::new();
        let mut figures = Figures::default();
        for (number, [image, coarse, truth]) in batches {
            let seen = recipe.precision.of(net);
            let [size, ..] = image.dims();
            let paths = factors(recipe.drop_path, blocks, seed, step, number * size..(number + 1) * size);
            let prediction = time(TrainingPart::Forward, || {
                seen.forward_in_training(image.clone(), coarse.clone(), paths.as_deref())
            });
            let terms = time(TrainingPart::Loss, || {
                // The first map of the coarse branch is what a residual head corrects.
                let factors = recipe.balanced.then(|| balance(&truth, coarse.clone().narrow(1, 0, 1)));
                terms(truth.clone(), prediction.clone(), recipe.elevation, factors.as_ref())
            });
            let mut total = recipe.weights_at(step).total(&terms);
            if let Some(opponent) = opponent.as_mut().filter(|_| !recipe.elevation_alone(step)) {
                total = total.add(opponent.term(&CriticInput { image, coarse }, truth, prediction)?);
            }
            let four = [&total, &terms.elevation, &terms.gradient, &terms.normal].map(|t| t.clone().detach());
            let total = if share < 1.0 { total.mul_scalar(share) } else { total };
            let found = time(TrainingPart::Backward, || GradientsParams::from_grads(total.backward(), net));
            gradients.accumulate(net, found);
            // Read together, and after the backward pass was given to the device: a GPU works on while the processor waits.
            let four = time(TrainingPart::Loss, || numbers(four))?;
            add(&mut figures, four.map(|figure| share * figure));
            let loss = figures[0];
            if !loss.is_finite() {
                let what = "expected a finite loss; lower the learning rate or look at the data";
                return Err(Error::input(format!("step {}: {what}, found {loss}", step + 1)));
            }
        }
        Ok((gradients.grads(), figures))
    }
}
