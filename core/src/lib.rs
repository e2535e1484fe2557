//! The arithmetic of ELunarDTM, for a laptop and for a spacecraft: no `std`, no heap, no files, no threads.
//!
//! One tile, from image to metres, in the order it meets the modules:
//!
//! 1. [`grid`] lends a rectangle of somebody's pixels with its row stride; nothing here owns an image.
//! 2. [`mask`] says which of those pixels are real: PDS3 specials, nodata and NaN are not.
//! 3. [`tile`] cuts a scene into windows of 256 rows by 320 columns, overlapping at inference.
//! 4. [`norm`] brings the image to [0, 1] and the coarse DTM to [0, NR] (Eq. 1–2). The [`norm::ElevationScale`] it makes
//!    is the only thing that can bring heights back. A network that is given the light sees slopes and pixels instead, with the
//!    relief that [`photoclinometry`] finds.
//! 5. The network predicts normalised heights: in floating point on the ground, in integers in flight ([`nn`], with the
//!    rounding rule of [`quant`]).
//! 6. [`norm::ElevationScale::recover`] returns metres above the 1737.4 km sphere (Eq. 8).
//!
//! A camera that delivers lines instead of tiles has [`strip`], which does all of this line by line: [`resample`] brings the coarse DTM onto
//! the image's grid, [`fill`] closes gaps, [`overlap`] weighs tiles where they are blended.
//!
//! Beside that path stand the judges: [`loss`] (Eq. 5–7, with analytic gradients, the reference that training is checked
//! against), [`metrics`] (Eq. 11–18) and [`terrain`] (slope, hillshade, normals;
//! and, line by line, the hazards of a lander's footprint).
//!
//! ```
//! use elunar_core::norm::{ElevationScale, intensity, NR};
//!
//! let image = [90.0, 110.0, 130.0, 100.0];
//! let coarse_m = [-1910.0, -1900.0, -1890.0, -1905.0];
//!
//! let mut brightness = [0.0; 4];
//! intensity::normalise(&image, None, &mut brightness)?;
//! let scale = ElevationScale::from_heights(&coarse_m, None, NR)?;
//! let mut normalised = [0.0; 4];
//! scale.normalise(&coarse_m, &mut normalised)?;
//! assert_eq!(normalised, [0.0, 25.0, 50.0, 12.5]);
//!
//! // ... the network runs here; an idle one hands back what it was given ...
//! let mut heights_m = [0.0; 4];
//! scale.recover(&normalised, &mut heights_m)?;
//! assert_eq!(heights_m, coarse_m);
//! # Ok::<(), elunar_core::norm::NormError>(())
//! ```
//!
//! # Promises
//! Memory is what the caller lends. Sums run in `f64`. No function panics on any value of its arguments; what cannot be
//! computed is an error of [`error`], a small `Copy` enum per operation.
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
