//! Training: data feed, loss, schedule, checkpoints, validation.
//!
//! [`run`] is the loop, [`step`] one step of it; [`feed`] hands it normalised, cropped batches ([`elunar_scene::data`]); [`loss`] is Eq. 5–7 on tensors; [`recipe`]
//! holds the hyper-parameters, [`adversarial`] a rival's opponent; `parallel` lets several devices share a step; [`checkpoint`] makes a killed run go on; [`validate`], [`journal`] and [`curves`] say
//! how it goes.

pub mod adversarial;
pub mod checkpoint;
pub mod curves;
pub mod feed;
pub mod journal;
pub mod loss;
mod parallel;
pub mod recipe;
pub mod run;
pub mod step;
pub mod validate;

use elunar_scene::data::{sample, source};

#[cfg(test)]
mod tests;
