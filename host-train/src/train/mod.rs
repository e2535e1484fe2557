//! Training: data feed, schedule, checkpoints, metrics.

pub mod loss;
