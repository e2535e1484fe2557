//! Training: data feed, loss, schedule, checkpoints, validation.
//!
//! [`run`] is the loop, and [`step`] is one step of it. [`feed`] makes normalised, cropped batches ([`elunar_data`]). [`loss`] is
//! Eq. 5–7 on tensors. [`recipe`] has the hyper-parameters. [`adversarial`] trains against a critic. `parallel` divides a step between
//! several devices. [`checkpoint`] allows a killed run to continue. [`validate`], [`journal`] and [`curves`] record the progress.
//! [`speed`] measures steps and feed.

mod adamw;
pub mod adversarial;
pub mod average;
pub mod checkpoint;
pub mod curves;
pub mod elevation_only;
pub mod feed;
mod flat;
pub mod journal;
mod kept;
pub mod loss;
mod parallel;
pub mod recipe;
pub mod run;
pub mod speed;
pub mod step;
pub mod validate;

use elunar_data::{sample, source};

#[cfg(test)]
mod tests;
