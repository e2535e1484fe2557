//! AVX-VNNI, for processors without AVX-512: `vpdpbusd` multiplies four u8 by four i8 and adds them to an i32, in 8 lanes, without saturation.
//!
//! ```text
//! sums of P pixels x 1 or 2 vectors of 8 channels stay in registers (up to 6 x 2 or 12 x 1)
//! for every row r of the patch and every group g:
//!     w = the weights of this group                  8 channels x 4 bytes each
//!     for every pixel p:
//!         x = four codes of the pixel, in all lanes  a broadcast load
//!         sum[p] = vpdpbusd(sum[p], x, w)
//! ```
#![allow(unsafe_code)]
// Functions that are called instead of inlined would keep the sums in memory, so these are plain loops.
#![allow(clippy::needless_range_loop)]

use super::requantise::{Requantise, Target};
use super::{Accumulators, Isa, Patch, evenly, x86_avx2};
use core::arch::x86_64::*;

/// AVX2 and AVX-VNNI.
#[derive(Default)]
pub(crate) struct AvxVnni;

/// Channels of a vector.
const LANES: usize = 8;

impl Isa for AvxVnni {
    const NAME: &str = "avxvnni-u8i8-6x16";

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

    #[inline(always)]
    fn requantise(requantise: &Requantise<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
        // SAFETY: as above.
        unsafe { x86_avx2::requantise::run(requantise, bytes, acc, target) }
            .unwrap_or_else(|| requantise.portable(bytes, acc, target))
    }
}

/// Computes the product and adds it to `acc`, or (`ADD` false) replaces `acc` by it.
///
/// # Safety
/// The processor has AVX-VNNI.
#[inline(always)]
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
    let (vectors, most) = if width == LANES { (1, 12) } else { (2, 6) };
    for channel in (0..width).step_by(LANES * vectors) {
        let mut first = 0;
        while first < pixels {
            let left = pixels - first;
            // SAFETY: the processor has the instructions, and `fits` has bounded every read and write.
            first += unsafe {
                let at = at.add(first * width + channel);
                let now = evenly(left, most);
                if vectors == 1 {
                    one_vector::<ADD>(at, first, now, channel, patch, weights, width)
                } else {
                    two_vectors::<ADD>(at, first, now, channel, patch, weights, width)
                }
            };
        }
    }
}

/// Makes a function that computes `now` pixels, up to the number whose sums fit into registers, against some vectors; returns `now`.
macro_rules! blocks {
    ($name:ident, $vectors:literal, [$($count:literal),+], $most:literal) => {
        /// # Safety
        /// The processor has AVX-VNNI; [`Patch::fits`].
        #[target_feature(enable = "avx2,avxvnni")]
        unsafe fn $name<const ADD: bool>(
            acc: *mut i32,
            first: usize,
            now: usize,
            channel: usize,
            patch: &Patch<'_>,
            weights: &[u8],
            width: usize,
        ) -> usize {
            // SAFETY: guaranteed by the caller.
            unsafe {
                match now {
                    $($count => block::<$count, $vectors, ADD>(acc, first, channel, patch, weights, width),)+
                    _ => block::<$most, $vectors, ADD>(acc, first, channel, patch, weights, width),
                }
            }
        }
    };
}

blocks!(one_vector, 1, [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11], 12);
blocks!(two_vectors, 2, [1, 2, 3, 4, 5], 6);

/// Computes `P` pixels against `V` vectors.
///
/// # Safety
/// The processor has AVX-VNNI; [`Patch::fits`] for `first + P` pixels.
#[target_feature(enable = "avx2,avxvnni")]
unsafe fn block<const P: usize, const V: usize, const ADD: bool>(
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
        let mut sums = [[_mm256_setzero_si256(); V]; P];
        for &start in patch.starts {
            let mut x = patch.bytes.as_ptr().add(start + first * stride);
            for _ in 0..patch.groups {
                let mut panel = [_mm256_setzero_si256(); V];
                for v in 0..V {
                    panel[v] = _mm256_loadu_si256(w.add(4 * LANES * v).cast());
                }
                for p in 0..P {
                    let codes = _mm256_set1_epi32(x.add(p * stride).cast::<i32>().read_unaligned());
                    for v in 0..V {
                        sums[p][v] = _mm256_dpbusd_avx_epi32(sums[p][v], codes, panel[v]);
                    }
                }
                x = x.add(4);
                w = w.add(4 * width);
            }
        }
        for p in 0..P {
            for v in 0..V {
                let at = acc.add(p * width + LANES * v).cast::<__m256i>();
                let more = if ADD { _mm256_loadu_si256(at) } else { _mm256_setzero_si256() };
                _mm256_storeu_si256(at, _mm256_add_epi32(sums[p][v], more));
            }
        }
    }
    P
}
