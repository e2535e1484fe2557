//! Tiles for training and calibration: their sources, and their form as input of a network.

pub mod calibration;
pub mod folder;
pub mod prepared;
pub mod sample;
pub mod source;

#[cfg(test)]
mod serve_tests;
