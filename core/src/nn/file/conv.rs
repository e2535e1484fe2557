//! The record of a convolution, and the sets of filters of one that contains an upsampling.

use super::count::at_least_one;

/// Convolution over the sources' channels side by side, then requantised.
///
/// `code = clamp(zero + (acc*M[o] + (r*A[o] << add_shift) + half) >> shift)` with `acc = bias[o] + Σ code*w`, `r` the added tensor's
/// value; or through a table; or, if the output is F32, `acc * m[o] + r * scale` in floats. The bias contains `-Σ zero*w`, and for a
/// 16-bit source `-32768 Σ w`, so that kernels multiply codes as they are.
///
/// Weights are i8, not -128, `[panel][variant][source][kernel row][group][channel of the panel][4]`: a group is four
/// consecutive samples of a kernel row (`kernel columns * channels`, filled up with zeros), a panel some output channels
/// (see [`super::panels`]), filled up with zeros.
///
/// With `fold` the operator is "upsample twofold by bilinear interpolation, then convolve 5x5 with zero padding", computed on the
/// small map: a row of the small map gives two rows of the output, and every output phase has a filter of its own ([`Phase`]). A pixel
/// whose row or column has a correction adds up to four variants, weights and biases: (filter, filter), (correction, filter),
/// (filter, correction), (correction, correction).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conv {
    /// Output tensor.
    pub out: u32,
    /// First source.
    pub first: u32,
    /// Second source; its channels follow the first's.
    pub second: Option<u32>,
    /// Kernel rows (5 with `fold`).
    pub kernel_rows: usize,
    /// Kernel columns (5 with `fold`).
    pub kernel_cols: usize,
    /// Input rows from one output row to the next (1 with `fold`).
    pub stride: usize,
    /// Input columns from one output pixel to the next (1 with `fold`). With several columns of a one-channel map as channels of one
    /// pixel, it is their number.
    pub stride_cols: usize,
    /// Zero padding on all four sides (2 with `fold`).
    pub pad: usize,
    /// Output rows per step (with `fold`, rows of the small map): with several, weights that no cache holds are fetched once for all
    /// of them.
    pub block: usize,
    /// Twofold upsampling contained in the weights.
    pub fold: bool,
    /// Constants: i8 weights.
    pub weights: usize,
    /// Constants: i32 `[variant][out]`.
    pub bias: usize,
    /// Constants: i32 multipliers `[out]`, or f32 scales `[out]` if the output is F32.
    pub multipliers: usize,
    /// Right shift after the multiplication.
    pub shift: u32,
    /// Tensor added before rounding.
    pub add: Option<u32>,
    /// Constants: i32 multipliers `[out]` of the added tensor (not used with an F32 output).
    pub add_multipliers: usize,
    /// Left shift of the added tensor's product, at most [`super::MAX_ADD_SHIFT`].
    pub add_shift: u32,
    /// Constants: 256 output codes by clamped intermediate code.
    pub table: Option<usize>,
    /// With a table: the intermediate code that stands for 0.
    pub table_zero: i32,
    /// With an F32 output: negative results become 0 (the paper's last ReLU).
    pub relu: bool,
}

impl Conv {
    /// The sources in order.
    pub fn sources(&self) -> impl Iterator<Item = u32> {
        core::iter::once(self.first).chain(self.second)
    }

    /// Output rows of a step; the last step may make fewer.
    #[inline]
    pub const fn step_rows(&self) -> usize {
        let block = at_least_one(self.block);
        if self.fold { 2 * block } else { block }
    }

    /// Sets of filters: one, or one per pair of phases and corrections.
    pub const fn variants(&self) -> usize {
        if self.fold { PHASES * PHASES } else { 1 }
    }

    /// Which of [`VARIANT_KINDS`] a set of filters is.
    pub(crate) const fn variant_kind(&self, variant: usize) -> usize {
        2 * (variant / PHASES > 1) as usize + (variant % PHASES > 1) as usize
    }

    /// Kernel rows and columns of a set of filters.
    #[inline]
    pub const fn extent(&self, variant: usize) -> (usize, usize) {
        if self.fold {
            (PHASE_TAPS[variant / PHASES % PHASES], PHASE_TAPS[variant % PHASES])
        } else {
            (self.kernel_rows, self.kernel_cols)
        }
    }
}

/// What one output row (or column) of a folded convolution reads of the small map.
///
/// The upsampled map's sample 2i is 3/4 of sample i and 1/4 of its predecessor, sample 2i+1 is 3/4 of i and 1/4 of its successor.
/// Five of them are four samples of the small map, its border repeated. So even outputs have one filter and odd ones another. At
/// the border they see the border sample where the 5x5 convolution has its zero padding: the two outermost outputs on each side
/// take that off again by a correction of one tap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Phase {
    /// Number of the filter: 0 for even, 1 for odd outputs.
    pub filter: usize,
    /// First of its [`PHASE_TAPS`] samples of the small map; outside it the border repeats.
    pub first: isize,
    /// For the two outermost outputs on each side: number of the correction, 2..[`PHASES`], and the border sample.
    pub correction: Option<(usize, usize)>,
}

/// Filters and corrections along one axis of a folded convolution.
pub const PHASES: usize = 6;
/// Filters, corrections of columns, of rows, and of both: no pixel needs more than one set of each kind.
pub(crate) const VARIANT_KINDS: usize = 4;
/// Samples of the small map that each of them reads.
pub const PHASE_TAPS: [usize; PHASES] = [4, 4, 1, 1, 1, 1];

impl Phase {
    /// Of output `index` on a small map of `len` samples, at least 4.
    #[inline]
    pub const fn of(index: usize, len: usize) -> Self {
        let filter = index % 2;
        let correction = match index {
            0 | 1 => Some((2 + filter, 0)),
            _ if index + 2 >= 2 * len => Some((4 + filter, len - 1)),
            _ => None,
        };
        Self { filter, first: (index / 2 + filter) as isize - 2, correction }
    }
}
