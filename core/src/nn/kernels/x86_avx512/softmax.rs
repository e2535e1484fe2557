//! Softmax of one query: logits by rows of up to eight keys, then the exponential of 32 keys at a time. Both tables of the exponential fit
//! into registers (`vpermw` reads 32 entries, `vpmulhrsw` is the rounded product).

use crate::nn::kernels::softmax::{LOGIT_LIMIT, MAX_TOKENS, Softmax};
use core::arch::x86_64::*;

/// # Safety
/// The processor has AVX-512.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) unsafe fn exponentials(s: &Softmax<'_>, low: &mut [u8], high: &mut [u8]) -> i64 {
    const LANES: usize = 8;
    let (tokens, width) = (s.tokens, s.width);
    let rows = tokens / width.max(1);
    let fits = width <= LANES
        && tokens <= MAX_TOKENS
        && rows * width == tokens
        && s.bias.len() >= (rows.max(1) - 1) * s.bias_pitch + width
        && low.len() == high.len()
        && low.len().is_multiple_of(4)
        && (tokens..=MAX_TOKENS).contains(&low.len());
    if !fits {
        return s.portable(low, high);
    }
    // Space for the eight lanes of the last row of keys.
    let mut logits = [i32::MIN; MAX_TOKENS + LANES];
    let mask = (0xffu32 >> (LANES - width)) as u8;
    // SAFETY: every address is within the bounds that `fits` has checked, or masked.
    unsafe {
        let multiplier = _mm512_set1_epi64(s.multiplier as i64);
        let half = _mm512_set1_epi64(1 << (s.shift.max(1) - 1));
        let (limit, shift) = (_mm512_set1_epi64(LOGIT_LIMIT), _mm_cvtsi64_si128(s.shift as i64));
        let negative = _mm512_set1_epi64(-LOGIT_LIMIT);
        let mut largest = _mm256_set1_epi32(i32::MIN);
        for row in 0..rows {
            let product = _mm256_maskz_loadu_epi32(mask, s.products.as_ptr().add(row * width));
            let v = _mm512_add_epi64(_mm512_mul_epi32(_mm512_cvtepi32_epi64(product), multiplier), half);
            let v = _mm512_sra_epi64(v, shift);
            let v = _mm512_cvtepi64_epi32(_mm512_min_epi64(_mm512_max_epi64(v, negative), limit));
            let bias = _mm_maskz_loadu_epi16(mask, s.bias.as_ptr().add(row * s.bias_pitch).cast());
            let logit = _mm256_add_epi32(v, _mm256_cvtepi16_epi32(bias));
            _mm256_mask_storeu_epi32(logits.as_mut_ptr().add(row * width), mask, logit);
            largest = _mm256_mask_max_epi32(largest, mask, largest, logit);
        }
        let largest = _mm512_set1_epi32(_mm512_reduce_max_epi32(_mm512_broadcast_i64x4(largest)));
        let coarse = [0, 32].map(|at| _mm512_loadu_si512(s.coarse.as_ptr().add(at).cast()));
        let fine = _mm512_loadu_si512(s.fine.as_ptr().cast());
        let mut sums = _mm512_setzero_si512();
        for first in [0, 32] {
            if first >= low.len() {
                break;
            }
            // From 2048 on the result is 0; distances of missing keys may have wrapped and are masked.
            let near = |at: usize| {
                let distance = _mm512_sub_epi32(largest, _mm512_loadu_si512(logits.as_ptr().add(at).cast()));
                _mm512_cvtepi32_epi16(_mm512_min_epu32(distance, _mm512_set1_epi32(2048)))
            };
            let d = _mm512_inserti64x4::<1>(_mm512_castsi256_si512(near(first)), near(first + 16));
            let steps = _mm512_permutex2var_epi16(coarse[0], _mm512_srli_epi16::<5>(d), coarse[1]);
            let e = _mm512_mulhrs_epi16(steps, _mm512_permutexvar_epi16(d, fine));
            let there = ((1u64 << (tokens.saturating_sub(first)).min(32)) - 1) as u32;
            let kept = _mm512_mask_cmplt_epu16_mask(there, d, _mm512_set1_epi16(2048));
            let e = _mm512_maskz_mov_epi16(kept, e);
            sums = _mm512_add_epi32(sums, _mm512_madd_epi16(e, _mm512_set1_epi16(1)));
            // Stores words, because masked stores of bytes are slow on some processors.
            let words = ((1u32 << ((low.len() - first) / 4).min(8)) - 1) as u8;
            _mm256_mask_storeu_epi32(low.as_mut_ptr().add(first).cast(), words, _mm512_cvtepi16_epi8(e));
            let e = _mm512_cvtepi16_epi8(_mm512_srli_epi16::<8>(e));
            _mm256_mask_storeu_epi32(high.as_mut_ptr().add(first).cast(), words, e);
        }
        _mm512_reduce_add_epi32(sums) as i64
    }
}
