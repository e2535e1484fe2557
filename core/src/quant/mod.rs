//! Numbers of the flight path: the rounding rule, integer multipliers, tables.

pub mod limit;
pub mod lut;
pub mod params;
pub mod requant;
pub mod rsqrt;

pub use params::{MULTIPLIER_LIMIT, SHIFT_LIMIT};
pub use requant::{requantise, round_shift};
