//! The quantised inference runner: a validated [`Model`] and a [`Runner`] that executes it.
//!
//! A model file is a *program*: tensors at planned places in one arena, constants, and a list of operators. Whoever makes the
//! file decides what network it is; this module knows operators only. Life of a tile:
//!
//! 1. [`Model::new`] judges the file once: checksums, bounds, shapes, accumulator limits, liveness of every tensor.
//! 2. [`required`] says how many bytes to lend; [`Runner::new`] takes them.
//! 3. [`Runner::begin`] quantises image and coarse DTM; [`Runner::step`] works for a bounded number of multiply-accumulates;
//!    [`Runner::output`] gives normalised elevation as f32, straight from the last layer's accumulators.
//!    [`Runner::begin_metres`] and [`Runner::heights`] do the same in physical units.
//! 4. Memory is not trusted ([`Runner::protect`]): records of the program are sealed and looked at before they are used, every row of a map
//!    carries a checksum that is compared whenever the row is read, and the whole model is compared after the last step.
//! 5. In spare time [`Runner::scrub`] re-reads the model against its checksums, and a self test runs a built-in tile.
//! 6. In flight a new model is loaded beside the old one and tried before it is confirmed ([`slots`]).
//!
//! Between quantise and dequantise all arithmetic is on integers, rounded by [`crate::quant::round_shift`] alone: same file,
//! same tile, same bytes on every machine.

mod arena;
mod crc;
mod error;
pub mod format;
mod input;
pub mod kernels;
mod lighting;
mod maps;
mod metres;
mod model;
mod ops;
mod prepared;
mod program;
mod runner;
mod schedule;
mod self_test;
pub mod slots;
mod sum;
mod suspend;
mod tensor;

pub use crc::{Crc32c, crc32c};
pub use error::{ModelError, OperatorFault, RunError};
pub use input::{Illumination, TruthRange};
pub use lighting::{KnownSun, LightSource, Lighting, TileLight};
pub use maps::{GuidedMaps, InputRules, RangedMaps, TileError, TileInput, TileMaps, TileScale};
pub use metres::{Begun, validity};
pub use model::{MAX_BLOCK, MAX_EXTENT, MAX_KERNEL, MAX_NORM_CHANNELS, MAX_RECORDS, MAX_SAMPLES, MAX_WINDOW, Model};
pub use prepared::Prepared;
pub use program::{
    Attention, Conv, Dtype, ENTRY_BYTES, Edge, Enlarge, Entry, LayerNorm, MAX_ADD_SHIFT, MAX_MARGIN, OPERATOR_BYTES,
    Operator, PHASE_TAPS, PHASES, Phase, TENSOR_BYTES, Tensor, groups,
};
pub use runner::{Progress, Runner, Telemetry, required};
pub use suspend::{Suspended, Verdict};

/// Fraction bits of a normalised value before a layer norm's gain.
pub const NORM_FRACTION_BITS: u32 = crate::quant::rsqrt::FRACTION_BITS;
/// Fraction bits of the attention-weighted mean of v.
pub const MEAN_FRACTION_BITS: u32 = ops::window_attention::FRACTION_BITS;

#[cfg(test)]
pub(crate) mod tests;
