//! AVX-512 with VNNI: `vpdpwssd` multiplies 32 pairs of i16 and adds them, two by two, to 16 sums of i32, modulo 2³² like the
//! specification.
//!
//! ```text
//! for four channels c, then the other four:        16 vectors of sums stay in registers
//!     for k in steps of 32:                        the last step masked: what is beyond the end reads as 0
//!         x[p] = load(activations of pixel p)      p = 0..4
//!         w    = widen(weights of channel c)       i8 -> i16
//!         sum[c][p] = vpdpwssd(sum[c][p], x[p], w)
//!     add the lanes of every sum
//! ```
#![allow(unsafe_code)]

use super::{CHANNEL_GROUP, Kernel, Le16, PIXELS, Stretches, Sums, Weights};
use core::arch::x86_64::*;

/// For [`super::select`] alone: to run it on a processor without AVX-512 F, BW, VL and VNNI is undefined behaviour.
pub(super) const KERNEL: Kernel = Kernel { name: "avx512vnni-i16i8-4x4", group, single, dot };

/// Products per vector.
const STEP: usize = 32;

fn group(sums: &mut Sums, x: Stretches<'_>, w: Weights<'_>) {
    let n = w.iter().fold(usize::MAX, |n, row| n.min(row.len()));
    let n = x.iter().fold(n, |n, row| n.min(row.len()));
    let (low, high) = sums.split_at_mut(CHANNEL_GROUP / 2);
    let x = x.map(<[Le16]>::as_ptr);
    // SAFETY: the processor has the instructions (see `KERNEL`), and every pointer is good for `n` samples.
    unsafe {
        block::<4>(low, n, x, core::array::from_fn(|c| w[c].as_ptr()));
        block::<4>(high, n, x, core::array::from_fn(|c| w[4 + c].as_ptr()));
    }
}

fn single(sums: &mut [i32; PIXELS], x: Stretches<'_>, w: &[u8]) {
    let n = x.iter().fold(w.len(), |n, row| n.min(row.len()));
    // SAFETY: as in `group`.
    unsafe { block::<1>(core::slice::from_mut(sums), n, x.map(<[Le16]>::as_ptr), [w.as_ptr()]) }
}

fn dot(a: &[Le16], b: &[Le16]) -> i32 {
    // SAFETY: as in `group`.
    unsafe { dot_product(a.len().min(b.len()), a.as_ptr(), b.as_ptr()) }
}

/// # Safety
/// AVX-512 F, BW, VL and VNNI; all pointers good for `n` samples.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vnni")]
unsafe fn block<const C: usize>(sums: &mut [[i32; PIXELS]], n: usize, x: [*const Le16; PIXELS], w: [*const u8; C]) {
    let mut lanes = [[_mm512_setzero_si512(); PIXELS]; C];
    let mut k = 0;
    while k < n {
        let mask = mask(n - k);
        let mut load = [_mm512_setzero_si512(); PIXELS];
        for p in 0..PIXELS {
            // SAFETY: lanes beyond `n` are masked, and masked lanes are not touched.
            load[p] = unsafe { _mm512_maskz_loadu_epi16(mask, x[p].add(k).cast()) };
        }
        for c in 0..C {
            // SAFETY: as above.
            let bytes = unsafe { _mm256_maskz_loadu_epi8(mask, w[c].add(k).cast()) };
            let wide = _mm512_cvtepi8_epi16(bytes);
            for p in 0..PIXELS {
                lanes[c][p] = _mm512_dpwssd_epi32(lanes[c][p], load[p], wide);
            }
        }
        k += STEP;
    }
    for (sums, lanes) in sums.iter_mut().zip(lanes) {
        for (sum, part) in sums.iter_mut().zip(add_up(lanes)) {
            *sum = sum.wrapping_add(part);
        }
    }
}

/// # Safety
/// As [`block`].
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vnni")]
unsafe fn dot_product(n: usize, a: *const Le16, b: *const Le16) -> i32 {
    let mut lanes = _mm512_setzero_si512();
    let mut k = 0;
    while k < n {
        let mask = mask(n - k);
        // SAFETY: lanes beyond `n` are masked, and masked lanes are not touched.
        let (a, b) = unsafe {
            (_mm512_maskz_loadu_epi16(mask, a.add(k).cast()), _mm512_maskz_loadu_epi16(mask, b.add(k).cast()))
        };
        lanes = _mm512_dpwssd_epi32(lanes, a, b);
        k += STEP;
    }
    _mm512_reduce_add_epi32(lanes)
}

/// One bit per sample that is left, at most [`STEP`].
#[inline(always)]
fn mask(left: usize) -> u32 {
    if left >= STEP { u32::MAX } else { (1 << left) - 1 }
}

/// The sum of the lanes of each of four vectors.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn add_up([a, b, c, d]: [__m512i; PIXELS]) -> [i32; PIXELS] {
    let sums = _mm256_hadd_epi32(_mm256_hadd_epi32(halves(a), halves(b)), _mm256_hadd_epi32(halves(c), halves(d)));
    let sums = _mm_add_epi32(_mm256_castsi256_si128(sums), _mm256_extracti128_si256::<1>(sums));
    let mut out = [0; PIXELS];
    // SAFETY: 16 bytes are written to 16.
    unsafe { _mm_storeu_si128(out.as_mut_ptr().cast(), sums) };
    out
}

/// Lower plus upper half.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn halves(v: __m512i) -> __m256i {
    _mm256_add_epi32(_mm512_castsi512_si256(v), _mm512_extracti64x4_epi64::<1>(v))
}
