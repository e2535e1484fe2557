//! Placeholder tour.
#![cfg_attr(not(test), no_std)]

pub mod nn;
pub mod quant;
