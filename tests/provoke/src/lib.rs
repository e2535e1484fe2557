//! Arbitrary bytes against the flight library: what the fuzz targets and their seeded replays in `cases/` both run.

pub mod c_abi;
pub mod model;
mod random;

pub use random::Random;
