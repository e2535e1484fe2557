//! Matrix products of codes: the only place where the arithmetic is dense, and the only one that looks at the processor.
//!
//! Activations are u8 codes as they lie in the arena, weights are i8 and never -128, sums are i32 that wrap. The model's
//! validation proves that no finished sum can leave i32, so kernels may add in any order and let intermediate sums wrap: the result
//! is the same bits. A kernel that saturates on the way (as `vpmaddubsw` does) would be a bug, not an option.
//!
//! One function does all of it, in the words of [`scalar`], the specification:
//!
//! ```text
//! acc[p][c] += Σ over rows r, groups g, b in 0..4:  x[starts[r] + p*stride + 4g + b]  *  w[r][g][c][b]
//! ```
//!
//! `p` counts pixels, `c` the channels of a panel: 32, 16 or 8 output channels whose weights lie side by side, four bytes each,
//! because dot-product instructions take four products at a time. There is no unfolded copy of the input ("im2col"): a row of
//! a convolution's patch is contiguous in the arena, so the kernel walks `starts`.
//!
//! Everything else a unit of work does (rounding, layer norm, softmax) is portable Rust that the compiler turns into vector
//! instructions: on x86 it is compiled once per instruction set (`instantiate!`), elsewhere for the target. A kernel may put its own
//! in the place of any part ([`Isa`]), as AVX-512 does; the bytes are the same.

#[cfg(arm_dsp)]
mod dsp;
#[cfg(arm_mve)]
mod helium;
#[cfg(target_arch = "x86_64")]
mod instantiate;
#[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
mod neon;
#[cfg(all(target_arch = "aarch64", target_feature = "dotprod", target_endian = "little"))]
mod neon_dot;
mod scalar;
mod select;
#[cfg(target_arch = "x86_64")]
mod x86_avx2;
#[cfg(target_arch = "x86_64")]
mod x86_avx512;

use super::arena::Arena;
use super::model::Model;
use super::ops::finish::{Finish, Target};
use super::ops::layer_norm;
use super::ops::window_attention::Softmax;
use super::prepared::Prepared;
use super::sum::sum;
use crate::part::head_mut;

/// Accumulators of one call: pixels times panel width.
pub(crate) const ACCUMULATORS: usize = 320;
/// Accumulators `[pixel][channel of the panel]`.
pub(crate) type Accumulators = [i32; ACCUMULATORS];

/// Widest panel.
pub const PANEL: usize = 32;

/// How `channels` output channels are divided into panels: (first channel, width), the last panel filled up with zeros.
pub fn panels(channels: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..panel_count(channels)).map(move |index| panel(channels, index))
}

/// Number of panels.
pub const fn panel_count(channels: usize) -> usize {
    channels / PANEL
        + match channels % PANEL {
            0 => 0,
            17..=24 => 2,
            _ => 1,
        }
}

/// First channel and width of panel `index`.
#[inline]
pub const fn panel(channels: usize, index: usize) -> (usize, usize) {
    let (whole, rest) = (channels / PANEL, channels % PANEL);
    if index < whole {
        return (index * PANEL, PANEL);
    }
    let first = whole * PANEL;
    match rest {
        0..=8 => (first, 8),
        9..=16 => (first, 16),
        17..=24 if index == whole => (first, 16),
        17..=24 => (first + 16, 8),
        _ => (first, 32),
    }
}

/// `channels` filled up to whole panels.
pub const fn panelled(channels: usize) -> usize {
    let (first, width) = panel(channels, panel_count(channels).saturating_sub(1));
    first + width
}

/// Pixels computed together against a panel of this width.
pub const fn pixels_at_once(width: usize) -> usize {
    if width == PANEL { 10 } else { 20 }
}

/// The codes that one call reads.
#[derive(Clone, Copy)]
pub(crate) struct Patch<'a> {
    /// Where the codes are.
    pub(crate) bytes: &'a [u8],
    /// First byte of each row of the first pixel's patch.
    pub(crate) starts: &'a [usize],
    /// Bytes from one pixel to the next.
    pub(crate) stride: usize,
    /// Four-byte groups in a row.
    pub(crate) groups: usize,
}

impl Patch<'_> {
    /// Whether all reads for `pixels` pixels stay inside `bytes`, and all of `weights` is there. Holds by the model's validation;
    /// unsafe kernels ask again.
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

/// An instruction set: what differs between kernels.
pub(crate) trait Isa {
    /// Adds the products of `pixels` patches with one panel of `width` channels (8, 16 or 32). Without [`Patch::fits`] the result
    /// is unspecified, but memory stays whole.
    fn gemm(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize);

    /// As [`Self::gemm`], with the sums set to the products whatever they were.
    #[inline(always)]
    fn gemm_from_zero(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        head_mut(acc, pixels * width).fill(0);
        Self::gemm(acc, pixels, patch, weights, width);
    }

    /// Turns accumulators into codes and stores them in the arena; returns how many were cut. As [`Finish::portable`].
    #[inline(always)]
    fn finish(finish: &Finish<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
        finish.portable(bytes, acc, target)
    }

    /// Exponentials of one query as two planes, 0 behind the last key; returns their sum. As [`Softmax::portable`].
    #[inline(always)]
    fn softmax(softmax: &Softmax<'_>, low: &mut [u8], high: &mut [u8]) -> i64 {
        softmax.portable(low, high)
    }

    /// Normalises up to [`layer_norm::PIXELS`] pixels from column `col` on; returns how many codes were cut. As
    /// [`layer_norm::Job::portable`].
    #[inline(always)]
    fn layer_norm(job: &layer_norm::Job<'_, '_>, bytes: &mut [u8], col: usize, pixels: usize) -> u64 {
        job.portable(bytes, col, pixels)
    }
}

/// One way of computing: same numbers, other instructions.
#[derive(Clone, Copy)]
pub struct Kernel {
    name: &'static str,
    pub(crate) unit: fn(&Model<'_>, &Prepared, &mut Arena<'_>, usize, usize) -> u64,
    pub(crate) sum: fn(&[u8]) -> u32,
    pub(crate) gemm: fn(&mut Accumulators, usize, &Patch<'_>, &[u8], usize),
}

impl Kernel {
    /// The specification; runs everywhere.
    pub const SCALAR: Self =
        Self { name: scalar::NAME, unit: super::ops::run::<scalar::Scalar>, sum, gemm: <scalar::Scalar as Isa>::gemm };

    /// The kernels this processor runs, fastest first; the last is always [`Kernel::SCALAR`].
    pub fn available() -> impl Iterator<Item = Self> {
        select::fastest_first().into_iter().flatten()
    }

    /// The fastest kernel this processor runs.
    pub fn best() -> Self {
        Self::available().next().unwrap_or(Self::SCALAR)
    }

    /// Its name, by the rule `{isa}-{types}-{variant}`.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// The bare matrix product, for benchmarks and tests: `acc[p][c] += Σ x[starts[r] + p*stride + 4g + b] * w[r][g][c][b]` for
    /// `pixels` pixels, as described in [the module](self). `weights` is as long as `starts.len() * groups * width * 4`.
    ///
    /// # Errors
    /// A word on what does not fit; then `acc` is untouched.
    pub fn matrix_product(
        &self,
        acc: &mut [i32],
        (pixels, width): (usize, usize),
        (bytes, starts): (&[u8], &[usize]),
        (stride, groups): (usize, usize),
        weights: &[u8],
    ) -> Result<(), &'static str> {
        if ![8, 16, 32].contains(&width) || pixels.checked_mul(width).is_none_or(|n| acc.len() < n) {
            return Err("panel width (8, 16, 32) or accumulators");
        }
        // All of it first: sums of addresses must not wrap, and a refusal must come before the first block is done.
        let reach = || pixels.saturating_sub(1).checked_mul(stride)?.checked_add(groups.checked_mul(4)?);
        let ends_inside = |end: usize| end <= bytes.len();
        let inside = |reach: usize| starts.iter().all(|s| s.checked_add(reach).is_some_and(ends_inside));
        let needed = || groups.checked_mul(4 * width)?.checked_mul(starts.len());
        if !reach().is_some_and(inside) || needed().is_none_or(|n| weights.len() < n) {
            return Err("activations or weights");
        }
        // Kernels need not be asked for sums of nothing.
        let pixels = if starts.is_empty() || groups == 0 { 0 } else { pixels };
        let mut done = 0;
        while done < pixels {
            let now = (pixels - done).min(pixels_at_once(width));
            let mut block = [0; ACCUMULATORS];
            let patch = Patch { bytes: bytes.get(done * stride..).ok_or("activations")?, starts, stride, groups };
            let part = &mut acc[done * width..(done + now) * width];
            block[..part.len()].copy_from_slice(part);
            (self.gemm)(&mut block, now, &patch, weights, width);
            part.copy_from_slice(&block[..part.len()]);
            done += now;
        }
        Ok(())
    }
}

impl core::fmt::Debug for Kernel {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name)
    }
}

#[cfg(test)]
mod tests;
