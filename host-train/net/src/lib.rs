//! The network as data: what it is ([`config`]), its numbers ([`weights`], from elsewhere: [`published`]), which light it knows ([`illumination`]), and
//! the compiler that turns both into the model file of the int8 runner ([`export`]), which [`inspect`] reads again.
//!
//! Its arithmetic is elsewhere: in `elunar-learn` on floats, in `elunar-core` on integers.

pub mod config;
pub mod digest;
pub mod export;
pub mod fit;
pub mod illumination;
pub mod inspect;
mod names;
pub mod published;
pub mod weights;
