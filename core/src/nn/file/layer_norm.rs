//! The record of a layer norm.

/// Layer norm over channels, per pixel.
///
/// With sum S, V = C·Σx² − S² and d = C·x − S: `y = d / √(V + C²ε)`, in integers; then
/// `code = clamp(zero + (y*G[c] + B[c] + half) >> shift)` with y in 16 fraction bits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LayerNorm {
    /// Output tensor.
    pub out: u32,
    /// Input tensor.
    pub input: u32,
    /// 1, or 2 to gather 2x2 neighbours (rows fastest: 00, 10, 01, 11) into four times the channels first.
    pub merge: usize,
    /// Constants: i32 `[channels]`.
    pub gains: usize,
    /// Constants: i64 `[channels]`.
    pub biases: usize,
    /// Right shift after gain and bias.
    pub shift: u32,
    /// C²ε in squared input code steps, at least 1.
    pub epsilon: i64,
}
