//! Speed of training by parts: steps on one batch without a feed, and the feed without a network.

use super::feed::{Feed, tensors};
use super::recipe::Recipe;
use super::step::Trainer;
use crate::model::backend::Backend;
use elunar_base::{Error, Result};
use elunar_net::config::NetConfig;
use elunar_net::weights::NetWeights;
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// Speed of training steps.
#[derive(Debug, Clone, Serialize)]
pub struct Steps {
    /// Seconds of the steps that were not counted. A GPU's kernels are compiled and chosen in them.
    pub untimed_s: f64,
    /// Steps per second, transfer of the batch included.
    pub steps_per_s: f64,
    /// Losses of the first steps, at most three. They show that backends train the same.
    pub first_losses: Vec<f64>,
    /// Loss of the last step.
    pub last_loss: f64,
}

/// Times `count` steps of a network on the first batch of `feed`, after `untimed` ones.
///
/// # Errors
/// If there is no device, no batch can be made, or a loss is not finite.
pub fn steps(
    feed: &Feed,
    (config, weights): (&NetConfig, &NetWeights),
    recipe: &Recipe,
    backend: Backend,
    [untimed, count]: [usize; 2],
    progress: &mut dyn FnMut(usize, f64),
) -> Result<Steps> {
    let devices = backend.devices(recipe.devices)?;
    let mut trainer = Trainer::new(config, recipe, weights, Path::new("weights"), devices)?;
    let samples = feed.batch(0)?;
    let parts = recipe.parts();
    let mut losses = Vec::new();
    let mut run = |step: usize| -> Result<()> {
        let micro = samples.chunks(recipe.batch / parts).enumerate();
        let micro = micro.map(|(i, samples)| tensors(samples, trainer.device_of(i, parts))).collect();
        losses.push(trainer.step(recipe, step, micro)?.loss);
        progress(step + 1, losses[step]);
        Ok(())
    };
    let start = Instant::now();
    (0..untimed).try_for_each(&mut run)?;
    let untimed_s = start.elapsed().as_secs_f64();
    let start = Instant::now();
    (untimed..untimed + count).try_for_each(&mut run)?;
    // The last step's weights may still be on their way.
    trainer.device.sync().map_err(|e| Error::input(format!("backend {}: {e:?}", backend.name())))?;
    let steps_per_s = count as f64 / start.elapsed().as_secs_f64();
    let last_loss = losses.last().copied().unwrap_or(f64::NAN);
    Ok(Steps { untimed_s, steps_per_s, first_losses: losses.into_iter().take(3).collect(), last_loss })
}

/// Times `count` batches of `feed`, made by `makers` threads, after two of each maker. Returns batches per second.
///
/// # Errors
/// If a batch cannot be made.
pub fn batches(feed: &Feed, makers: usize, count: usize) -> Result<f64> {
    let mut made = feed.ahead(0, makers);
    let mut next = || made.next().unwrap_or_else(|| Err(Error::input("the data feed stopped early"))).map(drop);
    (0..2 * makers).try_for_each(|_| next())?;
    let start = Instant::now();
    (0..count).try_for_each(|_| next())?;
    Ok(count as f64 / start.elapsed().as_secs_f64())
}
