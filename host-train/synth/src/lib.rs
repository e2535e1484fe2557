//! The synthetic Moon: terrain, photometry, camera and coarse DTM. With it, every test, tour and training run works without downloads.
//!
//! A scene is made in this order. `field` draws the spectral terrain and the albedo. `crater` adds craters of all ages. `boulder` adds
//! boulders around the fresh ones, `landform` other forms. `light` illuminates the ground (Lunar–Lambert, cast shadows). `camera` converts
//! radiance to DN. `coarse` averages the terrain to ~59 m and adds the errors of a global DTM. `files` writes the scene. `factors` draws the differences from an
//! average scene, and [`structure`] measures the roughness of the result.
//!
//! A scene depends only on `(seed, options, index)`: not on the number of threads, the processor or its C library (`clippy.toml`).
#![cfg_attr(test, allow(clippy::disallowed_methods))]

mod albedo;
mod boulder;
mod camera;
mod coarse;
mod crater;
mod factors;
mod field;
mod files;
mod kind;
mod landform;
mod light;
mod moon;
mod options;
mod photograph;
mod smooth;
pub mod structure;

pub use coarse::{COARSE_PIXEL_M, CoarseGrid};
pub use files::{MANIFEST, SceneEntry, SynthManifest, scene_files};
pub use kind::TerrainKind;
pub use moon::{Moon, SynthScene, SynthTile};
pub use options::SynthOptions;
pub use photograph::photograph;

#[cfg(test)]
mod tests;
