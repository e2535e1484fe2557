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
//! The compiler turns it into vector instructions: on x86 once per instruction set (`nn/dispatch`), elsewhere for the target. A kernel may
//! replace any part ([`Isa`]), as AVX-512 does; the bytes are the same.

#[cfg(arm_dsp)]
pub(super) mod dsp;
#[cfg(arm_mve)]
pub(super) mod helium;
pub(super) mod layer_norm;
#[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
pub(super) mod neon;
#[cfg(all(target_arch = "aarch64", target_feature = "dotprod", target_endian = "little"))]
pub(super) mod neon_dot;
pub(super) mod requantise;
pub(super) mod scalar;
#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
pub(super) mod simd128;
pub(super) mod softmax;
#[cfg(target_arch = "x86_64")]
pub(super) mod x86_avx2;
#[cfg(target_arch = "x86_64")]
pub(super) mod x86_avx512;

use super::panels::PANEL;
use crate::part::{head_mut, part_mut};
use requantise::{Requantise, Target};
use softmax::Softmax;

/// Number of accumulators of one call: pixels times panel width.
pub(crate) const ACCUMULATORS: usize = 320;
/// Accumulators `[pixel][channel of the panel]`.
pub(crate) type Accumulators = [i32; ACCUMULATORS];

/// Number of pixels computed together against a panel of this width.
pub(crate) const fn pixels_at_once(width: usize) -> usize {
    if width == PANEL { 10 } else { 20 }
}

const _: () = assert!(pixels_at_once(8) * 16 <= ACCUMULATORS && pixels_at_once(PANEL) * PANEL <= ACCUMULATORS);

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
        let mut inside = pixels * width <= ACCUMULATORS && last <= self.bytes.len();
        for &start in self.starts {
            inside &= start <= self.bytes.len() && last <= self.bytes.len() - start;
        }
        inside && weights.len() >= 4 * self.starts.len() * self.groups * width
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

/// An instruction set: what differs between kernels.
pub(crate) trait Isa {
    /// The kernel's name by the rule `{isa}-{types}-{variant}`.
    const NAME: &'static str;

    /// Adds the products of `pixels` patches with one panel of `width` channels (8, 16 or 32). Without [`Patch::fits`] the result is
    /// unspecified, but no access leaves the slices.
    fn gemm(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize);

    /// As [`Self::gemm`], but sets the sums to the products instead of adding.
    #[inline(always)]
    fn gemm_from_zero(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        head_mut(acc, pixels * width).fill(0);
        Self::gemm(acc, pixels, patch, weights, width);
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
