//! The network as data. [`config`] is its configuration and [`weights`] are its weights; [`published`] reads those of other projects.
//! [`illumination`] is the light for which it is trained, and [`sun`] checks the Sun's angles. [`export`] compiles configuration and weights into the
//! model file of the int8 runner, [`inspect`] reads that file, and [`shipped`] has two of them. [`job`] has the memory for a tile, and
//! [`kernels`] lists what this machine runs.
//!
//! The arithmetic is in `elunar-learn` on floats, in `elunar-core` on integers.

pub mod config;
pub mod export;
pub mod fit;
pub mod illumination;
pub mod inspect;
pub mod job;
pub mod kernels;
mod names;
pub mod preset;
pub mod published;
pub mod shipped;
pub mod sun;
pub mod weights;
