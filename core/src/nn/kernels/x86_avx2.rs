//! AVX2: `vpmaddwd` multiplies 16 pairs of i16 and adds neighbours into 8 sums of i32. Unlike `vpmaddubsw` it cannot saturate.
//!
//! ```text
//! for up to 128 groups of the patch:
//!     wide[p] = the codes of P pixels, widened once for all channels     u8 -> i16, eight bytes a group
//!     sums of P pixels x 8 channels stay in registers, two vectors per pixel: 4 channels x 2 halves of a group each
//!     for every 8 channels and every group g:
//!         w0, w1 = weights of 8 channels, widened                        i8 -> i16, 4 channels x 4 each
//!         for every pixel p:
//!             x = wide[p][g], repeated                                   a broadcast load
//!             sum[p][0] += vpmaddwd(x, w0);  sum[p][1] += vpmaddwd(x, w1)
//!     add the two halves of every channel
//! ```
#![allow(unsafe_code)]
// Functions that are called instead of inlined would keep the sums in memory, so these are plain loops.
#![allow(clippy::needless_range_loop)]

pub(super) mod requantise;

use super::requantise::{Requantise, Target};
use super::{Accumulators, Isa, Patch};
use core::arch::x86_64::*;
use core::mem::MaybeUninit;

/// AVX2.
#[derive(Default)]
pub(crate) struct Avx2;

/// Most pixels whose sums stay in registers.
const PIXELS: usize = 5;
/// Most groups that are widened at once.
const GROUPS: usize = 128;
/// Distance of two pixels' widened codes, groups: not a multiple of a page, whose addresses the first-level cache would take for equal.
const SPACE: usize = GROUPS + 8;
/// Widened codes, four i16 a group.
type Wide = [MaybeUninit<u64>; PIXELS * SPACE];

impl Isa for Avx2 {
    const NAME: &str = "avx2-u8i8-5x8";

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
        unsafe { requantise::run(requantise, bytes, acc, target) }
            .unwrap_or_else(|| requantise.portable(bytes, acc, target))
    }
}

/// Computes the product and adds it to `acc`, or (`ADD` false) replaces `acc` by it. Not inlined, because the convolutions and the attention
/// use the same code.
///
/// # Safety
/// The processor has AVX2.
#[inline(never)]
#[target_feature(enable = "avx2")]
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
    let mut first = 0;
    while first < pixels {
        let left = pixels - first;
        // SAFETY: the processor has the instructions, and `fits` has bounded every read and write.
        first += unsafe {
            let at = acc.as_mut_ptr().add(first * width);
            match left {
                5.. => block::<5, ADD>(at, first, patch, weights, width),
                4 => block::<4, ADD>(at, first, patch, weights, width),
                2..4 => block::<2, ADD>(at, first, patch, weights, width),
                _ => block::<1, ADD>(at, first, patch, weights, width),
            }
        };
    }
}

/// Computes `P` pixels against all channels; returns `P`.
///
/// # Safety
/// The processor has AVX2; [`Patch::fits`] for `first + P` pixels; `acc` is the first sum of pixel `first`.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn block<const P: usize, const ADD: bool>(
    acc: *mut i32,
    first: usize,
    patch: &Patch<'_>,
    weights: &[u8],
    width: usize,
) -> usize {
    let mut wide: Wide = [MaybeUninit::uninit(); PIXELS * SPACE];
    let (mut row, mut group, mut weights, mut adds) = (0, 0, weights.as_ptr(), ADD);
    loop {
        let mut filled = 0;
        while row < patch.starts.len() && filled < GROUPS {
            let now = (patch.groups - group).min(GROUPS - filled);
            for p in 0..P {
                let from = patch.starts[row] + (first + p) * patch.stride + 4 * group;
                // SAFETY: `fits` bounds the codes; `filled + now` is at most `GROUPS`.
                unsafe { widen(patch.bytes.as_ptr().add(from), now, wide.as_mut_ptr().add(p * SPACE + filled).cast()) }
            }
            (filled, group) = (filled + now, group + now);
            if group == patch.groups {
                (row, group) = (row + 1, 0);
            }
        }
        for channel in (0..width).step_by(8) {
            // SAFETY: `fits` bounds sums and weights; `filled` groups of `P` pixels are written.
            unsafe { eight::<P>(acc.add(channel), wide.as_ptr().cast(), filled, weights.add(4 * channel), width, adds) }
        }
        if row == patch.starts.len() {
            return P;
        }
        // SAFETY: as above.
        weights = unsafe { weights.add(4 * width * filled) };
        adds = true;
    }
}

/// Writes the codes of `groups` groups as i16.
///
/// # Safety
/// The processor has AVX2; `4 * groups` bytes are readable at `codes`, `8 * groups` writable at `to`.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn widen(codes: *const u8, groups: usize, to: *mut u64) {
    // SAFETY: no access passes `groups`.
    unsafe {
        let mut done = 0;
        while done + 4 <= groups {
            let four = _mm256_cvtepu8_epi16(_mm_loadu_si128(codes.add(4 * done).cast()));
            _mm256_storeu_si256(to.add(done).cast(), four);
            done += 4;
        }
        while done < groups {
            let one = _mm_cvtepu8_epi16(_mm_cvtsi32_si128(codes.add(4 * done).cast::<i32>().read_unaligned()));
            _mm_storel_epi64(to.add(done).cast(), one);
            done += 1;
        }
    }
}

/// Computes `P` pixels against eight channels.
///
/// # Safety
/// The processor has AVX2; `groups` groups of `P` pixels are at `wide`, and as many of a panel of `width` channels at `weights`; `acc` has eight
/// sums every `width`.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn eight<const P: usize>(
    acc: *mut i32,
    wide: *const i64,
    groups: usize,
    mut weights: *const u8,
    width: usize,
    adds: bool,
) {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let mut sums = [[_mm256_setzero_si256(); 2]; P];
        for group in 0..groups {
            let w0 = _mm256_cvtepi8_epi16(_mm_loadu_si128(weights.cast()));
            let w1 = _mm256_cvtepi8_epi16(_mm_loadu_si128(weights.add(16).cast()));
            for p in 0..P {
                let x = _mm256_set1_epi64x(*wide.add(p * SPACE + group));
                sums[p][0] = _mm256_add_epi32(sums[p][0], _mm256_madd_epi16(x, w0));
                sums[p][1] = _mm256_add_epi32(sums[p][1], _mm256_madd_epi16(x, w1));
            }
            weights = weights.add(4 * width);
        }
        for p in 0..P {
            // Lanes 0 and 1 belong to channel 0, 2 and 3 to channel 1, and so on; hadd gives the order 0 1 4 5 2 3 6 7.
            let both = _mm256_hadd_epi32(sums[p][0], sums[p][1]);
            let mut ordered = _mm256_permute4x64_epi64::<0b11_01_10_00>(both);
            let at = acc.add(p * width).cast::<__m256i>();
            if adds {
                ordered = _mm256_add_epi32(_mm256_loadu_si256(at), ordered);
            }
            _mm256_storeu_si256(at, ordered);
        }
    }
}
