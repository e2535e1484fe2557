//! Training: data feed, schedule, checkpoints, metrics.
