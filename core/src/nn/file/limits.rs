//! Limits of sizes in a file, and fraction bits.

/// Largest number of tensors or operators; limits the time and the stack of validation.
pub const MAX_RECORDS: usize = 512;
/// Largest extent of a tensor along one axis.
pub const MAX_EXTENT: usize = 1 << 14;
/// Largest tensor, samples.
pub const MAX_SAMPLES: u64 = 1 << 28;
/// Widest margin of a tensor, columns.
pub const MAX_MARGIN: usize = 15;
/// Largest number of channels of a layer norm: keeps C·Σx² within `2^56`.
pub const MAX_NORM_CHANNELS: usize = 1 << 13;
/// Largest kernel side.
pub const MAX_KERNEL: usize = 15;
/// Largest number of output rows in one step of a convolution, because a unit of work must stay small.
pub const MAX_BLOCK: usize = 16;
/// Largest window side; the logits of its tokens are on the stack.
pub const MAX_WINDOW: usize = 8;
/// Largest left shift of an added tensor: i16 times `2^30` times `2^15` stays below `2^60`.
pub const MAX_ADD_SHIFT: u32 = 15;
/// Largest result of an f32 output, in units of NR: with [`crate::norm::RELIEF_MAX_M`], all heights are finite.
pub const MAX_OUTPUT: f64 = (1u64 << 32) as f64;
/// Most work of a validation per byte of the file: see [`super::super::Model::new_counted`].
pub const MAX_WORK: u64 = 64;

/// Fraction bits of a normalised value before a layer norm's gain.
pub const NORM_FRACTION_BITS: u32 = crate::quant::rsqrt::FRACTION_BITS;
/// Fraction bits of the attention-weighted mean of v.
pub const MEAN_FRACTION_BITS: u32 = 16;
