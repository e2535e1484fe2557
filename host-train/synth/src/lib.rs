//! The synthetic Moon: terrain, photometry, camera and coarse DTM, so that every test, demo and training run works without
//! downloads.
//!
//! One scene is made in this order: `field` draws the spectral terrain and the albedo, `crater` adds craters in all
//! states of decay, `boulder` strews blocks around the fresh ones, `light` illuminates it (Lunar–Lambert, cast shadows), `camera` turns radiance into DN, `coarse`
//! averages the terrain to ~59 m and spoils it as a global DTM is spoilt, `files` writes it. `factors` draws how far a scene departs from
//! the usual one; [`structure`] measures how rough the result is.
//!
//! Everything follows from `(seed, options, index)`; the number of threads changes nothing.

mod boulder;
mod camera;
mod coarse;
mod crater;
mod factors;
mod field;
mod files;
mod kind;
mod light;
mod moon;
mod options;
mod photograph;
pub mod structure;

pub use coarse::{COARSE_PIXEL_M, CoarseGrid};
pub use files::{Manifest, SceneEntry};
pub use kind::TerrainKind;
pub use moon::{Moon, SynthScene, SynthTile};
pub use options::SynthOptions;
pub use photograph::photograph;

#[cfg(test)]
mod tests;
