//! The float network: configuration, weights, and the Burn modules named as in the paper's figures.

pub mod config;
pub mod weights;
