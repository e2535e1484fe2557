//! The float network in Burn. No other package uses Burn. [`model`] is the network, [`train`] trains it, [`float`] runs it on a scene.

pub mod check;
pub mod float;
pub mod model;
pub mod stopwatch;
#[cfg(test)]
mod testing;
pub mod train;
