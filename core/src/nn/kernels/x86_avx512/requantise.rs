//! Requantisation: 16 sums at a time, either 16 channels of a pixel or the 8 channels of two pixels.
//!
//! ```text
//! for every vector of 16 channels of the panel:         bias, multipliers in registers
//!     for every pixel (or two):
//!         even, odd = (acc + bias) * multiplier + half  64-bit products of every second lane
//!         [       += added * its multiplier << its shift]
//!         v = even >> shift, odd >> shift, side by side again (with the zero code, which half contains)
//!         cut v to the codes; [count what that has changed]; [look up]; store 16 bytes [and 16 high bytes]
//! ```

use crate::nn::kernels::requantise::{Requantise, Target};
use crate::nn::kernels::{ACCUMULATORS, Accumulators};
use crate::nn::panels::PANEL;
use crate::nn::tensor::{Dtype, Tensor};
use core::arch::x86_64::*;

const LANES: usize = 16;
/// Which results count as cut: none (the table continues with its end values), those above the largest code (a ReLU), or those on both
/// sides.
const NOTHING: u8 = 0;
const ABOVE: u8 = 1;
const BOTH: u8 = 2;

/// # Safety
/// The processor has AVX-512 with VBMI.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512vbmi")]
pub(super) unsafe fn run_vbmi(
    requantise: &Requantise<'_>,
    bytes: &mut [u8],
    acc: &Accumulators,
    target: &Target,
) -> u64 {
    let (mut tables, mut by_register) = ([_mm512_setzero_si512(); 4], false);
    if let Some(table) = requantise.table.filter(|table| table.len() == 256) {
        for (i, part) in tables.iter_mut().enumerate() {
            // SAFETY: four times 64 of 256 bytes.
            *part = unsafe { _mm512_loadu_si512(table.as_ptr().add(64 * i).cast()) };
        }
        by_register = true;
    }
    let look_up = |codes: __m128i| {
        if !by_register {
            return codes;
        }
        let at = _mm512_castsi128_si512(codes);
        let low = _mm512_permutex2var_epi8(tables[0], at, tables[1]);
        let high = _mm512_permutex2var_epi8(tables[2], at, tables[3]);
        _mm512_castsi512_si128(_mm512_mask_blend_epi8(_mm512_movepi8_mask(at), low, high))
    };
    // SAFETY: guaranteed by the caller.
    let cut = unsafe { any(requantise, bytes, acc, target, look_up) };
    cut.unwrap_or_else(|| requantise.portable(bytes, acc, target))
}

/// # Safety
/// The processor has AVX-512.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) unsafe fn run(requantise: &Requantise<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
    // SAFETY: guaranteed by the caller.
    let Some(cut) = (unsafe { any(requantise, bytes, acc, target, |codes| codes) }) else {
        return requantise.portable(bytes, acc, target);
    };
    if let Some(table) = requantise.table {
        let (start, pitch) = target.place(requantise.out, requantise.first);
        for p in 0..target.pixels {
            for code in &mut bytes[start + p * pitch..][..requantise.channels] {
                *code = table[*code as usize & 255];
            }
        }
    }
    cut
}

/// The loop without the parts that an operator does not need. `None` if it cannot compute this operator.
///
/// # Safety
/// The processor has AVX-512.
#[inline(always)]
unsafe fn any(
    requantise: &Requantise<'_>,
    bytes: &mut [u8],
    acc: &Accumulators,
    target: &Target,
    look_up: impl Fn(__m128i) -> __m128i,
) -> Option<u64> {
    // With a shift of up to 53, the zero code can be added before the shift to sums of 2^61, added products of 2^60 and half.
    if requantise.shift > 53 {
        return None;
    }
    let count = match (requantise.ceiling > requantise.hi, requantise.floor < requantise.lo) {
        (true, true) => NOTHING,
        (false, true) => ABOVE,
        _ => BOTH,
    };
    // SAFETY: guaranteed by the caller.
    unsafe {
        match (requantise.add.is_some(), requantise.shift < 32, count) {
            (false, false, NOTHING) => round::<false, false, NOTHING>(requantise, bytes, acc, target, look_up),
            (false, false, ABOVE) => round::<false, false, ABOVE>(requantise, bytes, acc, target, look_up),
            (false, false, _) => round::<false, false, BOTH>(requantise, bytes, acc, target, look_up),
            (false, true, ABOVE) => round::<false, true, ABOVE>(requantise, bytes, acc, target, look_up),
            (false, true, BOTH) => round::<false, true, BOTH>(requantise, bytes, acc, target, look_up),
            (true, false, ABOVE) => round::<true, false, ABOVE>(requantise, bytes, acc, target, look_up),
            (true, false, BOTH) => round::<true, false, BOTH>(requantise, bytes, acc, target, look_up),
            (true, true, ABOVE) => round::<true, true, ABOVE>(requantise, bytes, acc, target, look_up),
            (true, true, BOTH) => round::<true, true, BOTH>(requantise, bytes, acc, target, look_up),
            // No network adds a tensor and maps through a table, or has a table after so short a shift.
            (_, _, _) => None,
        }
    }
}

/// With a shift of 32 or more results have 31 bits. With less (`LONG`) they may have more, and are clamped in 64 bits first.
///
/// # Safety
/// The processor has AVX-512.
#[inline(always)] // Into functions that have the target features.
unsafe fn round<const ADD: bool, const LONG: bool, const COUNT: u8>(
    requantise: &Requantise<'_>,
    bytes: &mut [u8],
    acc: &Accumulators,
    target: &Target,
    look_up: impl Fn(__m128i) -> __m128i,
) -> Option<u64> {
    let out = requantise.out;
    let [(start, pitch), (added_at, added_pitch)] = places(requantise, target, bytes.len())?;
    let at = bytes.as_mut_ptr();
    // SAFETY: the caller has the instructions, here and below.
    unsafe {
        let half = _mm512_set1_epi64(requantise.half + (requantise.zero << requantise.shift));
        let (lo, hi) = (_mm512_set1_epi32(requantise.lo as i32), _mm512_set1_epi32(requantise.hi as i32));
        let shift = _mm_cvtsi64_si128(requantise.shift as i64);
        let odd_shift = if LONG { shift } else { _mm_cvtsi64_si128(requantise.shift as i64 - 32) };
        let add_shift = _mm_cvtsi64_si128(requantise.add_shift as i64);
        // With eight channels a vector holds two pixels.
        let together = if requantise.width == 8 { 2 } else { 1 };
        let (mut cuts, one) = (_mm512_setzero_si512(), _mm512_set1_epi32(1));
        let mut first = 0;
        while first < requantise.channels {
            let channels = (requantise.channels - first).min(LANES / together);
            let mask = ((1u32 << channels) - 1) as u16;
            // Lists have 32 entries and `first` is 0 or 16; `places` and masks bound the other accesses.
            let bias = list(&requantise.bias, first, together);
            let multiplier = list(&requantise.multiplier, first, together);
            let multiplier_odd = _mm512_srli_epi64::<32>(multiplier);
            let add_multiplier = list(&requantise.add_multiplier, first, together);
            let add_multiplier_odd = _mm512_srli_epi64::<32>(add_multiplier);
            let mut p = 0;
            while p < target.pixels {
                let now = (target.pixels - p).min(together);
                let there = if now == 2 { mask | mask << 8 } else { mask };
                let from = acc.as_ptr().add(p * requantise.width + first);
                let v = _mm512_add_epi32(sums(from, together, now), bias);
                let mut even = _mm512_add_epi64(_mm512_mul_epi32(v, multiplier), half);
                let odd = _mm512_srli_epi64::<32>(v);
                let mut odd = _mm512_add_epi64(_mm512_mul_epi32(odd, multiplier_odd), half);
                if let (true, Some(add)) = (ADD, &requantise.add) {
                    let from = at.add(added_at + p * added_pitch + first);
                    let value = values(add, from, added_pitch, mask, now);
                    let product = _mm512_mul_epi32(value, add_multiplier);
                    even = _mm512_add_epi64(even, _mm512_sll_epi64(product, add_shift));
                    let product = _mm512_mul_epi32(_mm512_srli_epi64::<32>(value), add_multiplier_odd);
                    odd = _mm512_add_epi64(odd, _mm512_sll_epi64(product, add_shift));
                }
                let v = join::<LONG>(even, odd, shift, odd_shift);
                let code = _mm512_min_epi32(_mm512_max_epi32(v, lo), hi);
                if COUNT != NOTHING {
                    let cut = match COUNT {
                        ABOVE => _mm512_mask_cmpgt_epi32_mask(there, v, hi),
                        _ => _mm512_mask_cmpneq_epi32_mask(there, v, code),
                    };
                    cuts = _mm512_mask_add_epi32(cuts, cut, cuts, one);
                }
                let to = at.add(start + p * pitch + first);
                store(to, pitch, channels, now, look_up(_mm512_cvtepi32_epi8(code)));
                if out.dtype == Dtype::I16 {
                    store(to.add(out.plane_bytes()), pitch, channels, now, high(code));
                }
                p += together;
            }
            first += LANES;
        }
        Some(_mm512_reduce_add_epi32(cuts) as u64)
    }
}

/// Returns where the output and the added map begin, and bytes from pixel to pixel; `None` if a read or write leaves the slices.
#[inline(always)]
fn places(requantise: &Requantise<'_>, target: &Target, bytes: usize) -> Option<[(usize, usize); 2]> {
    let place = |t: &Tensor| {
        let (at, pitch) = target.place(t, requantise.first);
        let reach = target.pixels.saturating_sub(1) * pitch + requantise.channels;
        (at + reach + (t.dtype.bytes() - 1) * t.plane_bytes() <= bytes).then_some((at, pitch))
    };
    let added = requantise.add.as_ref().map_or(Some((0, 0)), place)?;
    (target.pixels * requantise.width <= ACCUMULATORS).then_some([place(requantise.out)?, added])
}

/// Reads the sums of a pixel, or of two with eight channels each (`together` 2), of which `now` are there. Loads have the size of the matrix
/// product's stores; loads of another size would wait for the cache.
///
/// # Safety
/// The processor has AVX-512; these sums are readable.
#[inline(always)] // Into functions that have the target features.
unsafe fn sums(from: *const i32, together: usize, now: usize) -> __m512i {
    // SAFETY: guaranteed by the caller.
    unsafe {
        if together == 1 {
            return _mm512_loadu_si512(from.cast());
        }
        let next = _mm256_loadu_si256(from.add(8 * (now - 1)).cast());
        _mm512_inserti64x4::<1>(_mm512_castsi256_si512(_mm256_loadu_si256(from.cast())), next)
    }
}

/// Shifts results in 64-bit lanes right, and puts those of even and odd lanes side by side. With `LONG` they are cut to 31 bits, far beyond any
/// code; without, `odd_shift` is 32 less, which moves odd results into the upper half, where they belong.
///
/// # Safety
/// The processor has AVX-512.
#[inline(always)] // Into functions that have the target features.
pub(super) unsafe fn join<const LONG: bool>(
    even: __m512i,
    odd: __m512i,
    shift: __m128i,
    odd_shift: __m128i,
) -> __m512i {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let (mut even, mut odd) = (_mm512_sra_epi64(even, shift), _mm512_sra_epi64(odd, odd_shift));
        if LONG {
            let (top, bottom) = (_mm512_set1_epi64(1 << 30), _mm512_set1_epi64(-(1 << 30)));
            even = _mm512_min_epi64(_mm512_max_epi64(even, bottom), top);
            odd = _mm512_slli_epi64::<32>(_mm512_min_epi64(_mm512_max_epi64(odd, bottom), top));
        }
        _mm512_mask_blend_epi32(0xaaaa, even, odd)
    }
}

/// Returns the high bytes of 16-bit codes, plus 128.
///
/// # Safety
/// The processor has AVX-512.
#[inline(always)] // Into functions that have the target features.
pub(super) unsafe fn high(code: __m512i) -> __m128i {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm512_cvtepi32_epi8(_mm512_add_epi32(_mm512_srai_epi32::<8>(code), _mm512_set1_epi32(128))) }
}

/// Reads constants of 16 lanes.
///
/// # Safety
/// The processor has AVX-512; `first` is 0 or 16.
#[inline(always)] // Into functions that have the target features.
unsafe fn list(values: &[i32; PANEL], first: usize, together: usize) -> __m512i {
    // SAFETY: 16 of 32 entries; the caller has the instructions.
    unsafe {
        let all = _mm512_loadu_si512(values.as_ptr().add(first.min(LANES)).cast());
        if together == 2 { _mm512_shuffle_i64x2::<0b01_00_01_00>(all, all) } else { all }
    }
}

/// Reads the values of the added map for one or two pixels.
///
/// # Safety
/// The processor has AVX-512; bytes are readable where the mask is set.
#[inline(always)] // Into functions that have the target features.
unsafe fn values(add: &Tensor, from: *const u8, pitch: usize, mask: u16, pixels: usize) -> __m512i {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let low = _mm512_cvtepu8_epi32(load(from, pitch, mask, pixels));
        if add.dtype == Dtype::U8 {
            return _mm512_sub_epi32(low, _mm512_set1_epi32(add.zero));
        }
        let high = _mm512_cvtepu8_epi32(load(from.add(add.plane_bytes()), pitch, mask, pixels));
        _mm512_sub_epi32(_mm512_add_epi32(low, _mm512_slli_epi32::<8>(high)), _mm512_set1_epi32(128 * 256))
    }
}

/// # Safety
/// The processor has AVX-512; bytes are readable where the mask is set.
#[inline(always)] // Into functions that have the target features.
unsafe fn load(from: *const u8, pitch: usize, mask: u16, pixels: usize) -> __m128i {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let first = _mm_maskz_loadu_epi8(mask, from.cast());
        if pixels == 1 {
            return first;
        }
        _mm_unpacklo_epi64(first, _mm_maskz_loadu_epi8(mask, from.add(pitch).cast()))
    }
}

/// Stores whole halves and words, because masked stores of bytes are slow on some processors.
///
/// # Safety
/// The processor has AVX-512; `channels` bytes per pixel are writable.
#[inline(always)] // Into functions that have the target features.
unsafe fn store(to: *mut u8, pitch: usize, channels: usize, pixels: usize, codes: __m128i) {
    // SAFETY: guaranteed by the caller.
    unsafe {
        match channels {
            16 => _mm_storeu_si128(to.cast(), codes),
            8 => {
                _mm_storel_epi64(to.cast(), codes);
                if pixels == 2 {
                    _mm_storel_epi64(to.add(pitch).cast(), _mm_unpackhi_epi64(codes, codes));
                }
            }
            12 => {
                _mm_storel_epi64(to.cast(), codes);
                to.add(8).cast::<i32>().write_unaligned(_mm_extract_epi32::<2>(codes));
            }
            _ => {
                let mut bytes = [0u8; 16];
                _mm_storeu_si128(bytes.as_mut_ptr().cast(), codes);
                core::ptr::copy_nonoverlapping(bytes.as_ptr(), to, channels);
                if pixels == 2 {
                    core::ptr::copy_nonoverlapping(bytes.as_ptr().add(8), to.add(pitch), channels);
                }
            }
        }
    }
}
