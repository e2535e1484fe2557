//! C interface of the flight runner.
#![no_std]
pub use elunar_core;
