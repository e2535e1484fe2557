//! Push-broom mode: lines of a strip in, blended lines of heights out.
//!
//! A push-broom camera delivers lines, and their number is not known in advance. [`Strip`] takes them one by one with the coarse DTM on the
//! same pixels ([`Posts`] computes it from the rows of the coarse DTM). It runs every tile of the model as soon as its lines are there, and
//! returns lines of heights as soon as no further tile can reach them. Memory is planned before the first line ([`StripPlan`]). The heights
//! have the same bits as those of the ground's mosaic of the same tiles.
//!
//! ```
//! use elunar_core::nn::{KnownSun, LightSource, Lighting, Model, Runner};
//! use elunar_core::norm::LightFit;
//! use elunar_core::strip::{Next, PostGrid, Posts, Strip, StripMemory, StripPlan, StripSettings};
//!
//! # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../host-train/models/nano.eld");
//! # let model_file = std::fs::read(path)?;
//! let model = Model::new(&model_file)?;
//! let (cols, coarse_px) = (320, 30.0);
//! // Nothing has been seen of the ground yet, so the Sun should be known.
//! let sun = KnownSun { azimuth_deg: Some(315.0), elevation_deg: Some(35.0) };
//! let light = Lighting::decide(model.illumination(), sun, &LightFit::default());
//! assert_eq!(light.source, LightSource::Given);
//! let settings = StripSettings {
//!     cols,
//!     ring_lines: StripPlan::least_lines(&model),
//!     overlap_px: 100,
//!     pixel_m: 2.0,
//!     coarse_px,
//!     anchor: true,
//!     light,
//!     expected_errors: false,
//! };
//! let plan = StripPlan::new(&model, settings)?;
//!
//! // In flight these are arrays of the flight software.
//! let (mut arena, mut valid) = (vec![0; plan.arena_bytes()], vec![0; plan.valid_len()]);
//! let (mut samples, mut sums) = (vec![0.0; plan.samples_len()], vec![0.0; plan.sums_len()]);
//! let memory = StripMemory { samples: &mut samples, sums: &mut sums, valid: &mut valid };
//! let mut strip = Strip::new(plan, Runner::new(model, &mut arena)?, memory)?;
//!
//! // Posts 30 pixels apart, from a row and a column before the strip on.
//! let grid = PostGrid::spaced(14, (-30.0, -30.0), (30.0, 30.0));
//! let mut post_memory = vec![0.0; Posts::memory_len(grid.cols)];
//! let mut posts = Posts::new(grid, &mut post_memory)?;
//! let (mut coarse_m, mut heights_m, mut post_rows, mut done) = ([0.0; 320], [0.0; 320], 0, 0);
//! for line in 0..300 {
//!     let image: Vec<f32> = (0..cols).map(|col| 100.0 + ((line * 7 + col * 13) % 31) as f32).collect();
//!     while posts.line(&mut coarse_m).is_none() {
//!         let row_m: Vec<f32> = (0..grid.cols).map(|col| -1900.0 + (col * post_rows) as f32).collect();
//!         posts.push_row(&row_m)?;
//!         post_rows += 1;
//!     }
//!     strip.push_line(&image, &coarse_m)?;
//!     // Between two lines there is time for a step, or for many.
//!     while strip.step(50_000_000) == Next::Step {}
//!     while strip.take_line(&mut heights_m)?.is_some() {
//!         done += 1;
//!     }
//! }
//! strip.finish();
//! while strip.wants() != Next::Done || strip.ready() > 0 {
//!     strip.step(50_000_000);
//!     while strip.take_line(&mut heights_m)?.is_some() {
//!         done += 1;
//!     }
//! }
//! assert_eq!((done, strip.counters().tiles), (300, 2));
//! assert!(heights_m.iter().all(|z| z.is_finite()));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What a line costs
//! Taking and returning a line cost a fixed time each: the first copies the line, the second divides it by its weights. All other work is
//! in [`Strip::step`], whose pieces are at most as large as a tile. `core/docs/strip.md` gives memory and time, and the response to faults.

mod blend;
mod cut;
mod error;
mod expected;
mod lines;
mod pipeline;
mod plan;
mod posts;

pub use error::StripError;
pub use expected::LineErrors;
pub use pipeline::{Next, Strip, StripCounters, StripMemory, StripPaused};
pub use plan::{StripPlan, StripSettings};
pub use posts::{PostGrid, Posts};

#[cfg(test)]
mod tests;
