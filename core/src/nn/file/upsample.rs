//! The record of a bilinear upsampling.

/// Twofold bilinear upsampling with half-pixel centres and repeated border: `code = (9a + 3b + 3c + d + 8) >> 4`. Input and output have the
/// same codes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Upsample2 {
    /// Output tensor with twice the rows and columns.
    pub out: u32,
    /// Input tensor.
    pub input: u32,
}
