//! Push-broom mode: lines of a strip in, blended lines of heights out.
//!
//! A push-broom camera delivers lines, and their number is not known in advance. [`Strip`] takes them one by one with the coarse DTM on the
//! same pixels, or with the rows of its posts (in memory for a few rows; [`Posts`] makes lines of them). It runs every tile of the model as soon as its lines are there, and
//! returns lines of heights as soon as no further tile can reach them. Memory is planned before the first line ([`StripPlan`]). The heights
//! are those of the ground's mosaic of the same tiles: the same bits under one or two tiles, else at most the next float.
//!
//! ```
//! use elunar_core::nn::{KnownSun, LightSource, Lighting, Model, Runner};
//! use elunar_core::norm::LightFit;
//! use elunar_core::pixels::{PixelForm, PixelFormat};
//! use elunar_core::strip::{Next, PostGrid, Strip, StripMemory, StripPlan, StripSettings};
//!
//! # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../host-train/models/nano.eld");
//! # let model_file = std::fs::read(path)?;
//! let model = Model::new(&model_file)?;
//! // Nothing has been seen of the ground yet, so the Sun should be known.
//! let sun = KnownSun { azimuth_deg: Some(315.0), elevation_deg: Some(35.0) };
//! let light = Lighting::decide(model.illumination(), sun, &LightFit::default());
//! assert_eq!(light.source, LightSource::Given);
//! // Posts 30 pixels apart, from a row and a column before the strip on; a camera of 16 bits.
//! let grid = PostGrid::spaced(14, (-30.0, -30.0), (30.0, 30.0));
//! let settings = StripSettings {
//!     cols: 320,
//!     ring_lines: StripPlan::least_lines(&model),
//!     overlap_px: 100,
//!     pixel_m: 2.0,
//!     coarse_px: 30.0,
//!     anchor: true,
//!     checked: false,
//!     light,
//!     pixels: PixelForm { format: PixelFormat::U16Le, ..PixelForm::F32 },
//!     posts: Some(grid),
//!     expected_errors: false,
//! };
//! let plan = StripPlan::new(&model, settings)?;
//!
//! // In flight these are arrays of the flight software.
//! let (mut arena, mut bytes) = (vec![0; plan.arena_bytes()], vec![0; plan.bytes_len()]);
//! let (mut samples, mut sums) = (vec![0.0; plan.samples_len()], vec![0.0; plan.sums_len()]);
//! let memory = StripMemory { bytes: &mut bytes, samples: &mut samples, sums: &mut sums };
//! let mut strip = Strip::new(plan, Runner::new(model, &mut arena)?, memory)?;
//!
//! let (mut heights_m, mut line, mut row, mut done) = ([0.0; 320], 0, 0, 0);
//! loop {
//!     match strip.wants() {
//!         // Between two lines there is time for a step, or for many.
//!         Next::Step => {
//!             strip.step(50_000_000);
//!         }
//!         Next::Posts => {
//!             let row_m: Vec<f32> = (0..grid.cols).map(|col| -1900.0 + (col * row) as f32).collect();
//!             strip.push_posts(&row_m)?;
//!             row += 1;
//!         }
//!         Next::Push if line < 300 => {
//!             let code = |col: u16| 100 + (line as u16 * 7 + col * 13) % 31;
//!             let image: Vec<u8> = (0..320).flat_map(|col| code(col).to_le_bytes()).collect();
//!             strip.push_pixels(&image, &[])?;
//!             line += 1;
//!         }
//!         Next::Push => strip.finish(),
//!         Next::Take | Next::Done if strip.ready() > 0 => {
//!             strip.take_line(&mut heights_m)?;
//!             done += 1;
//!         }
//!         Next::Take | Next::Done => break,
//!     }
//! }
//! assert_eq!((done, row, strip.counters().tiles), (300, 14, 2));
//! assert!(heights_m.iter().all(|z| z.is_finite()));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What a line costs
//! Taking and returning a line cost a fixed time each: a copy and checksums. All other work is in [`Strip::step`], whose pieces are as large as
//! its budget. `core/docs/strip.md` gives memory and time, and the response to faults.

mod at;
mod blend;
mod cut;
mod error;
mod expected;
mod lines;
mod mean;
mod pipeline;
mod plan;
mod posts;
mod ring;

pub use at::{StripCounters, StripPaused};
pub use error::StripError;
pub use expected::LineErrors;
pub use pipeline::{Next, Strip, StripMemory};
pub use plan::{StripPlan, StripSettings};
pub use posts::{PostGrid, Posts};

#[cfg(test)]
mod tests;
