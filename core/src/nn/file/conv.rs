//! The record of a convolution, and the sets of filters of a convolution with a contained upsampling.

use super::count::at_least_one;

/// Convolution over the channels of its sources side by side, then requantisation.
///
/// `code = clamp(zero + (acc*M[o] + (r*A[o] << add_shift) + half) >> shift)` with `acc = bias[o] + Σ code*w`, where `r` is the value of the
/// added tensor. The result may then pass through a table. If the output is F32, the result is `acc * m[o] + r * scale` in floats. The bias
/// contains `-Σ zero*w`, and for a 16-bit source `-32768 Σ w`, so that kernels multiply the stored codes.
///
/// Weights are i8, not -128, `[panel][variant][source][kernel row][group][channel of the panel][4]`. A group is four consecutive samples of
/// a kernel row (`kernel columns * channels`, filled up with zeros). A panel is several output channels (see [`super::panels`]), filled up
/// with zeros.
///
/// With `fold` the operator is "upsample twofold by bilinear interpolation, then convolve 5x5 with zero padding", computed on the small
/// map. A row of the small map gives two rows of the output, and every output phase has a filter of its own ([`Phase`]). A pixel whose row
/// or column has a correction adds up to four variants, weights and biases: (filter, filter), (correction, filter), (filter, correction),
/// (correction, correction).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conv {
    /// Output tensor.
    pub out: u32,
    /// First source.
    pub first: u32,
    /// Second source; its channels follow those of the first.
    pub second: Option<u32>,
    /// Kernel rows (5 with `fold`).
    pub kernel_rows: usize,
    /// Kernel columns (5 with `fold`).
    pub kernel_cols: usize,
    /// Input rows from one output row to the next (1 with `fold`).
    pub stride: usize,
    /// Input columns from one output pixel to the next (1 with `fold`). If the channels of a pixel are several columns of a one-channel
    /// map, their number.
    pub stride_cols: usize,
    /// Zero padding on all four sides (2 with `fold`).
    pub pad: usize,
    /// Output rows per step (with `fold`, rows of the small map). With several rows, weights that fit no cache are read once for all of
    /// them.
    pub block: usize,
    /// Whether the weights contain a twofold upsampling.
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
    /// Constants: 256 output codes, indexed by the clamped intermediate code.
    pub table: Option<usize>,
    /// With a table: the intermediate code that stands for 0.
    pub table_zero: i32,
    /// With an F32 output: negative results become 0 (the paper's last ReLU).
    pub relu: bool,
}

impl Default for Conv {
    /// One sample times one weight, rounded by a shift of 1; constants at offset 0.
    fn default() -> Self {
        Self {
            out: 0,
            first: 0,
            second: None,
            kernel_rows: 1,
            kernel_cols: 1,
            stride: 1,
            stride_cols: 1,
            pad: 0,
            block: 1,
            fold: false,
            weights: 0,
            bias: 0,
            multipliers: 0,
            shift: 1,
            add: None,
            add_multipliers: 0,
            add_shift: 0,
            table: None,
            table_zero: 0,
            relu: false,
        }
    }
}

impl Conv {
    /// Returns the sources in order.
    pub fn sources(&self) -> impl Iterator<Item = u32> {
        core::iter::once(self.first).chain(self.second)
    }

    /// Number of output rows of a step; the last step may have fewer.
    #[inline]
    pub const fn step_rows(&self) -> usize {
        let block = at_least_one(self.block);
        if self.fold { 2 * block } else { block }
    }

    /// Number of sets of filters: one, or one per pair of phases and corrections.
    pub const fn variants(&self) -> usize {
        if self.fold { PHASES * PHASES } else { 1 }
    }

    /// Returns which of [`VARIANT_KINDS`] a set of filters is.
    pub(crate) const fn variant_kind(&self, variant: usize) -> usize {
        2 * (variant / PHASES > 1) as usize + (variant % PHASES > 1) as usize
    }

    /// Returns the kernel rows and columns of a set of filters.
    #[inline]
    pub const fn extent(&self, variant: usize) -> (usize, usize) {
        if self.fold {
            (PHASE_TAPS[variant / PHASES % PHASES], PHASE_TAPS[variant % PHASES])
        } else {
            (self.kernel_rows, self.kernel_cols)
        }
    }
}

/// The samples of the small map that one output row (or column) of a folded convolution reads.
///
/// Sample 2i of the upsampled map is 3/4 of sample i and 1/4 of its predecessor, sample 2i+1 is 3/4 of i and 1/4 of its successor. Five of
/// them depend on four samples of the small map, whose border is repeated. So even outputs have one filter and odd ones another. At the
/// border these filters read the border sample where the 5x5 convolution has zero padding. Therefore the two outermost outputs on each side
/// subtract it again by a correction of one tap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Phase {
    /// Number of the filter: 0 for even outputs, 1 for odd ones.
    pub filter: usize,
    /// First of the [`PHASE_TAPS`] samples of the small map; outside the map the border repeats.
    pub first: isize,
    /// For the two outermost outputs on each side: number of the correction, 2..[`PHASES`], and index of the border sample.
    pub correction: Option<(usize, usize)>,
}

/// Number of filters and corrections along one axis of a folded convolution.
pub const PHASES: usize = 6;
/// Kinds of variants: filters, corrections of columns, of rows, and of both. No pixel needs more than one set of each kind.
pub(crate) const VARIANT_KINDS: usize = 4;
/// Number of samples of the small map that each filter or correction reads.
pub const PHASE_TAPS: [usize; PHASES] = [4, 4, 1, 1, 1, 1];

impl Phase {
    /// Returns the phase of output `index` on a small map of `len` samples, at least 4.
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

    /// Number of outputs among `range` that have a correction, on a small map of `len` samples.
    pub(crate) fn corrected(range: &core::ops::Range<usize>, len: usize) -> usize {
        let within = |from: usize, to: usize| range.end.min(to).saturating_sub(range.start.max(from));
        within(0, 2) + within((2 * len).saturating_sub(2).max(2), 2 * len)
    }
}
