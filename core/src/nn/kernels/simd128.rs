//! WebAssembly's SIMD: `i32x4.dot_i16x8_s` multiplies 8 pairs of i16 and adds neighbours into 4 sums of i32. It cannot saturate.
//!
//! ```text
//! sums of 2 pixels x 8 channels stay in registers, two lanes per channel
//! for every row r of the patch and every group g:
//!     for every pixel p:  x[p] = four codes of the pixel, repeated and widened     v128.load32_splat, i16x8.extend_low_i8x16_u
//!     for every two channels c, c + 1:
//!         w = their weights, widened                                               i16x8.load8x8_s
//!         for every pixel p:  sum[p][c..c + 2] += dot(x[p], w)                      i32x4.dot_i16x8_s, i32x4.add
//! add the two lanes of every channel
//! ```
#![allow(unsafe_code)]

use super::{Accumulators, Isa, Patch, blocks};
use core::arch::wasm32::*;

/// SIMD with 128 bits.
#[derive(Default)]
pub(crate) struct Simd128;

/// Two channels of 8: 8 sums of two pixels fit into the 16 registers of x86.
const PAIRS: usize = 4;

impl Isa for Simd128 {
    const NAME: &str = "simd128-u8i8-2x8";

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
    blocks(width, 2 * PAIRS, pixels, |channel, first, left| {
        // SAFETY: SIMD is part of the target, and `fits` has bounded every read and write.
        unsafe {
            let to = at.add(width * first + channel);
            match left {
                2.. => block::<2>(to, first, channel, patch, weights, width),
                _ => block::<1>(to, first, channel, patch, weights, width),
            }
        }
    });
}

/// Computes `P` pixels against 8 channels from `channel` on.
///
/// # Safety
/// [`Patch::fits`] for `first + P` pixels.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "lists of one known length side by side")]
unsafe fn block<const P: usize>(
    acc: *mut i32,
    first: usize,
    channel: usize,
    patch: &Patch<'_>,
    weights: &[u8],
    width: usize,
) -> usize {
    let stride = patch.stride;
    // SAFETY: `fits` bounds every address below.
    unsafe {
        let mut w = weights.as_ptr().add(4 * channel).cast::<i8>();
        let mut sums = [[i32x4_splat(0); PAIRS]; P];
        for &start in patch.starts {
            let mut x = patch.bytes.as_ptr().add(start + first * stride);
            for _ in 0..patch.groups {
                let mut codes = [i16x8_splat(0); P];
                for p in 0..P {
                    codes[p] = u16x8_extend_low_u8x16(v128_load32_splat(x.add(p * stride).cast()));
                }
                for c in 0..PAIRS {
                    let wide = i16x8_load_extend_i8x8(w.add(8 * c));
                    for p in 0..P {
                        sums[p][c] = i32x4_add(sums[p][c], i32x4_dot_i16x8(codes[p], wide));
                    }
                }
                x = x.add(4);
                w = w.add(4 * width);
            }
        }
        for p in 0..P {
            for c in 0..PAIRS / 2 {
                let [low, high] = [sums[p][2 * c], sums[p][2 * c + 1]];
                let both = i32x4_add(i32x4_shuffle::<0, 2, 4, 6>(low, high), i32x4_shuffle::<1, 3, 5, 7>(low, high));
                let at = acc.add(width * p + 4 * c).cast::<v128>();
                v128_store(at, i32x4_add(v128_load(at), both));
            }
        }
    }
    P
}
