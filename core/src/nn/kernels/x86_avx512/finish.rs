//! Requantisation: eight channels at a time in 64-bit lanes, stored as bytes; channels that are not there are masked.
//!
//! ```text
//! for every eight channels of the panel:                bias, multipliers in registers
//!     for every pixel:
//!         v = ((acc + bias) * multiplier + half [+ added * its multiplier << its shift]) >> shift, + zero
//!         count v outside the limits; cut v to the codes; store eight bytes [and eight high bytes]
//! ```

use crate::nn::kernels::{ACCUMULATORS, Accumulators, PANEL};
use crate::nn::ops::finish::{Finish, Target};
use crate::nn::program::{Dtype, Tensor};
use core::arch::x86_64::*;

/// # Safety
/// AVX-512.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) unsafe fn round(finish: &Finish<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
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
            let list =
                |values: &[i32; PANEL]| _mm512_cvtepi32_epi64(_mm256_loadu_si256(values.as_ptr().add(first).cast()));
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
