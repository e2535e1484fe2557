//! NEON (AArch64): `smull` and `smlal` sum two products of i8 in an i16, `sadalp` adds neighbours to sums of i32.
//!
//! Codes become i8 by flipping their highest bit: x = x' + 128, so 128 Σw is added at the end. Weights are never -128, so two
//! products stay within i16: 2 * 128 * 127 = 32512.
//!
//! ```text
//! excess[c] = 128 Σ w of channel c                              once per call
//! sums of 2 pixels x 16 (or 4 x 8) channels stay in registers, two lanes per channel
//! for every row r of the patch and every two groups g, g + 1:
//!     for every pixel p:  x0, x1 = four codes each, flipped, in all lanes        ldr, eor, dup, dup
//!     for every two channels c, c + 1 and every pixel p:
//!         t  = x0 * w[r][g][c..c + 2]                            smull   8 products of 16 bits
//!         t += x1 * w[r][g + 1][c..c + 2]                        smlal
//!         sum[p][c..c + 2] += neighbours of t                    sadalp
//! add the two lanes of every channel, and its excess
//! ```
//! With the dot-product extension one `sdot` replaces the three instructions: see `neon_dot`.
#![allow(unsafe_code)]

use super::{Accumulators, Isa, PANEL, Patch, blocks};
use core::arch::aarch64::*;

/// NEON without extensions.
#[derive(Default)]
pub(crate) struct Neon;

impl Isa for Neon {
    const NAME: &str = "neon-u8i8-2x16";

    #[inline(always)]
    fn gemm(&mut self, acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        product(acc, pixels, patch, weights, width);
    }
}

/// Not inlined, because the convolutions and the attention use the same code.
#[inline(never)]
fn product(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
    if !patch.fits(pixels, weights, width) {
        return;
    }
    let at = acc.as_mut_ptr();
    // SAFETY: NEON is part of the target, and `fits` has bounded every read and write.
    unsafe {
        let excess = excess(patch, weights, width);
        blocks(width, width.clamp(8, 16), pixels, |channel, first, left| {
            let to = at.add(width * first + channel);
            match (width, left) {
                (8, 4..) => block::<4, 4>(to, first, channel, patch, weights, width, &excess),
                (8, 2..) => block::<2, 4>(to, first, channel, patch, weights, width, &excess),
                (8, _) => block::<1, 4>(to, first, channel, patch, weights, width, &excess),
                (_, 2..) => block::<2, 8>(to, first, channel, patch, weights, width, &excess),
                _ => block::<1, 8>(to, first, channel, patch, weights, width, &excess),
            }
        });
    }
}

/// Returns 128 Σ w of every channel of the panel.
///
/// # Safety
/// `weights` holds the patch's groups of `width` channels.
#[inline(always)]
pub(super) unsafe fn excess(patch: &Patch<'_>, weights: &[u8], width: usize) -> [i32; PANEL] {
    /// Number of sums of two weights whose total fits into an i16: 2 * 127 * 128 < 2^15.
    const AT_ONCE: usize = 128;
    let mut sums = [0; PANEL];
    let groups = patch.starts.len() * patch.groups;
    // SAFETY: guaranteed by the caller.
    unsafe {
        for channel in (0..width).step_by(8) {
            let (mut w, mut left) = (weights.as_ptr().add(4 * channel).cast::<i8>(), groups);
            let mut wide = [vdupq_n_s32(0); 2];
            while left > 0 {
                let now = left.min(AT_ONCE);
                let mut narrow = [vdupq_n_s16(0); 2];
                for _ in 0..now {
                    narrow[0] = vpadalq_s8(narrow[0], vld1q_s8(w));
                    narrow[1] = vpadalq_s8(narrow[1], vld1q_s8(w.add(16)));
                    w = w.add(4 * width);
                }
                wide[0] = vpadalq_s16(wide[0], narrow[0]);
                wide[1] = vpadalq_s16(wide[1], narrow[1]);
                left -= now;
            }
            vst1q_s32(sums.as_mut_ptr().add(channel), vshlq_n_s32::<7>(wide[0]));
            vst1q_s32(sums.as_mut_ptr().add(channel + 4), vshlq_n_s32::<7>(wide[1]));
        }
    }
    sums
}

/// Computes `P` pixels against `2 * PAIRS` channels from `channel` on.
///
/// # Safety
/// [`Patch::fits`] for `first + P` pixels.
#[inline(always)]
unsafe fn block<const P: usize, const PAIRS: usize>(
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
        let mut sums = [[vdupq_n_s32(0); PAIRS]; P];
        let mut w = weights.as_ptr().add(4 * channel).cast::<i8>();
        for &start in patch.starts {
            let mut x = patch.bytes.as_ptr().add(start + first * stride);
            for _ in 0..patch.groups / 2 {
                let mut codes = [[vdupq_n_s8(0); 2]; P];
                for p in 0..P {
                    let eight = x.add(p * stride).cast::<u64>().read_unaligned();
                    let eight = vreinterpret_s32_u8(veor_u8(vcreate_u8(eight), vdup_n_u8(0x80)));
                    codes[p][0] = vreinterpretq_s8_s32(vdupq_lane_s32::<0>(eight));
                    codes[p][1] = vreinterpretq_s8_s32(vdupq_lane_s32::<1>(eight));
                }
                for c in 0..PAIRS / 2 {
                    let w0 = vld1q_s8(w.add(16 * c));
                    let w1 = vld1q_s8(w.add(4 * width + 16 * c));
                    for p in 0..P {
                        let [x0, x1] = codes[p];
                        let low = vmull_s8(vget_low_s8(x0), vget_low_s8(w0));
                        let low = vmlal_s8(low, vget_low_s8(x1), vget_low_s8(w1));
                        let high = vmlal_high_s8(vmull_high_s8(x0, w0), x1, w1);
                        sums[p][2 * c] = vpadalq_s16(sums[p][2 * c], low);
                        sums[p][2 * c + 1] = vpadalq_s16(sums[p][2 * c + 1], high);
                    }
                }
                x = x.add(8);
                w = w.add(8 * width);
            }
            if patch.groups % 2 == 1 {
                for p in 0..P {
                    let four = x.add(p * stride).cast::<u32>().read_unaligned() ^ 0x8080_8080;
                    let code = vreinterpretq_s8_u32(vdupq_n_u32(four));
                    for c in 0..PAIRS / 2 {
                        let w0 = vld1q_s8(w.add(16 * c));
                        let low = vmull_s8(vget_low_s8(code), vget_low_s8(w0));
                        sums[p][2 * c] = vpadalq_s16(sums[p][2 * c], low);
                        sums[p][2 * c + 1] = vpadalq_s16(sums[p][2 * c + 1], vmull_high_s8(code, w0));
                    }
                }
                w = w.add(4 * width);
            }
        }
        for p in 0..P {
            for c in 0..PAIRS / 2 {
                let sum = vpaddq_s32(sums[p][2 * c], sums[p][2 * c + 1]);
                let sum = vaddq_s32(sum, vld1q_s32(excess.as_ptr().add(channel + 4 * c)));
                let at = acc.add(width * p + 4 * c);
                vst1q_s32(at, vaddq_s32(vld1q_s32(at), sum));
            }
        }
    }
    P
}
