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
//! A panel of 8 channels uses half vectors (AVX-512VL), of which this hardware does two at a time.
#![allow(unsafe_code)]

use super::{ACCUMULATORS, Accumulators, Isa, Patch};
use crate::nn::ops::finish::{Finish, Target};
use crate::nn::program::{Dtype, Tensor};
use core::arch::x86_64::*;

const NAME: &str = "avx512vnni-u8i8-10x32";

/// AVX-512 F, BW, DQ, VL, VNNI.
struct Avx512;

super::instantiate::instantiate!(Avx512, "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni");

impl Isa for Avx512 {
    #[inline(always)]
    fn gemm(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        if !patch.fits(pixels, weights, width) {
            return;
        }
        let (mut first, at) = (0, acc.as_mut_ptr());
        // SAFETY: the processor has the instructions (see `KERNEL`), and `fits` has bounded every read and write.
        unsafe {
            while first < pixels {
                let left = pixels - first;
                first += match width {
                    32 => wide(at.add(32 * first), first, left, patch, weights),
                    16 => single::<false>(at.add(16 * first), first, left, patch, weights),
                    _ => single::<true>(at.add(8 * first), first, left, patch, weights),
                }
            }
        }
    }

    #[inline(always)]
    fn finish(finish: &Finish<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
        // SAFETY: the processor has the instructions (see `KERNEL`).
        unsafe { round(finish, bytes, acc, target) }
    }
}

/// # Safety
/// AVX-512; [`Patch::fits`].
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn wide(acc: *mut i32, first: usize, left: usize, patch: &Patch<'_>, weights: &[u8]) -> usize {
    // SAFETY: handed on.
    unsafe {
        match left {
            10.. => two_vectors::<10>(acc, first, patch, weights),
            8..10 => two_vectors::<8>(acc, first, patch, weights),
            7 => two_vectors::<7>(acc, first, patch, weights),
            4..7 => two_vectors::<4>(acc, first, patch, weights),
            2..4 => two_vectors::<2>(acc, first, patch, weights),
            _ => two_vectors::<1>(acc, first, patch, weights),
        }
    }
}

/// # Safety
/// AVX-512; [`Patch::fits`].
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn single<const HALF: bool>(
    acc: *mut i32,
    first: usize,
    left: usize,
    patch: &Patch<'_>,
    weights: &[u8],
) -> usize {
    // SAFETY: handed on.
    unsafe {
        match left {
            20.. => one_vector::<20, HALF>(acc, first, patch, weights),
            16..20 => one_vector::<16, HALF>(acc, first, patch, weights),
            10..16 => one_vector::<10, HALF>(acc, first, patch, weights),
            7..10 => one_vector::<7, HALF>(acc, first, patch, weights),
            4..7 => one_vector::<4, HALF>(acc, first, patch, weights),
            2..4 => one_vector::<2, HALF>(acc, first, patch, weights),
            _ => one_vector::<1, HALF>(acc, first, patch, weights),
        }
    }
}

/// Four codes as one number.
///
/// # Safety
/// Four readable bytes.
#[inline(always)]
unsafe fn codes(at: *const u8) -> i32 {
    // SAFETY: as the caller says.
    unsafe { at.cast::<i32>().read_unaligned() }
}

/// # Safety
/// AVX-512; [`Patch::fits`] for `first + P` pixels.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn two_vectors<const P: usize>(acc: *mut i32, first: usize, patch: &Patch<'_>, weights: &[u8]) -> usize {
    let stride = patch.stride;
    let mut w = weights.as_ptr();
    let mut sums = [[_mm512_setzero_si512(); 2]; P];
    // SAFETY: `fits` bounds every address below.
    unsafe {
        for p in 0..P {
            sums[p][0] = _mm512_loadu_si512(acc.add(32 * p).cast());
            sums[p][1] = _mm512_loadu_si512(acc.add(32 * p + 16).cast());
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

/// One vector of 16 channels, or with `HALF` of 8.
///
/// # Safety
/// AVX-512; [`Patch::fits`] for `first + P` pixels.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn one_vector<const P: usize, const HALF: bool>(
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
            for p in 0..P {
                sums[p] = _mm256_loadu_si256(acc.add(8 * p).cast());
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
        for p in 0..P {
            sums[p] = _mm512_loadu_si512(acc.add(16 * p).cast());
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

/// Eight channels at a time in 64-bit lanes; parts of a vector that are not there are masked.
///
/// # Safety
/// AVX-512.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn round(finish: &Finish<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
    let out = finish.out;
    let (start, pitch) = target.place(out, finish.first);
    let (added_at, added_pitch) = finish.add.as_ref().map_or((0, 0), |add| target.place(add, finish.first));
    let reach = target.pixels.saturating_sub(1);
    let end = |t: &Tensor, at: usize, pitch: usize| {
        at + reach * pitch + finish.channels + (t.dtype.bytes() - 1) * t.plane_bytes()
    };
    let inside = target.pixels * finish.width <= ACCUMULATORS
        && end(out, start, pitch) <= bytes.len()
        && finish.add.as_ref().is_none_or(|add| end(add, added_at, added_pitch) <= bytes.len());
    if !inside {
        return 0;
    }
    let at = bytes.as_mut_ptr();
    let (half, zero) = (_mm512_set1_epi64(finish.half), _mm512_set1_epi64(finish.zero));
    let (lo, hi) = (_mm512_set1_epi64(finish.lo), _mm512_set1_epi64(finish.hi));
    let (floor, ceiling) = (_mm512_set1_epi64(finish.floor), _mm512_set1_epi64(finish.ceiling));
    let shift = _mm_cvtsi64_si128(finish.shift as i64);
    let add_shift = _mm_cvtsi64_si128(finish.add_shift as i64);
    let mut cut = 0;
    let mut first = 0;
    while first < finish.channels {
        let mask = (0xffu32 >> (8 - (finish.channels - first).min(8))) as u8;
        // SAFETY: `first` is at most 24, lists have 32 entries; the rest is bounded above and by the mask.
        unsafe {
            let bias = _mm256_loadu_si256(finish.bias.as_ptr().add(first).cast());
            let list = |values: &[i32; super::PANEL]| {
                _mm512_cvtepi32_epi64(_mm256_loadu_si256(values.as_ptr().add(first).cast()))
            };
            let (multiplier, add_multiplier) = (list(&finish.multiplier), list(&finish.add_multiplier));
            for p in 0..target.pixels {
                let sum = _mm256_loadu_si256(acc.as_ptr().add(p * finish.width + first).cast());
                let sum = _mm512_cvtepi32_epi64(_mm256_add_epi32(sum, bias));
                let mut v = _mm512_add_epi64(_mm512_mul_epi32(sum, multiplier), half);
                if let Some(add) = &finish.add {
                    let from = at.add(added_at + p * added_pitch + first);
                    let low = _mm512_cvtepu8_epi64(_mm_maskz_loadu_epi8(mask as u16, from.cast()));
                    let value = if add.dtype == Dtype::U8 {
                        _mm512_sub_epi64(low, _mm512_set1_epi64(add.zero as i64))
                    } else {
                        let high = _mm_maskz_loadu_epi8(mask as u16, from.add(add.plane_bytes()).cast());
                        let high = _mm512_slli_epi64::<8>(_mm512_cvtepu8_epi64(high));
                        _mm512_sub_epi64(_mm512_add_epi64(low, high), _mm512_set1_epi64(128 * 256))
                    };
                    v = _mm512_add_epi64(v, _mm512_sll_epi64(_mm512_mul_epi32(value, add_multiplier), add_shift));
                }
                let v = _mm512_add_epi64(_mm512_sra_epi64(v, shift), zero);
                let over = _mm512_mask_cmpgt_epi64_mask(mask, v, ceiling);
                let under = _mm512_mask_cmplt_epi64_mask(mask, v, floor);
                cut += (over | under).count_ones() as u64;
                let code = _mm512_min_epi64(_mm512_max_epi64(v, lo), hi);
                let to = at.add(start + p * pitch + first);
                _mm_mask_storeu_epi8(to.cast(), mask as u16, _mm512_cvtepi64_epi8(code));
                if out.dtype == Dtype::I16 {
                    let high = _mm512_add_epi64(_mm512_srai_epi64::<8>(code), _mm512_set1_epi64(128));
                    _mm_mask_storeu_epi8(to.add(out.plane_bytes()).cast(), mask as u16, _mm512_cvtepi64_epi8(high));
                }
            }
        }
        first += 8;
    }
    if let Some(table) = finish.table {
        for p in 0..target.pixels {
            for code in &mut bytes[start + p * pitch..][..finish.channels] {
                *code = table[*code as usize & 255];
            }
        }
    }
    cut
}
