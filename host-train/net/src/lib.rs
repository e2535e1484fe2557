//! The network as data. [`config`] is its configuration and [`weights`] are its weights; [`published`] reads those of other projects.
//! [`illumination`] is the light for which it is trained, [`sun`] checks the Sun's angles, and [`input`] has its maps. [`export`] compiles configuration and weights into the model file of the int8
//! runner, [`inspect`] reads that file, and [`shipped`] has two of them.
//!
//! The arithmetic is in `elunar-learn` on floats, in `elunar-core` on integers.

pub mod config;
pub mod export;
pub mod fit;
pub mod illumination;
pub mod input;
pub mod inspect;
mod names;
pub mod preset;
pub mod published;
pub mod shipped;
pub mod sun;
pub mod weights;
