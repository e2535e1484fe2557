//! Tiles to learn from and to calibrate with: where they come from, and how a network sees them.

pub mod calibration;
pub mod folder;
pub mod prepared;
pub mod sample;
pub mod source;

#[cfg(test)]
mod serve_tests;
