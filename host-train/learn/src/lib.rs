//! The float network in Burn, the only package that knows Burn: [`model`] is the network, [`train`] teaches it, [`float`] runs it over a scene.

pub mod check;
pub mod float;
pub mod model;
pub mod stopwatch;
#[cfg(test)]
mod testing;
pub mod train;
