//! From float weights to the model file of the runner: a small compiler.
//!
//! [`build`] makes the operator [`graph`] from the configuration and the weights, with batch norm folded in; [`float`] runs it
//! on real numbers, which shows that the graph is the network and measures the ranges of its maps ([`calibrate`]); [`quantise`]
//! turns it into integers ([`codes`]: how, `fold`: upsamplings become part of filters, `pack`: weights in the kernels' order); [`schedule`] orders the
//! steps; [`plan`] says how many rows are kept and where in the arena; [`write`] writes the file; [`compile`] does all of it.

pub mod build;
pub mod calibrate;
pub mod choose;
pub mod codes;
pub mod compile;
mod costs;
pub mod float;
mod fold;
pub mod graph;
mod pack;
pub mod plan;
pub mod quantise;
pub mod report;
mod rounding;
pub mod schedule;
pub mod sensitivity;
pub mod write;

pub use calibrate::CalibrationTile;
pub use compile::{Options, Precision, export};

#[cfg(test)]
mod tests;
