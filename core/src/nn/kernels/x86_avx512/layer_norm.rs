//! Layer norm of 16-bit maps: eight channels at a time in 64-bit lanes.
//!
//! ```text
//! for every pixel:
//!     S, Q = sums of x and x² over its channels
//!     root = 1/√(C·Q − S² + C²ε)                          scalar, quant/rsqrt.rs
//!     for every eight channels:
//!         y = (C·x − S) * root;  v = (y * gain + bias) >> shift, + zero;  count, cut, store
//! ```

use crate::nn::ops::layer_norm::Job;
use crate::quant::rsqrt::ReciprocalRoot;
use core::arch::x86_64::*;

const LANES: usize = 8;

/// # Safety
/// AVX-512.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) unsafe fn pixels(job: &Job<'_, '_>, bytes: &mut [u8], col: usize, pixels: usize) -> u64 {
    let (norm, input, out) = (job.norm, job.input, job.out);
    let (m, part, channels) = (norm.merge, input.channels, out.channels);
    let gains = job.model.constants(norm.gains, 4 * channels);
    let biases = job.model.constants(norm.biases, 8 * channels);
    // Behind the last sample of each row that is read or written.
    let end = (col + pixels) * m * part;
    let fits = part % LANES == 0
        && m * m * part == channels
        && job.rows[0].high != 0
        && (gains.len(), biases.len()) == (4 * channels, 8 * channels)
        && job.rows.iter().all(|row| row.at + row.high + end <= bytes.len())
        && job.to.at + job.to.high + (col + pixels) * channels <= bytes.len();
    if !fits {
        return job.portable(bytes, col, pixels);
    }
    let at = bytes.as_mut_ptr();
    let half = _mm512_set1_epi64(1 << (norm.shift.max(1) - 1));
    let (zero, shift) = (_mm512_set1_epi64(out.zero as i64), _mm_cvtsi64_si128((norm.shift & 63) as i64));
    let (lo, hi) = (_mm512_set1_epi64(out.lo as i64), _mm512_set1_epi64(out.hi as i64));
    let floor = if out.lo == out.zero { _mm512_set1_epi64(i64::MIN) } else { lo };
    let count = _mm512_set1_epi64(channels as i64);
    let (mut cuts, one) = (_mm512_setzero_si512(), _mm512_set1_epi64(1));
    for p in col..col + pixels {
        let (mut sums, mut squares) = (_mm512_setzero_si512(), _mm512_setzero_si512());
        for place in 0..m * m {
            let row = job.rows[place % m];
            let from = row.at + (p * m + place / m) * part;
            for first in (0..part).step_by(LANES) {
                // SAFETY: `fits` bounds every address of this function.
                let x = unsafe { values(at.add(from + first), row.high) };
                sums = _mm512_add_epi64(sums, x);
                squares = _mm512_add_epi64(squares, _mm512_mul_epi32(x, x));
            }
        }
        let (sum, square) = (_mm512_reduce_add_epi64(sums), _mm512_reduce_add_epi64(squares));
        let root = ReciprocalRoot::of(channels as i64 * square - sum * sum + norm.epsilon);
        let (sum, value) = (_mm512_set1_epi64(sum), _mm512_set1_epi64(root.value as i64));
        let root_half = _mm512_set1_epi64((1i64 << root.shift) >> 1);
        let root_shift = _mm_cvtsi64_si128(root.shift as i64);
        for place in 0..m * m {
            let row = job.rows[place % m];
            let from = row.at + (p * m + place / m) * part;
            for first in (0..part).step_by(LANES) {
                let channel = place * part + first;
                // SAFETY: as above.
                unsafe {
                    let x = values(at.add(from + first), row.high);
                    let d = _mm512_sub_epi64(_mm512_mul_epi32(x, count), sum);
                    let y = _mm512_add_epi64(_mm512_mul_epi32(d, value), root_half);
                    let y = _mm512_sra_epi64(y, root_shift);
                    let gain = _mm512_cvtepi32_epi64(_mm256_loadu_si256(gains.as_ptr().add(4 * channel).cast()));
                    let bias = _mm512_loadu_si512(biases.as_ptr().add(8 * channel).cast());
                    let v = _mm512_add_epi64(_mm512_mul_epi32(y, gain), _mm512_add_epi64(bias, half));
                    let v = _mm512_add_epi64(_mm512_sra_epi64(v, shift), zero);
                    let (over, under) = (_mm512_cmpgt_epi64_mask(v, hi), _mm512_cmplt_epi64_mask(v, floor));
                    cuts = _mm512_mask_add_epi64(cuts, over | under, cuts, one);
                    let code = _mm512_min_epi64(_mm512_max_epi64(v, lo), hi);
                    let to = at.add(job.to.at + p * channels + channel);
                    _mm_storel_epi64(to.cast(), _mm512_cvtepi64_epi8(code));
                    if job.to.high != 0 {
                        let high = _mm512_add_epi64(_mm512_srai_epi64::<8>(code), _mm512_set1_epi64(128));
                        _mm_storel_epi64(to.add(job.to.high).cast(), _mm512_cvtepi64_epi8(high));
                    }
                }
            }
        }
    }
    _mm512_reduce_add_epi64(cuts) as u64
}

/// Eight 16-bit samples from their two planes.
///
/// # Safety
/// AVX-512; eight readable bytes at `low` and at `low + high`.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn values(low: *const u8, high: usize) -> __m512i {
    // SAFETY: as the caller says.
    let (low, high) = unsafe { (_mm_loadl_epi64(low.cast()), _mm_loadl_epi64(low.add(high).cast())) };
    let high = _mm512_slli_epi64::<8>(_mm512_cvtepu8_epi64(high));
    _mm512_sub_epi64(_mm512_add_epi64(_mm512_cvtepu8_epi64(low), high), _mm512_set1_epi64(128 * 256))
}
