//! Arbitrary bytes as input of the flight library, for the fuzz targets and their seeded replays in `cases/`.

#![no_std] // boards run it, too

extern crate alloc;
#[cfg(test)]
extern crate std;

pub mod c_abi;
pub mod c_lines;
pub mod mender;
pub mod model;
pub mod programs;
mod random;

pub use random::Random;
