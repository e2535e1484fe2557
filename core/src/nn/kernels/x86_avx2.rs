//! AVX2: `vpmaddwd` multiplies 16 pairs of i16 and adds neighbours into 8 sums of i32. Unlike `vpmaddubsw` it cannot saturate.
//!
//! ```text
//! sums of P pixels x 8 channels stay in registers, two vectors per pixel: 4 channels x 2 halves of a group each
//! for every row r of the patch and every group g:
//!     w0, w1 = weights of 8 channels, widened        i8 -> i16, 4 channels x 4 each
//!     for every pixel p:
//!         x = four codes of the pixel, widened and repeated
//!         sum[p][0] += vpmaddwd(x, w0);  sum[p][1] += vpmaddwd(x, w1)
//! add the two halves of every channel
//! ```
#![allow(unsafe_code)]
// Functions that are called instead of inlined would keep the sums in memory, so these are plain loops.
#![allow(clippy::needless_range_loop)]

use super::{Accumulators, Isa, Patch};
use core::arch::x86_64::*;

/// AVX2.
#[derive(Default)]
pub(crate) struct Avx2;

impl Isa for Avx2 {
    const NAME: &str = "avx2-u8i8-5x8";

    #[inline(always)]
    fn gemm(&mut self, acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        if !patch.fits(pixels, weights, width) {
            return;
        }
        let (mut first, at) = (0, acc.as_mut_ptr());
        while first < pixels {
            let left = pixels - first;
            let mut done = 1;
            for channel in (0..width).step_by(8) {
                // SAFETY: the processor has the instructions (see `nn/dispatch`), and `fits` has bounded every read and write.
                unsafe {
                    let at = at.add(first * width + channel);
                    done = match left {
                        5.. => block::<5>(at, first, channel, patch, weights, width),
                        4 => block::<4>(at, first, channel, patch, weights, width),
                        2..4 => block::<2>(at, first, channel, patch, weights, width),
                        _ => block::<1>(at, first, channel, patch, weights, width),
                    };
                }
            }
            first += done;
        }
    }
}

/// Computes `P` pixels against 8 channels.
///
/// # Safety
/// The processor has AVX2; [`Patch::fits`] for `first + P` pixels.
#[target_feature(enable = "avx2")]
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
        let mut w = weights.as_ptr().add(4 * channel);
        let mut sums = [[_mm256_setzero_si256(); 2]; P];
        for &start in patch.starts {
            let mut x = patch.bytes.as_ptr().add(start + first * stride);
            for _ in 0..patch.groups {
                let w0 = _mm256_cvtepi8_epi16(_mm_loadu_si128(w.cast()));
                let w1 = _mm256_cvtepi8_epi16(_mm_loadu_si128(w.add(16).cast()));
                for p in 0..P {
                    let codes = _mm_cvtsi32_si128(x.add(p * stride).cast::<i32>().read_unaligned());
                    let wide = _mm256_broadcastq_epi64(_mm_cvtepu8_epi16(codes));
                    sums[p][0] = _mm256_add_epi32(sums[p][0], _mm256_madd_epi16(wide, w0));
                    sums[p][1] = _mm256_add_epi32(sums[p][1], _mm256_madd_epi16(wide, w1));
                }
                x = x.add(4);
                w = w.add(4 * width);
            }
        }
        for p in 0..P {
            // Lanes 0 and 1 belong to channel 0, 2 and 3 to channel 1, and so on; hadd gives the order 0 1 4 5 2 3 6 7.
            let both = _mm256_hadd_epi32(sums[p][0], sums[p][1]);
            let ordered = _mm256_permute4x64_epi64::<0b11_01_10_00>(both);
            let at = acc.add(p * width).cast::<__m256i>();
            _mm256_storeu_si256(at, _mm256_add_epi32(_mm256_loadu_si256(at), ordered));
        }
    }
    P
}
