//! The quantised inference runner: a validated [`Model`] and a [`Runner`] that executes it.
//!
//! A model file is a *program*: tensors at planned places in one arena, constants, and a list of operators. The maker of the file
//! ([`mod@file`]) decides on the network; this module only runs operators. The steps for a tile:
//!
//! 1. [`Model::new`] validates the file once: checksums, bounds, shapes, accumulator limits, liveness of every tensor.
//! 2. [`required`] returns the number of bytes to lend; [`Runner::new`] takes them.
//! 3. [`Runner::begin`] quantises image and coarse DTM. [`Runner::step`] works for a bounded number of multiply-accumulates.
//!    [`Runner::output`] returns normalised elevation as f32, directly from the last layer's accumulators. A [`crate::job::TileJob`] does the
//!    same in physical units.
//! 4. Faults in memory are detected ([`Runner::protect`]): seals of the program's records are compared before use, every row of a map has a
//!    checksum that is compared at every read, and the whole model is compared after the last step.
//! 5. In spare time [`Runner::scrub`] compares the model with its checksums, and a self test runs a built-in tile.
//! 6. In flight a new model is loaded beside the old one and tried before it is confirmed ([`slots`]).
//!
//! Between the quantisation of inputs and the output all arithmetic is on integers, rounded by [`crate::quant::round_shift`] alone: the
//! same file and the same tile give the same bytes on every machine.
//!
//! The modules, each above those that it uses:
//!
//! ```text
//! slots   suspend
//!         runner                      steps, protection, telemetry
//! model (view)      dispatch          a file that was validated; operators compiled for a processor
//! model/validate      |
//!            ops                      what an operator reads, writes and costs; its unit of work
//! file      kernels                   records and their bytes; arithmetic on bytes, without operators and models
//! tensor  panels  arena  sum  crc
//! ```

mod arena;
mod code;
mod crc;
mod dispatch;
mod error;
pub mod file;
mod input;
mod kernels;
mod lighting;
mod model;
mod ops;
mod panels;
mod runner;
mod scrub;
mod self_test;
pub mod slots;
mod sum;
mod suspend;
mod tensor;
mod tools;

pub use code::code_sum;
pub use dispatch::{ArmExtensions, Kernel, TilesAllowed};
pub use error::RunError;
pub use file::error::ModelError;
pub use input::{Illumination, InputRules, TruthRange};
pub use lighting::{KnownSun, LightSource, Lighting, TileLight};
pub(crate) use model::QUANTISED;
pub use model::{Model, Validation, Verdict};
pub use runner::{Progress, Runner, Telemetry, required};
pub(crate) use sum::{sum as sum_bytes, sum_floats};
pub use suspend::Suspended;
#[doc(hidden)]
pub use tools::MatrixProduct;

#[cfg(test)]
pub(crate) mod tests;
