//! AVX2: `vpmaddwd` multiplies 16 pairs of i16 and adds neighbours into 8 sums of i32. Unlike `vpmaddubsw` it cannot saturate: the
//! only pair sum that leaves i32, two times (-2¹⁵)², wraps like the specification.
//!
//! ```text
//! for two channels c at a time:                    8 vectors of sums stay in registers
//!     for k in steps of 16:                        the last step on a copy filled up with zeros
//!         w    = widen(weights of channel c)       i8 -> i16
//!         sum[c][p] += vpmaddwd(activations of pixel p, w)
//!     add the lanes of every sum
//! ```
#![allow(unsafe_code)]

use super::{Kernel, Le16, PIXELS, Stretches, Sums, Weights};
use core::arch::x86_64::*;

/// For [`super::select`] alone: to run it on a processor without AVX2 is undefined behaviour.
pub(super) const KERNEL: Kernel = Kernel { name: "avx2-i16i8-2x4", group, single, dot };

/// Products per vector.
const STEP: usize = 16;

fn group(sums: &mut Sums, x: Stretches<'_>, w: Weights<'_>) {
    let n = w.iter().fold(usize::MAX, |n, row| n.min(row.len()));
    let n = x.iter().fold(n, |n, row| n.min(row.len()));
    let (x, w) = (x.map(|row| &row[..n]), w.map(|row| &row[..n]));
    for (sums, w) in sums.as_chunks_mut::<2>().0.iter_mut().zip(w.as_chunks::<2>().0) {
        // SAFETY: the processor has the instructions (see `KERNEL`).
        unsafe { block(sums, x, *w) }
    }
}

fn single(sums: &mut [i32; PIXELS], x: Stretches<'_>, w: &[u8]) {
    let n = x.iter().fold(w.len(), |n, row| n.min(row.len()));
    // SAFETY: as in `group`.
    unsafe { block(core::array::from_mut(sums), x.map(|row| &row[..n]), [&w[..n]]) }
}

fn dot(a: &[Le16], b: &[Le16]) -> i32 {
    let n = a.len().min(b.len());
    // SAFETY: as in `group`.
    unsafe { dot_product(&a[..n], &b[..n]) }
}

/// # Safety
/// AVX2.
#[target_feature(enable = "avx2")]
unsafe fn block<const C: usize>(sums: &mut [[i32; PIXELS]; C], x: Stretches<'_>, w: [&[u8]; C]) {
    let mut lanes = [[_mm256_setzero_si256(); PIXELS]; C];
    let n = x[0].len();
    let whole = n / STEP * STEP;
    let (at_x, at_w) = (x.map(<[Le16]>::as_ptr), w.map(<[u8]>::as_ptr));
    let mut k = 0;
    // Plain loops: whatever is called instead of inlined keeps the sums in memory.
    while k < whole {
        let mut load = [_mm256_setzero_si256(); PIXELS];
        for p in 0..PIXELS {
            // SAFETY: all rows have as many samples as the first, and there are `STEP` more from `k` on.
            load[p] = unsafe { _mm256_loadu_si256(at_x[p].add(k).cast()) };
        }
        for c in 0..C {
            // SAFETY: as above.
            let wide = _mm256_cvtepi8_epi16(unsafe { _mm_loadu_si128(at_w[c].add(k).cast()) });
            for p in 0..PIXELS {
                lanes[c][p] = _mm256_add_epi32(lanes[c][p], _mm256_madd_epi16(load[p], wide));
            }
        }
        k += STEP;
    }
    // Rows of a convolution are multiples of eight, so most end here.
    if n - whole == STEP / 2 {
        for c in 0..C {
            // SAFETY: as above, half as many.
            let wide = _mm_cvtepi8_epi16(unsafe { _mm_loadl_epi64(w[c].as_ptr().add(whole).cast()) });
            for p in 0..PIXELS {
                // SAFETY: as above.
                let x = unsafe { _mm_loadu_si128(x[p].as_ptr().add(whole).cast()) };
                lanes[c][p] = _mm256_add_epi32(lanes[c][p], _mm256_zextsi128_si256(_mm_madd_epi16(x, wide)));
            }
        }
    } else if whole < n {
        for c in 0..C {
            let w = filled(&w[c][whole..]);
            // SAFETY: 16 bytes are read from 16.
            let wide = _mm256_cvtepi8_epi16(unsafe { _mm_loadu_si128(w.as_ptr().cast()) });
            for p in 0..PIXELS {
                lanes[c][p] = _mm256_add_epi32(lanes[c][p], _mm256_madd_epi16(load(&filled(&x[p][whole..])), wide));
            }
        }
    }
    for c in 0..C {
        let parts = add_up(lanes[c]);
        for p in 0..PIXELS {
            sums[c][p] = sums[c][p].wrapping_add(parts[p]);
        }
    }
}

/// # Safety
/// AVX2.
#[target_feature(enable = "avx2")]
unsafe fn dot_product(a: &[Le16], b: &[Le16]) -> i32 {
    let mut lanes = _mm256_setzero_si256();
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<STEP>(), b.as_chunks::<STEP>());
    for (a, b) in a.iter().zip(b) {
        lanes = _mm256_add_epi32(lanes, _mm256_madd_epi16(load(a), load(b)));
    }
    if !a_rest.is_empty() {
        let (a, b) = (filled(a_rest), filled(b_rest));
        lanes = _mm256_add_epi32(lanes, _mm256_madd_epi16(load(&a), load(&b)));
    }
    add_up([lanes; PIXELS])[0]
}

#[target_feature(enable = "avx2")]
#[inline]
fn load(samples: &[Le16; STEP]) -> __m256i {
    // SAFETY: 32 bytes are read from 32.
    unsafe { _mm256_loadu_si256(samples.as_ptr().cast()) }
}

/// `rest`, which is shorter than a step, with zeros behind it.
#[inline(always)]
fn filled<T: Copy + Default>(rest: &[T]) -> [T; STEP] {
    let mut out = [T::default(); STEP];
    out.iter_mut().zip(rest).for_each(|(out, v)| *out = *v);
    out
}

/// The sum of the lanes of each of four vectors.
#[target_feature(enable = "avx2")]
#[inline]
fn add_up([a, b, c, d]: [__m256i; PIXELS]) -> [i32; PIXELS] {
    let sums = _mm256_hadd_epi32(_mm256_hadd_epi32(a, b), _mm256_hadd_epi32(c, d));
    let sums = _mm_add_epi32(_mm256_castsi256_si128(sums), _mm256_extracti128_si256::<1>(sums));
    let mut out = [0; PIXELS];
    // SAFETY: 16 bytes are written to 16.
    unsafe { _mm_storeu_si128(out.as_mut_ptr().cast(), sums) };
    out
}
