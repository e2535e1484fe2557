//! AVX-512 VNNI: `vpdpbusd` multiplies four u8 by four i8 and adds them to an i32, in 16 lanes, without saturation.
//!
//! ```text
//! sums of P pixels x 1 or 2 vectors stay in registers (10 x 2 or 20 x 1)
//! for every row r of the patch and every group g:
//!     w = the panel's weights of this group          one or two vectors of 16 channels x 4 bytes
//!     for every pixel p:
//!         x = four codes of the pixel, in all lanes  a broadcast load
//!         sum[p] = vpdpbusd(sum[p], x, w)
//! ```
//! A single pixel has several sums instead, each for every fourth group. A panel of 8 channels fills half a vector. Two pixels whose patches
//! overlap fill a whole one:
//!
//! ```text
//! sums of up to 20 pairs, 8 channels each, stay in registers: neighbours, or every second pixel if their patches are half a group apart
//! for every row r of the patch and every group g of both patches:
//!     w = the panel's weights of group g, and of the group that it is for the second pixel; 0 where g is outside a patch
//!     for every pair:
//!         x = four codes, in all lanes
//!         sum[pair] = vpdpbusd(sum[pair], x, w)
//! ```
//! So a kernel row of 4 columns takes 5 steps for two pixels, instead of 8 of half vectors (AVX-512VL).
#![allow(unsafe_code)]
// Functions that are called instead of inlined would keep the sums in memory, so these are plain loops.
#![allow(clippy::needless_range_loop)]

mod layer_norm;
mod requantise;
mod softmax;

use super::layer_norm::Job;
use super::requantise::{Requantise, Target};
use super::softmax::Softmax;
use super::{Accumulators, Isa, Patch, evenly, pixels_at_once};
use core::arch::x86_64::*;

/// Most pixels of a panel of 8 channels that are computed together, as 20 pairs.
const PAIRED: usize = 40;

/// AVX-512 F, BW, DQ, VL, VNNI. With `VBMI` tables of bytes are read from registers.
#[derive(Default)]
pub(crate) struct Avx512<const VBMI: bool>;

impl<const VBMI: bool> Isa for Avx512<VBMI> {
    const NAME: &str = if VBMI { "avx512vbmi-u8i8-10x32" } else { "avx512vnni-u8i8-10x32" };

    #[inline(always)]
    fn block(left: usize, width: usize) -> usize {
        match width {
            // Pairs, except for the last pixel of an odd number.
            8 => evenly(left, PAIRED).next_multiple_of(2).min(left),
            _ => evenly(left, pixels_at_once(width)),
        }
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

    #[inline(always)]
    fn requantise(requantise: &Requantise<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
        // SAFETY: the processor has the instructions (see `nn/dispatch`).
        unsafe { requantise::run::<VBMI>(requantise, bytes, acc, target) }
    }

    #[inline(always)]
    fn layer_norm(job: &Job<'_>, bytes: &mut [u8], col: usize, pixels: usize) -> u64 {
        // SAFETY: as above.
        unsafe { layer_norm::pixels(job, bytes, col, pixels) }
    }

    #[inline(always)]
    fn softmax(softmax: &Softmax<'_>, low: &mut [u8], high: &mut [u8]) -> i64 {
        // SAFETY: as above.
        unsafe { softmax::exponentials(softmax, low, high) }
    }
}

/// Computes the product and adds it to `acc`, or (`ADD` false) replaces `acc` by it.
///
/// # Safety
/// The processor has AVX-512.
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
    let (mut first, at) = (0, acc.as_mut_ptr());
    // How far apart two pixels are whose patches are whole groups apart, and overlap.
    let apart = [1, 2].into_iter().find(|apart| (apart * patch.stride).is_multiple_of(4));
    let apart = apart.filter(|apart| apart * patch.stride < 4 * patch.groups).unwrap_or(0);
    // SAFETY: the processor has the instructions, and `fits` has bounded every read and write.
    unsafe {
        while first < pixels {
            let left = pixels - first;
            first += match width {
                32 => wide::<ADD>(at.add(32 * first), first, left, patch, weights),
                16 => single::<ADD>(at.add(16 * first), first, left, patch, weights),
                _ if apart == 1 && left >= 2 => paired::<1, ADD>(at.add(8 * first), first, left, patch, weights),
                _ if apart == 2 && left >= 4 => paired::<2, ADD>(at.add(8 * first), first, left, patch, weights),
                _ => half::<ADD>(at.add(8 * first), first, left, patch, weights),
            }
        }
    }
}

/// A vector of sums of i32.
trait Sums: Copy {
    /// Returns a number in all lanes.
    ///
    /// # Safety
    /// The processor has AVX-512.
    unsafe fn repeat(value: i32) -> Self;

    /// Adds the four products of every lane.
    ///
    /// # Safety
    /// The processor has AVX-512.
    unsafe fn times(self, codes: Self, weights: Self) -> Self;

    /// Adds lane by lane.
    ///
    /// # Safety
    /// The processor has AVX-512.
    unsafe fn plus(self, other: Self) -> Self;
}

/// Implements [`Sums`] by three intrinsics.
macro_rules! sums {
    ($vector:ty, $repeat:ident, $times:ident, $plus:ident) => {
        impl Sums for $vector {
            #[inline(always)]
            unsafe fn repeat(value: i32) -> Self {
                // SAFETY: guaranteed by the caller.
                unsafe { $repeat(value) }
            }

            #[inline(always)]
            unsafe fn times(self, codes: Self, weights: Self) -> Self {
                // SAFETY: guaranteed by the caller.
                unsafe { $times(self, codes, weights) }
            }

            #[inline(always)]
            unsafe fn plus(self, other: Self) -> Self {
                // SAFETY: guaranteed by the caller.
                unsafe { $plus(self, other) }
            }
        }
    };
}

sums!(__m512i, _mm512_set1_epi32, _mm512_dpbusd_epi32, _mm512_add_epi32);
sums!(__m256i, _mm256_set1_epi32, _mm256_dpbusd_epi32, _mm256_add_epi32);

/// Makes a function for panels of some vectors that computes up to `most` pixels together.
macro_rules! blocks {
    ($name:ident, $vector:ty, $vectors:literal, $most:literal, [$($count:literal),+]) => {
        /// Computes as many pixels as are left, up to the number whose sums fit into registers; returns their number.
        ///
        /// # Safety
        /// The processor has AVX-512; [`Patch::fits`].
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
        unsafe fn $name<const ADD: bool>(acc: *mut i32, first: usize, left: usize, patch: &Patch<'_>, weights: &[u8]) -> usize {
            // SAFETY: guaranteed by the caller.
            unsafe {
                match left {
                    1 => one_pixel::<$vector, $vectors, ADD>(acc, first, patch, weights),
                    $($count => block::<$vector, $count, $vectors, ADD>(acc, first, patch, weights),)+
                    _ => block::<$vector, $most, $vectors, ADD>(acc, first, patch, weights),
                }
            }
        }
    };
}

blocks!(wide, __m512i, 2, 10, [2, 3, 4, 5, 6, 7, 8, 9]);
blocks!(single, __m512i, 1, 20, [2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19]);
blocks!(half, __m256i, 1, 20, [2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19]);

/// Reads four codes as one number.
///
/// # Safety
/// Four bytes at `at` are readable.
#[inline(always)]
unsafe fn codes(at: *const u8) -> i32 {
    // SAFETY: guaranteed by the caller.
    unsafe { at.cast::<i32>().read_unaligned() }
}

/// Computes `P` pixels against a panel of `N` vectors.
///
/// # Safety
/// The processor has AVX-512; [`Patch::fits`] for `first + P` pixels.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn block<V: Sums, const P: usize, const N: usize, const ADD: bool>(
    acc: *mut i32,
    first: usize,
    patch: &Patch<'_>,
    weights: &[u8],
) -> usize {
    let (stride, acc) = (patch.stride, acc.cast::<V>());
    let mut w = weights.as_ptr().cast::<V>();
    // SAFETY: `fits` bounds every address below.
    unsafe {
        let mut sums = [[V::repeat(0); N]; P];
        if ADD {
            for p in 0..P {
                for v in 0..N {
                    sums[p][v] = acc.add(N * p + v).read_unaligned();
                }
            }
        }
        for &start in patch.starts {
            let mut x = patch.bytes.as_ptr().add(start + first * stride);
            for _ in 0..patch.groups {
                let mut panel = [V::repeat(0); N];
                for v in 0..N {
                    panel[v] = w.add(v).read_unaligned();
                }
                for p in 0..P {
                    let codes = V::repeat(codes(x.add(p * stride)));
                    for v in 0..N {
                        sums[p][v] = sums[p][v].times(codes, panel[v]);
                    }
                }
                x = x.add(4);
                w = w.add(N);
            }
        }
        for p in 0..P {
            for v in 0..N {
                acc.add(N * p + v).write_unaligned(sums[p][v]);
            }
        }
    }
    P
}

/// Computes as many pairs of pixels as are left, up to the number whose sums fit into registers, against a panel of 8 channels; returns the
/// number of pixels. The pixels of a pair are `APART` pixels apart, 1 or 2.
///
/// # Safety
/// The processor has AVX-512; [`Patch::fits`]; at least `2 * APART` pixels are left, and `APART` strides are whole groups.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn paired<const APART: usize, const ADD: bool>(
    acc: *mut i32,
    first: usize,
    left: usize,
    patch: &Patch<'_>,
    weights: &[u8],
) -> usize {
    // SAFETY: guaranteed by the caller.
    unsafe {
        match left / 2 {
            20.. => pairs::<20, APART, ADD>(acc, first, patch, weights),
            10.. => pairs::<10, APART, ADD>(acc, first, patch, weights),
            4.. => pairs::<4, APART, ADD>(acc, first, patch, weights),
            2.. => pairs::<2, APART, ADD>(acc, first, patch, weights),
            _ => pairs::<1, APART, ADD>(acc, first, patch, weights),
        }
    }
}

/// Computes `P` pairs of pixels against a panel of 8 channels.
///
/// # Safety
/// As [`paired`], for `2 * P` pixels, with `P` a multiple of `APART`.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn pairs<const P: usize, const APART: usize, const ADD: bool>(
    acc: *mut i32,
    first: usize,
    patch: &Patch<'_>,
    weights: &[u8],
) -> usize {
    // Pairs begin at `APART` pixels side by side, then behind the pixels that these pairs contain.
    let pixel = |pair: usize| pair / APART * 2 * APART + pair % APART;
    let (stride, acc) = (patch.stride, acc.cast::<__m256i>());
    let behind = APART * stride / 4;
    let mut w = weights.as_ptr().cast::<__m256i>();
    // SAFETY: `fits` bounds every address below: the second pixel's patch begins `behind` groups after the first one's.
    unsafe {
        let mut sums = [_mm512_setzero_si512(); P];
        if ADD {
            for p in 0..P {
                let (one, two) = (acc.add(pixel(p)).read_unaligned(), acc.add(pixel(p) + APART).read_unaligned());
                sums[p] = _mm512_inserti64x4::<1>(_mm512_castsi256_si512(one), two);
            }
        }
        for &start in patch.starts {
            let mut x = patch.bytes.as_ptr().add(start + first * stride);
            for g in 0..patch.groups + behind {
                let of = |g: usize| if g < patch.groups { w.add(g).read_unaligned() } else { _mm256_setzero_si256() };
                // Of a group before the second pixel's first one the number wraps, beyond the last.
                let second = of(g.wrapping_sub(behind));
                let panel = _mm512_inserti64x4::<1>(_mm512_castsi256_si512(of(g)), second);
                for p in 0..P {
                    let codes = _mm512_set1_epi32(codes(x.add(pixel(p) * stride)));
                    sums[p] = _mm512_dpbusd_epi32(sums[p], codes, panel);
                }
                x = x.add(4);
            }
            w = w.add(patch.groups);
        }
        for p in 0..P {
            acc.add(pixel(p)).write_unaligned(_mm512_castsi512_si256(sums[p]));
            acc.add(pixel(p) + APART).write_unaligned(_mm512_extracti64x4_epi64::<1>(sums[p]));
        }
    }
    2 * P
}

/// Computes one pixel against a panel of `N` vectors. An instruction waits four cycles for the sum of the one before it. Therefore there are
/// four sums, and consecutive groups of a row use them in turn.
///
/// # Safety
/// The processor has AVX-512; [`Patch::fits`] for `first + 1` pixels.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn one_pixel<V: Sums, const N: usize, const ADD: bool>(
    acc: *mut i32,
    first: usize,
    patch: &Patch<'_>,
    weights: &[u8],
) -> usize {
    const TURNS: usize = 4;
    let (mut w, acc) = (weights.as_ptr().cast::<V>(), acc.cast::<V>());
    // SAFETY: `fits` bounds every address below.
    unsafe {
        let mut sums = [[V::repeat(0); N]; TURNS];
        for &start in patch.starts {
            let mut x = patch.bytes.as_ptr().add(start + first * patch.stride);
            let mut left = patch.groups;
            while left > 0 {
                for t in 0..TURNS {
                    if t < left {
                        let codes = V::repeat(codes(x.add(4 * t)));
                        for v in 0..N {
                            sums[t][v] = sums[t][v].times(codes, w.add(N * t + v).read_unaligned());
                        }
                    }
                }
                (x, w) = (x.add(4 * left.min(TURNS)), w.add(N * left.min(TURNS)));
                left -= left.min(TURNS);
            }
        }
        for v in 0..N {
            let mut sum = sums[0][v].plus(sums[1][v]).plus(sums[2][v].plus(sums[3][v]));
            if ADD {
                sum = sum.plus(acc.add(v).read_unaligned());
            }
            acc.add(v).write_unaligned(sum);
        }
    }
    1
}
