//! Export: from float weights to the model file of the runner.
//!
//! [`build`] makes the operator [`graph`] from the configuration and the weights, with batch norm folded in. [`float`] runs it on real
//! numbers, which shows that the graph equals the network and measures the ranges of its maps ([`calibrate`]). [`quantise`] converts it to
//! integers: [`codes`] defines the codes of maps, `fold` makes upsamplings part of filters, `pack` puts weights in the kernels' order.
//! [`schedule`] orders the steps. [`plan`] chooses the number of rows kept and their place in the arena. [`Content`](elunar_core::nn::file::Content) writes the file.
//! [`compile`] does all of this.

pub mod build;
pub mod calibrate;
pub mod choose;
pub mod codes;
pub mod compile;
mod costs;
pub mod float;
mod fold;
pub mod graph;
pub mod large_steps;
mod pack;
pub mod plan;
pub mod quantise;
pub mod report;
mod rounding;
pub mod schedule;
pub mod sensitivity;

pub use calibrate::CalibrationTile;
pub use codes::MapBits;
pub use compile::{CompileOptions, export};

#[cfg(test)]
mod tests;
