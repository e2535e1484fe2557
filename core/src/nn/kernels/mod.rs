//! Dot products: the only place where the arithmetic is dense.
//!
//! Activations arrive as little-endian i16 (zero point already removed), weights as i8; sums are i32. The model's validation
//! proves that no sum can leave i32, so kernels may add in any order: the result is the same bits. A kernel that saturates
//! on the way (as `vpmaddubsw` does) would be a bug, not an option.

pub mod scalar;

/// One activation in a scratch row: i16, little-endian, no alignment needed.
pub type Le16 = [u8; 2];

/// Vectors are padded with zeros to a multiple of this.
pub const LANES: usize = 8;

/// Output channels that one unit of a convolution computes.
pub const CHANNEL_GROUP: usize = 8;

/// `len` rounded up to a multiple of [`LANES`].
pub const fn padded(len: usize) -> usize {
    len.div_ceil(LANES) * LANES
}
