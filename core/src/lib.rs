//! The arithmetic of ELunarDTM, for a laptop and for a spacecraft: no `std`, no heap, no files, no threads.
//!
//! ```
//! use elunar_core::nn::{Model, Progress, Runner, TileInput, TileLight, required};
//!
//! // A network of random weights, small enough to travel with this crate; its tile has 32 x 32 pixels.
//! let model = Model::new(include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/tile-v4.eld")))?;
//! let shape = model.tile();
//! let image: Vec<f32> = (0..shape.pixels()).map(|i| 90.0 + (i % 7) as f32).collect(); // brightness, in any unit
//! let coarse_m: Vec<f32> = (0..shape.pixels()).map(|i| -1900.0 + (i / shape.cols) as f32).collect(); // metres, on the image's grid
//!
//! let mut arena = vec![0; required(&model)]; // all memory that it takes
//! let mut runner = Runner::new(model, &mut arena)?;
//! let light = TileLight::default(); // an unknown Sun; this model knows any
//! let tile = TileInput { image: &image, coarse_m: &coarse_m, valid: None, pixel_m: 2.0, coarse_px: 30.0, light };
//! let begun = runner.begin_metres(&tile, &mut [])?;
//! while runner.step(1_000_000)? == Progress::Running {} // multiply-accumulates at a time
//! let mut heights_m = vec![0.0; shape.pixels()];
//! runner.heights(&begun.scale, &mut heights_m)?;
//! # assert!(heights_m.iter().zip(&coarse_m).all(|(fine, coarse)| (fine - coarse).abs() < 10.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The path of one tile from image to metres, with the module of each step:
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
//! For a camera that delivers lines, [`strip`] does all of this line by line: [`resample`] brings the coarse DTM onto the image's grid,
//! [`fill`] fills voids, [`overlap`] gives the weights for blending tiles.
//!
//! The figures of comparison are in [`loss`] (Eq. 5–7, with analytic gradients; the reference for training), [`metrics`] (Eq. 11–18) and
//! [`terrain`] (slope, hillshade, normals and, line by line, the hazards of a lander's footprint).
//! # Promises
//! All memory is lent by the caller. Sums run in `f64`. No function panics on any value of its arguments. What cannot be computed is an
//! error: a small `Copy` enum beside the operation that returns it.
#![cfg_attr(not(test), no_std)]

pub mod error;
pub mod fill;
pub mod grid;
pub mod loss;
pub mod mask;
pub mod metrics;
pub mod nn;
pub mod norm;
pub mod overlap;
mod part;
pub mod photoclinometry;
pub mod quant;
pub mod resample;
pub mod strip;
pub mod terrain;
pub mod tile;

/// Runs the examples of the README as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
