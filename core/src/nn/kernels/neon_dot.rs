//! NEON with the dot-product extension (Cortex-A55, A76 and newer): `sdot` adds four products of i8 to an i32, in four lanes.
//!
//! ```text
//! sums of 4 pixels x 16 (or 8 x 8) channels stay in registers; excess[c] = 128 Σ w as in `neon`
//! for every row r of the patch and every four groups:
//!     for every pixel p:  x[p] = 16 codes, flipped                          ldr, eor
//!     for every group g of the four and every four channels c:
//!         w = weights of the channels, four bytes each
//!         for every pixel p:  sum[p][c] = sdot(sum[p][c], w, x[p], group g)
//! groups beyond a multiple of four one by one
//! ```
#![allow(unsafe_code)]

use super::neon::excess;
use super::{Accumulators, Isa, PANEL, Patch, blocks};
use core::arch::aarch64::*;
use core::arch::asm;

/// NEON with `sdot`.
#[derive(Default)]
pub(crate) struct NeonDot;

impl Isa for NeonDot {
    const NAME: &str = "neondot-u8i8-4x16";

    #[inline(always)]
    fn gemm(&mut self, acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        // SAFETY: the processor has the instructions (see `nn/dispatch`).
        unsafe { product(acc, pixels, patch, weights, width) }
    }
}

/// Not inlined, because the convolutions and the attention use the same code.
///
/// # Safety
/// The processor has the dot-product extension.
#[inline(never)]
#[target_feature(enable = "neon,dotprod")]
unsafe fn product(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
    if !patch.fits(pixels, weights, width) {
        return;
    }
    let at = acc.as_mut_ptr();
    // SAFETY: the processor has the instructions, and `fits` has bounded every read and write.
    unsafe {
        let excess = excess(patch, weights, width);
        blocks(width, width.clamp(8, 16), pixels, |channel, first, left| {
            let to = at.add(width * first + channel);
            match (width, left) {
                (8, 8..) => block::<8, 2>(to, first, channel, patch, weights, width, &excess),
                (8, 4..) => block::<4, 2>(to, first, channel, patch, weights, width, &excess),
                (8, _) => block::<1, 2>(to, first, channel, patch, weights, width, &excess),
                (_, 4..) => block::<4, 4>(to, first, channel, patch, weights, width, &excess),
                (_, 2..) => block::<2, 4>(to, first, channel, patch, weights, width, &excess),
                _ => block::<1, 4>(to, first, channel, patch, weights, width, &excess),
            }
        });
    }
}

/// Computes `P` pixels against `V` vectors of four channels from `channel` on.
///
/// # Safety
/// The processor has the dot-product extension; [`Patch::fits`] for `first + P` pixels.
#[inline(always)]
unsafe fn block<const P: usize, const V: usize>(
    acc: *mut i32,
    first: usize,
    channel: usize,
    patch: &Patch<'_>,
    weights: &[u8],
    width: usize,
    excess: &[i32; PANEL],
) -> usize {
    let stride = patch.stride;
    // SAFETY: `fits` bounds every address below.
    unsafe {
        let mut sums = [[vdupq_n_s32(0); V]; P];
        for (p, sums) in sums.iter_mut().enumerate() {
            for (v, sum) in sums.iter_mut().enumerate() {
                let before = vld1q_s32(acc.add(width * p + 4 * v));
                *sum = vaddq_s32(before, vld1q_s32(excess.as_ptr().add(channel + 4 * v)));
            }
        }
        let mut w = weights.as_ptr().add(4 * channel).cast::<i8>();
        for &start in patch.starts {
            let mut x = patch.bytes.as_ptr().add(start + first * stride);
            for _ in 0..patch.groups / 4 {
                let mut codes = [vdupq_n_s8(0); P];
                for (p, codes) in codes.iter_mut().enumerate() {
                    *codes = veorq_s8(vld1q_s8(x.add(p * stride).cast()), vdupq_n_s8(i8::MIN));
                }
                four_channels::<P, V, 0>(&mut sums, &codes, w);
                four_channels::<P, V, 1>(&mut sums, &codes, w.add(4 * width));
                four_channels::<P, V, 2>(&mut sums, &codes, w.add(8 * width));
                four_channels::<P, V, 3>(&mut sums, &codes, w.add(12 * width));
                x = x.add(16);
                w = w.add(16 * width);
            }
            for _ in 0..patch.groups % 4 {
                let mut codes = [vdupq_n_s8(0); P];
                for (p, codes) in codes.iter_mut().enumerate() {
                    let four = x.add(p * stride).cast::<u32>().read_unaligned() ^ 0x8080_8080;
                    *codes = vreinterpretq_s8_u32(vdupq_n_u32(four));
                }
                four_channels::<P, V, 0>(&mut sums, &codes, w);
                x = x.add(4);
                w = w.add(4 * width);
            }
        }
        for (p, sums) in sums.iter().enumerate() {
            for (v, sum) in sums.iter().enumerate() {
                vst1q_s32(acc.add(width * p + 4 * v), *sum);
            }
        }
    }
    P
}

/// Adds the products of group `G` of the codes.
///
/// # Safety
/// The processor has the dot-product extension; `16 * V` weights are readable at `w`.
#[inline(always)]
unsafe fn four_channels<const P: usize, const V: usize, const G: usize>(
    sums: &mut [[int32x4_t; V]; P],
    codes: &[int8x16_t; P],
    w: *const i8,
) {
    for v in 0..V {
        // SAFETY: guaranteed by the caller.
        let w = unsafe { vld1q_s8(w.add(16 * v)) };
        for p in 0..P {
            // The intrinsic is not stable yet.
            // SAFETY: as above; only registers change.
            unsafe {
                asm!(
                    "sdot {0:v}.4s, {1:v}.16b, {2:v}.4b[{3}]",
                    inout(vreg) sums[p][v], in(vreg) w, in(vreg) codes[p], const G,
                    options(pure, nomem, nostack, preserves_flags),
                );
            }
        }
    }
}
