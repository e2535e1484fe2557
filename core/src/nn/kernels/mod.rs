//! The arithmetic of the operators, in the instructions of a processor: matrix products of codes, and the steps from sums to codes. Kernels
//! do not depend on operators or models: their arguments are bytes, the layout of a tensor, and numbers.
//!
//! Activations are u8 codes as they are in the arena, weights are i8 and never -128, sums are i32 that wrap. The model's validation proves
//! that no finished sum can overflow i32. So kernels may add in any order and let intermediate sums wrap: the result has the same bits. A
//! kernel must not saturate on the way (as `vpmaddubsw` does).
//!
//! One function computes all products; [`scalar`] is its specification:
//!
//! ```text
//! acc[p][c] += Σ over rows r, groups g, b in 0..4:  x[starts[r] + p*stride + 4g + b]  *  w[r][g][c][b]
//! ```
//!
//! `p` counts pixels, `c` the channels of a panel: 32, 16 or 8 output channels whose weights are side by side, four bytes each, because
//! dot-product instructions take four products at a time. There is no unfolded copy of the input ("im2col"): a row of a convolution's patch
//! is contiguous in the arena, and `starts` gives the first byte of each row.
//!
//! For the other parts ([`requantise`]: rounding; [`layer_norm`]; [`softmax`]) the `portable` body beside each job is the specification.
//! The compiler turns it into vector instructions: on x86 and AArch64 once per instruction set (`nn/dispatch`), elsewhere for the target. A
//! kernel may replace any part ([`Isa`]), as AVX-512 does; the bytes are the same.

#[cfg(arm_dsp)]
pub(super) mod dsp;
#[cfg(arm_mve)]
pub(super) mod helium;
pub(super) mod layer_norm;
#[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
pub(super) mod neon;
#[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
pub(super) mod neon_dot;
#[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
pub(super) mod neon_i8mm;
pub(super) mod requantise;
pub(super) mod scalar;
#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
pub(super) mod simd128;
pub(super) mod softmax;
#[cfg(target_arch = "x86_64")]
pub(super) mod x86_amx;
#[cfg(target_arch = "x86_64")]
pub(super) mod x86_avx2;
#[cfg(target_arch = "x86_64")]
pub(super) mod x86_avx512;
#[cfg(target_arch = "x86_64")]
pub(super) mod x86_avx_vnni;

use super::file::MAX_KERNEL;
use super::panels::PANEL;
use crate::part::{head, head_mut, part_mut};
use requantise::{Requantise, Target};
use softmax::Softmax;

/// Number of sums that fit into registers, and that portable code rounds together: pixels times panel width.
pub(crate) const BLOCK: usize = 320;
/// Number of accumulators of one call. The tiles of AMX hold 1024 sums.
pub(crate) const ACCUMULATORS: usize = if cfg!(target_arch = "x86_64") { 1024 } else { BLOCK };
/// Accumulators `[pixel][channel of the panel]`.
pub(crate) type Accumulators = [i32; ACCUMULATORS];

/// Number of pixels whose sums against a panel of this width fit into registers.
pub(crate) const fn pixels_at_once(width: usize) -> usize {
    if width == PANEL { 10 } else { 20 }
}

/// Returns the first of as few nearly equal numbers as there are with `left` as their sum and none above `most`: small numbers of pixels leave
/// registers unused.
#[inline(always)]
pub(crate) fn evenly(left: usize, most: usize) -> usize {
    left.div_ceil(left.div_ceil(most).max(1))
}

const _: () = assert!(pixels_at_once(8) * 16 <= BLOCK && pixels_at_once(PANEL) * PANEL <= BLOCK);

/// The codes that one call reads.
#[derive(Clone, Copy)]
pub(crate) struct Patch<'a> {
    /// The bytes that contain the codes.
    pub(crate) bytes: &'a [u8],
    /// First byte of each row of the first pixel's patch.
    pub(crate) starts: &'a [usize],
    /// Bytes from one pixel to the next.
    pub(crate) stride: usize,
    /// Four-byte groups in a row.
    pub(crate) groups: usize,
}

impl Patch<'_> {
    /// Returns whether all reads for `pixels` pixels stay inside `bytes`, and `weights` is long enough. The model's validation guarantees
    /// it; unsafe kernels check it again.
    #[inline(always)]
    pub(crate) fn fits(&self, pixels: usize, weights: &[u8], width: usize) -> bool {
        let last = pixels.saturating_sub(1) * self.stride + 4 * self.groups;
        let most = self.bytes.len().checked_sub(last);
        pixels * width <= ACCUMULATORS
            && most.is_some_and(|most| self.starts.iter().all(|&start| start <= most))
            && weights.len() >= 4 * self.starts.len() * self.groups * width
    }
}

/// Rows of a patch whose products are added: of one source and one set of filters.
#[derive(Clone, Copy)]
pub(crate) struct Product<'m> {
    /// First byte of each row of the first pixel's patch; the first `rows` count.
    pub(crate) starts: [usize; MAX_KERNEL],
    pub(crate) rows: usize,
    /// As in [`Patch`].
    pub(crate) stride: usize,
    pub(crate) groups: usize,
    /// Weights of these rows.
    pub(crate) weights: &'m [u8],
}

impl Product<'_> {
    /// No rows.
    pub(crate) const NOTHING: Self = Self { starts: [0; MAX_KERNEL], rows: 0, stride: 0, groups: 0, weights: &[] };

    /// Returns the codes that it reads.
    #[inline(always)]
    pub(crate) fn patch<'a>(&'a self, bytes: &'a [u8]) -> Patch<'a> {
        Patch { bytes, starts: head(&self.starts, self.rows), stride: self.stride, groups: self.groups }
    }
}

/// Calls `block` for every block of a product: `channels` channels of the panel after another, and for each all pixels. `block` gets the
/// first channel, the first pixel and the number of pixels left, and returns how many it has computed.
#[inline(always)]
#[allow(dead_code, reason = "the kernels of ARM and WebAssembly use it")]
pub(crate) fn blocks(
    width: usize,
    channels: usize,
    pixels: usize,
    mut block: impl FnMut(usize, usize, usize) -> usize,
) {
    for channel in (0..width).step_by(channels) {
        let mut first = 0;
        while first < pixels {
            first += block(channel, first, pixels - first);
        }
    }
}

/// Adds the sums of pixel `pixel` from channel `channel` on.
#[inline(always)]
#[allow(dead_code, reason = "the kernels of ARM use it")]
pub(crate) fn add<const C: usize>(acc: &mut Accumulators, width: usize, pixel: usize, channel: usize, sums: &[i32; C]) {
    for (at, sum) in part_mut(acc, pixel * width + channel, C).iter_mut().zip(sums) {
        *at = at.wrapping_add(*sum);
    }
}

/// An instruction set: what differs between kernels. A value is the state of the processor within a unit of work.
pub(crate) trait Isa: Default {
    /// The kernel's name by the rule `{isa}-{types}-{variant}`.
    const NAME: &'static str;

    /// Whether products of several sources and filters are computed faster by one call ([`Self::products`]).
    const TOGETHER: bool = false;

    /// Returns how many of `left` pixels are computed together.
    #[inline(always)]
    fn block(left: usize, width: usize) -> usize {
        evenly(left, pixels_at_once(width))
    }

    /// Adds the products of `pixels` patches with one panel of `width` channels (8, 16 or 32). Without [`Patch::fits`] the result is
    /// unspecified, but no access leaves the slices.
    fn gemm(&mut self, acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize);

    /// As [`Self::gemm`], but sets the sums to the products instead of adding.
    #[inline(always)]
    fn gemm_from_zero(
        &mut self,
        acc: &mut Accumulators,
        pixels: usize,
        patch: &Patch<'_>,
        weights: &[u8],
        width: usize,
    ) {
        head_mut(acc, pixels * width).fill(0);
        self.gemm(acc, pixels, patch, weights, width);
    }

    /// As [`Self::gemm`], for several lists of rows of `bytes`; the first products replace the sums if `from_zero`.
    #[inline(always)]
    fn products(
        &mut self,
        acc: &mut Accumulators,
        pixels: usize,
        bytes: &[u8],
        products: &[Product<'_>],
        width: usize,
        mut from_zero: bool,
    ) {
        for product in products {
            let (patch, weights) = (product.patch(bytes), product.weights);
            if from_zero {
                self.gemm_from_zero(acc, pixels, &patch, weights, width);
            } else {
                self.gemm(acc, pixels, &patch, weights, width);
            }
            from_zero = false;
        }
    }

    /// Turns accumulators into codes and stores them in the arena; returns how many were cut. Specified by [`Requantise::portable`].
    #[inline(always)]
    fn requantise(requantise: &Requantise<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
        requantise.portable(bytes, acc, target)
    }

    /// Writes the exponentials of one query as two planes, 0 behind the last key; returns their sum. Specified by [`Softmax::portable`].
    #[inline(always)]
    fn softmax(softmax: &Softmax<'_>, low: &mut [u8], high: &mut [u8]) -> i64 {
        softmax.portable(low, high)
    }

    /// Normalises up to [`layer_norm::PIXELS`] pixels from column `col` on; returns how many codes were cut. Specified by
    /// [`layer_norm::Job::portable`].
    #[inline(always)]
    fn layer_norm(job: &layer_norm::Job<'_>, bytes: &mut [u8], col: usize, pixels: usize) -> u64 {
        job.portable(bytes, col, pixels)
    }
}
