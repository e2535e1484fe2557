#![doc = include_str!("../README.md")]
//!
//! # The path of a tile
//! From image to metres, with the module of each step:
//!
//! 1. [`grid`] views a rectangle of the caller's pixels, with a row stride. No type here owns an image.
//! 2. [`mask`] says which pixels are valid. NaN and what is 1e30 or more from zero are not.
//! 3. [`tile`] cuts a scene into windows of 256 rows by 320 columns, which overlap at inference.
//! 4. [`norm`] normalises the image to [0, 1] and the coarse DTM to [0, NR] (Eq. 1–2). The [`norm::ElevationScale`] that results is needed
//!    to bring heights back to metres. A network with a given light takes slopes and pixels instead, and the relief from
//!    [`photoclinometry`].
//! 5. The network predicts normalised heights: in floating point on the ground, in integers in flight ([`nn`], with the rounding rule of
//!    [`quant`]).
//! 6. [`norm::ElevationScale::recover`] returns metres above the 1737.4 km sphere (Eq. 8).
//!
//! [`job`] does all of this in order, a bounded piece at a time, from [`samples`] in any form ([`pixels`], [`posts`]): it is what every caller drives.
//!
//! For a camera that delivers lines, [`strip`] does all of this line by line: [`resample`] brings the coarse DTM onto the image's grid,
//! [`fill`] fills voids, [`overlap`] gives the weights for blending tiles.
//!
//! The figures of comparison are in [`loss`] (Eq. 5–7, with analytic gradients; the reference for training), [`metrics`] (Eq. 11–18) and
//! [`terrain`] (slope, hillshade, normals and, line by line, the hazards of a lander's footprint). [`sun`] says where the Sun stands.
#![cfg_attr(not(test), no_std)]

pub mod error;
pub mod fill;
pub mod grid;
pub mod job;
pub mod loss;
pub mod mask;
pub mod metrics;
pub mod nn;
pub mod norm;
pub mod overlap;
mod part;
pub mod photoclinometry;
pub mod pixels;
pub mod posts;
pub mod quant;
pub mod resample;
pub mod samples;
pub mod strip;
pub mod sun;
pub mod terrain;
pub mod tile;
mod words;

// What a user of one tile calls.
pub use job::{JobError, Made, TileInput, TileJob, TileMemory, TileRules};
pub use nn::{KnownSun, Lighting, Model, ModelError, Progress, RunError, Runner, TileLight, required};
