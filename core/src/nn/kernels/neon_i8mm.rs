//! NEON with the extension for matrices of i8 (Neoverse N2 and V1, Cortex-A510, Apple M2 and newer): `usmmla` multiplies 2 pixels x 8 codes
//! by 8 weights x 2 channels and adds the products to 2 x 2 sums of i32. Codes are u8 as they are, so nothing is added at the end.
//!
//! ```text
//! sums of up to 8 pixels x 8 channels stay in registers, 2 x 2 in each
//! for every row r of the patch and every four groups:
//!     for every two pixels:  x = the first eight codes of both; y = the next eight       ldr, ldr, zip1, zip2
//!     for every two groups g, g + 1 of the four and every four channels c:
//!         w, v = eight weights of channels c and c + 1, of c + 2 and c + 3                ldr, ldr, zip1, zip2
//!         for every two pixels:  sums += x (or y) * w, sums += x (or y) * v               usmmla, usmmla
//! groups beyond a multiple of four: two, then one with zeros
//! ```
//! In the file four bytes of every channel of a group lie side by side. `zip` of two groups makes eight bytes of a channel of them while the
//! kernel loads, once for all pixels, so that the file needs no second order of weights.
#![allow(unsafe_code)]
// Functions that are called instead of inlined would keep the sums in memory, so these are plain loops.
#![allow(clippy::needless_range_loop)]

use super::{Accumulators, Isa, PANEL, Patch};
use core::arch::aarch64::*;
use core::arch::asm;

/// NEON with `usmmla`.
#[derive(Default)]
pub(crate) struct NeonI8mm;

/// Channels, and most pixels, whose sums stay in registers.
const SIDE: usize = 8;

impl Isa for NeonI8mm {
    const NAME: &str = "neoni8mm-u8i8-8x8";

    /// Whole blocks of registers.
    #[inline(always)]
    fn block(left: usize, width: usize) -> usize {
        left.min(if width == PANEL { SIDE } else { 2 * SIDE })
    }

    #[inline(always)]
    fn gemm(&mut self, acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        // SAFETY: the processor has the instructions (see `nn/dispatch`).
        unsafe { product::<true>(acc, pixels, patch, weights, width) }
    }

    #[inline(always)]
    fn gemm_from_zero(
        &mut self,
        acc: &mut Accumulators,
        pixels: usize,
        patch: &Patch<'_>,
        weights: &[u8],
        width: usize,
    ) {
        // SAFETY: as above.
        unsafe { product::<false>(acc, pixels, patch, weights, width) }
    }
}

/// Computes the product and adds it to `acc`, or (`ADD` false) replaces `acc` by it. Not inlined, because the convolutions and the
/// attention use the same code.
///
/// # Safety
/// The processor has the extension.
#[inline(never)]
#[target_feature(enable = "neon,i8mm")]
unsafe fn product<const ADD: bool>(
    acc: &mut Accumulators,
    pixels: usize,
    patch: &Patch<'_>,
    weights: &[u8],
    width: usize,
) {
    if !patch.fits(pixels, weights, width) {
        return;
    }
    let at = acc.as_mut_ptr();
    for channel in (0..width).step_by(SIDE) {
        let mut first = 0;
        while first < pixels {
            let now = (pixels - first).min(SIDE);
            // SAFETY: the processor has the instructions, and `fits` has bounded every read and write.
            unsafe {
                let at = at.add(width * first + channel);
                match now.div_ceil(2) {
                    1 => block::<1, ADD>(at, first, now, channel, patch, weights, width),
                    2 => block::<2, ADD>(at, first, now, channel, patch, weights, width),
                    3 => block::<3, ADD>(at, first, now, channel, patch, weights, width),
                    _ => block::<4, ADD>(at, first, now, channel, patch, weights, width),
                }
            }
            first += now;
        }
    }
}

/// Computes `now` pixels, in `PAIRS` pairs, against eight channels from `channel` on. The last pair of an odd number is a pixel twice.
///
/// # Safety
/// The processor has the extension; [`Patch::fits`] for `first + now` pixels; `now` is `2 * PAIRS` or one less.
#[inline]
#[target_feature(enable = "neon,i8mm")]
unsafe fn block<const PAIRS: usize, const ADD: bool>(
    acc: *mut i32,
    first: usize,
    now: usize,
    channel: usize,
    patch: &Patch<'_>,
    weights: &[u8],
    width: usize,
) {
    let (stride, group) = (patch.stride, 4 * width);
    // SAFETY: `fits` bounds every address below.
    unsafe {
        let mut sums = [[vdupq_n_s32(0); 4]; PAIRS];
        let mut w = weights.as_ptr().add(4 * channel).cast::<i32>();
        for &start in patch.starts {
            let start = patch.bytes.as_ptr().add(start + first * stride);
            let mut x = [[start; 2]; PAIRS];
            for p in 0..PAIRS {
                x[p] = [start.add(2 * p * stride), start.add((2 * p + 1).min(now - 1) * stride)];
            }
            let mut done = 0;
            for _ in 0..patch.groups / 4 {
                let (mut low, mut high) = ([vdupq_n_u8(0); PAIRS], [vdupq_n_u8(0); PAIRS]);
                for p in 0..PAIRS {
                    let [a, b] = x[p].map(|x| vreinterpretq_u64_u8(vld1q_u8(x.add(done))));
                    low[p] = vreinterpretq_u8_u64(vzip1q_u64(a, b));
                    high[p] = vreinterpretq_u8_u64(vzip2q_u64(a, b));
                }
                eight_channels(&mut sums, &low, w, w.byte_add(group));
                eight_channels(&mut sums, &high, w.byte_add(2 * group), w.byte_add(3 * group));
                w = w.byte_add(4 * group);
                done += 16;
            }
            if patch.groups & 2 != 0 {
                let mut codes = [vdupq_n_u8(0); PAIRS];
                for p in 0..PAIRS {
                    let [a, b] = x[p].map(|x| vld1_u8(x.add(done)));
                    codes[p] = vcombine_u8(a, b);
                }
                eight_channels(&mut sums, &codes, w, w.byte_add(group));
                w = w.byte_add(2 * group);
                done += 8;
            }
            if patch.groups & 1 != 0 {
                let mut codes = [vdupq_n_u8(0); PAIRS];
                for p in 0..PAIRS {
                    let [a, b] = x[p].map(|x| vcreate_u8(x.add(done).cast::<u32>().read_unaligned().into()));
                    codes[p] = vcombine_u8(a, b);
                }
                // The upper four codes are 0: any weights serve.
                eight_channels(&mut sums, &codes, w, w);
                w = w.byte_add(group);
            }
        }
        for p in 0..PAIRS {
            for half in 0..2 {
                let [a, b] = [sums[p][2 * half], sums[p][2 * half + 1]].map(|sum| vreinterpretq_s64_s32(sum));
                let rows = [vzip1q_s64(a, b), vzip2q_s64(a, b)];
                for odd in 0..2 {
                    if 2 * p + odd < now {
                        let at = acc.add(width * (2 * p + odd) + 4 * half);
                        let sum = vreinterpretq_s32_s64(rows[odd]);
                        vst1q_s32(at, if ADD { vaddq_s32(vld1q_s32(at), sum) } else { sum });
                    }
                }
            }
        }
    }
}

/// Adds the products of eight codes of every pixel with eight channels, whose weights of the first four codes are at `first`.
///
/// # Safety
/// The processor has the extension; 32 bytes are readable at `first` and at `second`.
#[inline(always)]
unsafe fn eight_channels<const PAIRS: usize>(
    sums: &mut [[int32x4_t; 4]; PAIRS],
    codes: &[uint8x16_t; PAIRS],
    first: *const i32,
    second: *const i32,
) {
    for half in 0..2 {
        // SAFETY: guaranteed by the caller.
        let weights = unsafe {
            let (a, b) = (vld1q_s32(first.add(4 * half)), vld1q_s32(second.add(4 * half)));
            [vzip1q_s32(a, b), vzip2q_s32(a, b)]
        };
        for p in 0..PAIRS {
            for two in 0..2 {
                // The intrinsic is not stable yet.
                // SAFETY: as above; only registers change.
                unsafe {
                    asm!(
                        "usmmla {0:v}.4s, {1:v}.16b, {2:v}.16b",
                        inout(vreg) sums[p][2 * half + two], in(vreg) codes[p], in(vreg) weights[two],
                        options(pure, nomem, nostack, preserves_flags),
                    );
                }
            }
        }
    }
}
