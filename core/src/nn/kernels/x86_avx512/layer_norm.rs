//! Layer norm of 16-bit maps: sixteen channels at a time, products in the even and the odd 64-bit lanes.
//!
//! ```text
//! for every pixel:
//!     S, Q = sums of x and x² over its channels
//!     root = 1/√(C·Q − S² + C²ε)                          scalar, quant/rsqrt.rs
//! for every sixteen channels:                             gains, biases in registers
//!     for every pixel:
//!         y = (C·x − S) * root;  v = (y * gain + bias) >> shift, + zero;  count, cut, store
//! ```

use super::requantise::{high, join};
use crate::nn::kernels::layer_norm::{Job, PIXELS};
use crate::quant::rsqrt::ReciprocalRoot;
use core::arch::x86_64::*;

const LANES: usize = 16;

/// # Safety
/// AVX-512.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) unsafe fn pixels(job: &Job<'_>, bytes: &mut [u8], col: usize, pixels: usize) -> u64 {
    let (input, out) = (job.input, job.out);
    let (m, part, channels) = (job.merge, input.channels, out.channels);
    let (gains, biases) = (job.gains, job.biases);
    if !fits(job, bytes.len(), col, pixels) {
        return job.portable(bytes, col, pixels);
    }
    let at = bytes.as_mut_ptr();
    // SAFETY: `fits` bounds every address of this function.
    let (sums, roots) = unsafe { roots(job, at, col, pixels) };
    let half = _mm512_set1_epi64(1 << (job.shift.max(1) - 1));
    let shift = _mm_cvtsi64_si128((job.shift & 63) as i64);
    let (zero, count) = (_mm512_set1_epi32(out.zero), _mm512_set1_epi32(channels as i32));
    let (lo, hi) = (_mm512_set1_epi32(out.lo), _mm512_set1_epi32(out.hi));
    let floor = if out.lo == out.zero { _mm512_set1_epi32(i32::MIN) } else { lo };
    let (mut cuts, one) = (_mm512_setzero_si512(), _mm512_set1_epi32(1));
    for place in 0..m * m {
        let row = job.rows[place % m];
        for first in (0..part).step_by(LANES) {
            let (channel, lanes) = (place * part + first, (part - first).min(LANES));
            let mask = (0xffffu32 >> (LANES - lanes)) as u16;
            // SAFETY: as above; lanes behind the last channel are masked.
            unsafe {
                let gain = _mm512_maskz_loadu_epi32(mask, gains.as_ptr().add(4 * channel).cast());
                let gain_odd = _mm512_srli_epi64::<32>(gain);
                let bias = biases.as_ptr().add(8 * channel).cast::<i64>();
                let upper = _mm512_maskz_loadu_epi64((mask >> 8) as u8, bias.wrapping_add(8));
                let bias = _mm512_loadu_si512(bias.cast());
                let even = _mm512_setr_epi64(0, 2, 4, 6, 8, 10, 12, 14);
                let odd = _mm512_setr_epi64(1, 3, 5, 7, 9, 11, 13, 15);
                let bias_even = _mm512_add_epi64(_mm512_permutex2var_epi64(bias, even, upper), half);
                let bias_odd = _mm512_add_epi64(_mm512_permutex2var_epi64(bias, odd, upper), half);
                for p in 0..pixels {
                    let from = at.add(row.at + ((col + p) * m + place / m) * part + first);
                    let x = _mm512_cvtepi16_epi32(values(from, row.high, mask));
                    let d = _mm512_sub_epi32(_mm512_mullo_epi32(x, count), _mm512_set1_epi32(sums[p]));
                    let root = _mm512_set1_epi64(roots[p].value as i64);
                    let root_half = _mm512_set1_epi64((1i64 << roots[p].shift) >> 1);
                    let root_shift = _mm_cvtsi64_si128(roots[p].shift as i64);
                    let y = _mm512_add_epi64(_mm512_mul_epi32(d, root), root_half);
                    let y = _mm512_sra_epi64(y, root_shift);
                    let y_odd = _mm512_mul_epi32(_mm512_srli_epi64::<32>(d), root);
                    let y_odd = _mm512_sra_epi64(_mm512_add_epi64(y_odd, root_half), root_shift);
                    let v = _mm512_add_epi64(_mm512_mul_epi32(y, gain), bias_even);
                    let v_odd = _mm512_add_epi64(_mm512_mul_epi32(y_odd, gain_odd), bias_odd);
                    let v = _mm512_add_epi32(join::<true>(v, v_odd, shift, shift), zero);
                    let over = _mm512_mask_cmpgt_epi32_mask(mask, v, hi);
                    let under = _mm512_mask_cmplt_epi32_mask(mask, v, floor);
                    cuts = _mm512_mask_add_epi32(cuts, over | under, cuts, one);
                    let code = _mm512_min_epi32(_mm512_max_epi32(v, lo), hi);
                    let to = at.add(job.to.at + (col + p) * channels + channel);
                    store(to, lanes, _mm512_cvtepi32_epi8(code));
                    if job.to.high != 0 {
                        store(to.add(job.to.high), lanes, high(code));
                    }
                }
            }
        }
    }
    _mm512_reduce_add_epi32(cuts) as u64
}

/// Returns whether this file computes the job, and all its reads and writes stay within `bytes` bytes.
#[inline(always)]
fn fits(job: &Job<'_>, bytes: usize, col: usize, pixels: usize) -> bool {
    let (m, part, channels) = (job.merge, job.input.channels, job.out.channels);
    // End of the samples of each row that are read or written.
    let end = (col + pixels) * m * part;
    part % 8 == 0
        && pixels <= PIXELS
        && m * m * part == channels
        && job.rows[0].high != 0
        && (job.gains.len(), job.biases.len()) == (4 * channels, 8 * channels)
        && job.rows.iter().all(|row| row.at + row.high + end <= bytes)
        && job.to.at + job.to.high + (col + pixels) * channels <= bytes
}

/// Returns S and the root of every pixel.
///
/// # Safety
/// The processor has AVX-512; [`fits`].
#[inline(always)]
unsafe fn roots(job: &Job<'_>, at: *const u8, col: usize, pixels: usize) -> ([i32; PIXELS], [ReciprocalRoot; PIXELS]) {
    let (mut sums, mut roots) = ([0i32; PIXELS], [ReciprocalRoot::of(1); PIXELS]);
    for p in 0..pixels {
        // SAFETY: guaranteed by the caller.
        let (sum, square) = unsafe { statistics(job, at, col + p) };
        sums[p] = sum;
        let sum = sum as i64;
        roots[p] = ReciprocalRoot::of(job.out.channels as i64 * square - sum * sum + job.epsilon);
    }
    (sums, roots)
}

/// Returns the sum of a pixel's samples, at most 8192 of them, and the sum of their squares.
///
/// # Safety
/// The processor has AVX-512; the pixel's samples are readable.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn statistics(job: &Job<'_>, at: *const u8, col: usize) -> (i32, i64) {
    let (m, part) = (job.merge, job.input.channels);
    let (mut sums, mut squares) = (_mm256_setzero_si256(), _mm512_setzero_si512());
    for place in 0..m * m {
        let row = job.rows[place % m];
        for first in (0..part).step_by(LANES) {
            let mask = (0xffffu32 >> (LANES - (part - first).min(LANES))) as u16;
            // SAFETY: guaranteed by the caller.
            let x = unsafe { values(at.add(row.at + (col * m + place / m) * part + first), row.high, mask) };
            sums = _mm256_add_epi32(sums, _mm256_madd_epi16(x, _mm256_set1_epi16(1)));
            // The sum of two squares of 15 bits fits into an i32.
            squares = _mm512_add_epi64(squares, _mm512_cvtepu32_epi64(_mm256_madd_epi16(x, x)));
        }
    }
    (_mm512_reduce_add_epi32(_mm512_zextsi256_si512(sums)), _mm512_reduce_add_epi64(squares))
}

/// Reads sixteen or eight 16-bit samples from their two planes, as the mask says; the rest is 0.
///
/// # Safety
/// The processor has AVX-512; the bytes at `low` and at `low + high` are readable where the mask is set.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn values(low: *const u8, high: usize, mask: u16) -> __m256i {
    // SAFETY: guaranteed by the caller.
    let (low, high) =
        unsafe { (_mm_maskz_loadu_epi8(mask, low.cast()), _mm_maskz_loadu_epi8(mask, low.add(high).cast())) };
    let high = _mm256_slli_epi16::<8>(_mm256_cvtepu8_epi16(high));
    let joined = _mm256_or_si256(_mm256_cvtepu8_epi16(low), high);
    _mm256_maskz_mov_epi16(mask, _mm256_xor_si256(joined, _mm256_set1_epi16(i16::MIN)))
}

/// Stores sixteen or eight bytes.
///
/// # Safety
/// The processor has AVX-512; as many bytes are writable.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn store(to: *mut u8, lanes: usize, codes: __m128i) {
    // SAFETY: guaranteed by the caller.
    unsafe { if lanes == LANES { _mm_storeu_si128(to.cast(), codes) } else { _mm_storel_epi64(to.cast(), codes) } }
}
