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
//! A single pixel has several sums instead, each for every fourth group. A panel of 8 channels uses half vectors (AVX-512VL), of which this
//! hardware processes two at a time.
#![allow(unsafe_code)]
// Functions that are called instead of inlined would keep the sums in memory, so these are plain loops.
#![allow(clippy::needless_range_loop)]

mod layer_norm;
mod requantise;
mod softmax;

use super::layer_norm::Job;
use super::requantise::{Requantise, Target};
use super::softmax::Softmax;
use super::{Accumulators, Isa, Patch};
use core::arch::x86_64::*;

/// AVX-512 F, BW, DQ, VL, VNNI. With `VBMI` tables of bytes are read from registers.
pub(crate) struct Avx512<const VBMI: bool>;

impl<const VBMI: bool> Isa for Avx512<VBMI> {
    const NAME: &str = if VBMI { "avx512vbmi-u8i8-10x32" } else { "avx512vnni-u8i8-10x32" };

    #[inline(always)]
    fn gemm(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        // SAFETY: the processor has the instructions (see `nn/dispatch`).
        unsafe { product::<true>(acc, pixels, patch, weights, width) }
    }

    #[inline(always)]
    fn gemm_from_zero(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        // SAFETY: as above.
        unsafe { product::<false>(acc, pixels, patch, weights, width) }
    }

    #[inline(always)]
    fn requantise(requantise: &Requantise<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
        // SAFETY: the processor has the instructions (see `nn/dispatch`).
        unsafe {
            if VBMI {
                requantise::run_vbmi(requantise, bytes, acc, target)
            } else {
                requantise::run(requantise, bytes, acc, target)
            }
        }
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
    // SAFETY: the processor has the instructions, and `fits` has bounded every read and write.
    unsafe {
        while first < pixels {
            let left = pixels - first;
            first += match width {
                32 => wide::<ADD>(at.add(32 * first), first, left, patch, weights),
                16 => single::<false, ADD>(at.add(16 * first), first, left, patch, weights),
                _ => single::<true, ADD>(at.add(8 * first), first, left, patch, weights),
            }
        }
    }
}

/// # Safety
/// The processor has AVX-512; [`Patch::fits`].
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn wide<const ADD: bool>(acc: *mut i32, first: usize, left: usize, patch: &Patch<'_>, weights: &[u8]) -> usize {
    // SAFETY: guaranteed by the caller.
    unsafe {
        match left {
            9 => two_vectors::<9, ADD>(acc, first, patch, weights),
            8 => two_vectors::<8, ADD>(acc, first, patch, weights),
            7 => two_vectors::<7, ADD>(acc, first, patch, weights),
            6 => two_vectors::<6, ADD>(acc, first, patch, weights),
            5 => two_vectors::<5, ADD>(acc, first, patch, weights),
            4 => two_vectors::<4, ADD>(acc, first, patch, weights),
            3 => two_vectors::<3, ADD>(acc, first, patch, weights),
            2 => two_vectors::<2, ADD>(acc, first, patch, weights),
            1 => one_pixel::<2, ADD>(acc, first, patch, weights),
            _ => two_vectors::<10, ADD>(acc, first, patch, weights),
        }
    }
}

/// # Safety
/// The processor has AVX-512; [`Patch::fits`].
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn single<const HALF: bool, const ADD: bool>(
    acc: *mut i32,
    first: usize,
    left: usize,
    patch: &Patch<'_>,
    weights: &[u8],
) -> usize {
    // SAFETY: guaranteed by the caller.
    unsafe {
        match left {
            19 => one_vector::<19, HALF, ADD>(acc, first, patch, weights),
            18 => one_vector::<18, HALF, ADD>(acc, first, patch, weights),
            17 => one_vector::<17, HALF, ADD>(acc, first, patch, weights),
            16 => one_vector::<16, HALF, ADD>(acc, first, patch, weights),
            15 => one_vector::<15, HALF, ADD>(acc, first, patch, weights),
            14 => one_vector::<14, HALF, ADD>(acc, first, patch, weights),
            13 => one_vector::<13, HALF, ADD>(acc, first, patch, weights),
            12 => one_vector::<12, HALF, ADD>(acc, first, patch, weights),
            11 => one_vector::<11, HALF, ADD>(acc, first, patch, weights),
            10 => one_vector::<10, HALF, ADD>(acc, first, patch, weights),
            9 => one_vector::<9, HALF, ADD>(acc, first, patch, weights),
            8 => one_vector::<8, HALF, ADD>(acc, first, patch, weights),
            7 => one_vector::<7, HALF, ADD>(acc, first, patch, weights),
            6 => one_vector::<6, HALF, ADD>(acc, first, patch, weights),
            5 => one_vector::<5, HALF, ADD>(acc, first, patch, weights),
            4 => one_vector::<4, HALF, ADD>(acc, first, patch, weights),
            3 => one_vector::<3, HALF, ADD>(acc, first, patch, weights),
            2 => one_vector::<2, HALF, ADD>(acc, first, patch, weights),
            1 if !HALF => one_pixel::<1, ADD>(acc, first, patch, weights),
            1 => one_vector::<1, HALF, ADD>(acc, first, patch, weights),
            _ => one_vector::<20, HALF, ADD>(acc, first, patch, weights),
        }
    }
}

/// Reads four codes as one number.
///
/// # Safety
/// Four bytes at `at` are readable.
#[inline(always)]
unsafe fn codes(at: *const u8) -> i32 {
    // SAFETY: guaranteed by the caller.
    unsafe { at.cast::<i32>().read_unaligned() }
}

/// # Safety
/// The processor has AVX-512; [`Patch::fits`] for `first + P` pixels.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn two_vectors<const P: usize, const ADD: bool>(
    acc: *mut i32,
    first: usize,
    patch: &Patch<'_>,
    weights: &[u8],
) -> usize {
    let stride = patch.stride;
    let mut w = weights.as_ptr();
    let mut sums = [[_mm512_setzero_si512(); 2]; P];
    // SAFETY: `fits` bounds every address below.
    unsafe {
        if ADD {
            for p in 0..P {
                sums[p][0] = _mm512_loadu_si512(acc.add(32 * p).cast());
                sums[p][1] = _mm512_loadu_si512(acc.add(32 * p + 16).cast());
            }
        }
        for &start in patch.starts {
            let mut x = patch.bytes.as_ptr().add(start + first * stride);
            for _ in 0..patch.groups {
                let (w0, w1) = (_mm512_loadu_si512(w.cast()), _mm512_loadu_si512(w.add(64).cast()));
                for p in 0..P {
                    let codes = _mm512_set1_epi32(codes(x.add(p * stride)));
                    sums[p][0] = _mm512_dpbusd_epi32(sums[p][0], codes, w0);
                    sums[p][1] = _mm512_dpbusd_epi32(sums[p][1], codes, w1);
                }
                x = x.add(4);
                w = w.add(128);
            }
        }
        for p in 0..P {
            _mm512_storeu_si512(acc.add(32 * p).cast(), sums[p][0]);
            _mm512_storeu_si512(acc.add(32 * p + 16).cast(), sums[p][1]);
        }
    }
    P
}

/// Computes with one vector of 16 channels, or with `HALF` of 8.
///
/// # Safety
/// The processor has AVX-512; [`Patch::fits`] for `first + P` pixels.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn one_vector<const P: usize, const HALF: bool, const ADD: bool>(
    acc: *mut i32,
    first: usize,
    patch: &Patch<'_>,
    weights: &[u8],
) -> usize {
    let stride = patch.stride;
    let mut w = weights.as_ptr();
    // SAFETY: `fits` bounds every address below.
    unsafe {
        if HALF {
            let mut sums = [_mm256_setzero_si256(); P];
            if ADD {
                for p in 0..P {
                    sums[p] = _mm256_loadu_si256(acc.add(8 * p).cast());
                }
            }
            for &start in patch.starts {
                let mut x = patch.bytes.as_ptr().add(start + first * stride);
                for _ in 0..patch.groups {
                    let w0 = _mm256_loadu_si256(w.cast());
                    for p in 0..P {
                        sums[p] = _mm256_dpbusd_epi32(sums[p], _mm256_set1_epi32(codes(x.add(p * stride))), w0);
                    }
                    x = x.add(4);
                    w = w.add(32);
                }
            }
            for p in 0..P {
                _mm256_storeu_si256(acc.add(8 * p).cast(), sums[p]);
            }
            return P;
        }
        let mut sums = [_mm512_setzero_si512(); P];
        if ADD {
            for p in 0..P {
                sums[p] = _mm512_loadu_si512(acc.add(16 * p).cast());
            }
        }
        for &start in patch.starts {
            let mut x = patch.bytes.as_ptr().add(start + first * stride);
            for _ in 0..patch.groups {
                let w0 = _mm512_loadu_si512(w.cast());
                for p in 0..P {
                    sums[p] = _mm512_dpbusd_epi32(sums[p], _mm512_set1_epi32(codes(x.add(p * stride))), w0);
                }
                x = x.add(4);
                w = w.add(64);
            }
        }
        for p in 0..P {
            _mm512_storeu_si512(acc.add(16 * p).cast(), sums[p]);
        }
    }
    P
}

/// Computes one pixel against `V` vectors of 16 channels. An instruction waits four cycles for the sum of the one before it. Therefore
/// there are four sums, and consecutive groups use them in turn.
///
/// # Safety
/// The processor has AVX-512; [`Patch::fits`] for `first + 1` pixels.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn one_pixel<const V: usize, const ADD: bool>(
    acc: *mut i32,
    first: usize,
    patch: &Patch<'_>,
    weights: &[u8],
) -> usize {
    const TURNS: usize = 4;
    let mut w = weights.as_ptr();
    let mut sums = [[_mm512_setzero_si512(); V]; TURNS];
    // SAFETY: `fits` bounds every address below.
    unsafe {
        for &start in patch.starts {
            let mut x = patch.bytes.as_ptr().add(start + first * patch.stride);
            for _ in 0..patch.groups / TURNS {
                for t in 0..TURNS {
                    let codes = _mm512_set1_epi32(codes(x.add(4 * t)));
                    for v in 0..V {
                        let w = _mm512_loadu_si512(w.add(64 * (V * t + v)).cast());
                        sums[t][v] = _mm512_dpbusd_epi32(sums[t][v], codes, w);
                    }
                }
                x = x.add(4 * TURNS);
                w = w.add(64 * V * TURNS);
            }
            for _ in 0..patch.groups % TURNS {
                let codes = _mm512_set1_epi32(codes(x));
                for v in 0..V {
                    sums[0][v] = _mm512_dpbusd_epi32(sums[0][v], codes, _mm512_loadu_si512(w.add(64 * v).cast()));
                }
                x = x.add(4);
                w = w.add(64 * V);
            }
        }
        for v in 0..V {
            let to = acc.add(16 * v);
            let pairs = [_mm512_add_epi32(sums[0][v], sums[1][v]), _mm512_add_epi32(sums[2][v], sums[3][v])];
            let mut sum = _mm512_add_epi32(pairs[0], pairs[1]);
            if ADD {
                sum = _mm512_add_epi32(sum, _mm512_loadu_si512(to.cast()));
            }
            _mm512_storeu_si512(to.cast(), sum);
        }
    }
    1
}
