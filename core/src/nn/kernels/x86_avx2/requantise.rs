//! Requantisation for AVX2 and AVX-VNNI: eight channels at a time, with the constants of a vector for all pixels in registers.
//!
//! ```text
//! for every vector of 8 channels of the panel, for every pixel:
//!     even, odd = (acc + bias) * multiplier + half      64-bit products of every second lane; half contains the zero code
//!     [       += (added << its shift) * its multiplier]
//!     v = the upper halves of both, side by side, >> (shift - 32); below 32 both >> shift and cut to 31 bits
//!     cut v to the codes; count what is outside the limits; [look up]; store 8 bytes [and 8 high bytes]
//! ```

use crate::nn::kernels::requantise::{Requantise, Target, narrow};
use crate::nn::kernels::{ACCUMULATORS, Accumulators};
use crate::nn::panels::PANEL;
use crate::nn::tensor::{Dtype, Tensor};
use crate::quant::lut::CODE_TABLE_LEN;
use core::arch::x86_64::*;

const LANES: usize = 8;

/// Returns how many results were cut; `None`, without a change, for what [`Requantise::portable`] must compute.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
pub(in crate::nn::kernels) unsafe fn run(
    requantise: &Requantise<'_>,
    bytes: &mut [u8],
    acc: &Accumulators,
    target: &Target,
) -> Option<u64> {
    let job = Job::new(requantise, bytes, acc, target)?;
    let (long, wide) = (requantise.shift < 32, requantise.out.dtype == Dtype::I16);
    // SAFETY: guaranteed by the caller; `Job::new` has bounded every read and write.
    unsafe {
        Some(match (requantise.add.map(|add| add.dtype), long, wide) {
            (None, false, false) => pixels::<0, false, false>(&job),
            (None, false, true) => pixels::<0, false, true>(&job),
            (None, true, false) => pixels::<0, true, false>(&job),
            (None, true, true) => pixels::<0, true, true>(&job),
            (Some(Dtype::U8), false, false) => pixels::<1, false, false>(&job),
            (Some(Dtype::U8), false, true) => pixels::<1, false, true>(&job),
            (Some(Dtype::U8), true, false) => pixels::<1, true, false>(&job),
            (Some(Dtype::U8), true, true) => pixels::<1, true, true>(&job),
            (_, false, false) => pixels::<2, false, false>(&job),
            (_, false, true) => pixels::<2, false, true>(&job),
            (_, true, false) => pixels::<2, true, false>(&job),
            (_, true, true) => pixels::<2, true, true>(&job),
        })
    }
}

/// A block of sums with the places of its codes.
struct Job<'a> {
    requantise: &'a Requantise<'a>,
    table: Option<&'a [u8; CODE_TABLE_LEN]>,
    acc: *const i32,
    bytes: *mut u8,
    pixels: usize,
    /// First byte of the output and bytes from pixel to pixel; the same of the added map.
    to: (usize, usize),
    added: (usize, usize),
}

impl<'a> Job<'a> {
    /// Returns `None` if an access would leave the slices, or if this file cannot compute the operator. Whole vectors of the added map are
    /// read, also behind its last channel.
    #[inline(always)]
    fn new(requantise: &'a Requantise<'a>, bytes: &mut [u8], acc: &'a Accumulators, target: &Target) -> Option<Self> {
        let channels = requantise.channels.next_multiple_of(LANES);
        let place = |t: &Tensor, channels: usize| {
            let (at, pitch) = target.place(t, requantise.first);
            let reach = target.pixels.saturating_sub(1) * pitch + channels + (t.dtype.bytes() - 1) * t.plane_bytes();
            (t.dtype != Dtype::F32 && at + reach <= bytes.len()).then_some((at, pitch))
        };
        let added = requantise.add.as_ref().map_or(Some((0, 0)), |t| place(t, channels))?;
        let to = place(requantise.out, requantise.channels)?;
        let table = requantise.table.and_then(|table| table.first_chunk());
        // With a shift of up to 53, the zero code can be added before the shift to sums of 2^61, added products of 2^60 and half.
        let fits = channels <= requantise.width.min(PANEL)
            && target.pixels * requantise.width <= ACCUMULATORS
            && (1..=53).contains(&requantise.shift)
            && (table.is_none() || requantise.out.dtype == Dtype::U8);
        let (acc, pixels) = (acc.as_ptr(), target.pixels);
        fits.then_some(Self { requantise, table, acc, bytes: bytes.as_mut_ptr(), pixels, to, added })
    }
}

/// Rounds all pixels; returns how many results were cut. `ADD` is the number of bytes of an added sample. With `LONG` the shift
/// is below 32. With `WIDE` codes have two bytes.
///
/// # Safety
/// The processor has AVX2; [`Job::new`].
#[target_feature(enable = "avx2")]
unsafe fn pixels<const ADD: u8, const LONG: bool, const WIDE: bool>(job: &Job<'_>) -> u64 {
    let r = job.requantise;
    // Sums are below 2^62: with that added, a logical shift serves as an arithmetic one, which AVX2 does not have for 64 bits.
    let offset = if LONG { 1i64 << 62 } else { 0 };
    let half = _mm256_set1_epi64x(r.half + (r.zero << r.shift) + offset);
    let offset = _mm256_set1_epi64x(offset >> r.shift);
    let (lo, hi) = (_mm256_set1_epi32(narrow(r.lo)), _mm256_set1_epi32(narrow(r.hi)));
    let (floor, ceiling) = (_mm256_set1_epi32(narrow(r.floor)), _mm256_set1_epi32(narrow(r.ceiling)));
    let (shift, add_shift) = (_mm_cvtsi32_si128(r.shift as i32 & 31), _mm_cvtsi32_si128(r.add_shift as i32 & 31));
    let (add_zero, add_plane) = r.add.as_ref().map_or((0, 0), |t| (t.zero, t.plane_bytes()));
    let add_zero = _mm256_set1_epi32(if ADD == 1 { add_zero } else { 128 << 8 });
    let out_plane = r.out.plane_bytes();
    let lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
    let mut cut = 0;
    for first in (0..r.channels).step_by(LANES) {
        let channels = (r.channels - first).min(LANES);
        // SAFETY: `Job::new` has bounded every address; lists have `PANEL` entries.
        unsafe {
            let list = |values: &[i32; PANEL]| _mm256_loadu_si256(values.as_ptr().add(first).cast());
            let (bias, even, add_even) = (list(&r.bias), list(&r.multiplier), list(&r.add_multiplier));
            let (odd, add_odd) = (_mm256_srli_epi64::<32>(even), _mm256_srli_epi64::<32>(add_even));
            let mut cuts = _mm256_setzero_si256();
            let (mut acc, mut to) = (job.acc.add(first), job.bytes.add(job.to.0 + first));
            let mut from = job.bytes.cast_const().wrapping_add(job.added.0 + first);
            for _ in 0..job.pixels {
                let v = _mm256_add_epi32(_mm256_loadu_si256(acc.cast()), bias);
                let mut low = _mm256_add_epi64(_mm256_mul_epi32(v, even), half);
                let mut high = _mm256_add_epi64(_mm256_mul_epi32(_mm256_srli_epi64::<32>(v), odd), half);
                if ADD > 0 {
                    let mut x = _mm256_cvtepu8_epi32(_mm_loadl_epi64(from.cast()));
                    if ADD == 2 {
                        let upper = _mm256_cvtepu8_epi32(_mm_loadl_epi64(from.add(add_plane).cast()));
                        x = _mm256_add_epi32(x, _mm256_slli_epi32::<8>(upper));
                    }
                    let x = _mm256_sll_epi32(_mm256_sub_epi32(x, add_zero), add_shift);
                    low = _mm256_add_epi64(low, _mm256_mul_epi32(x, add_even));
                    high = _mm256_add_epi64(high, _mm256_mul_epi32(_mm256_srli_epi64::<32>(x), add_odd));
                    from = from.wrapping_add(job.added.1);
                }
                let v = shifted::<LONG>(low, high, shift, offset);
                cuts = _mm256_sub_epi32(cuts, _mm256_cmpgt_epi32(v, ceiling));
                cuts = _mm256_sub_epi32(cuts, _mm256_cmpgt_epi32(floor, v));
                let codes = split(_mm256_min_epi32(_mm256_max_epi32(v, lo), hi));
                let low = _mm_cvtsi128_si64(codes) as u64;
                match job.table {
                    Some(table) => look_up(to, low, table, channels),
                    None => store(to, low, channels),
                }
                if WIDE {
                    store(to.wrapping_add(out_plane), _mm_extract_epi64::<1>(codes) as u64, channels);
                }
                (acc, to) = (acc.wrapping_add(r.width), to.wrapping_add(job.to.1));
            }
            // Lanes behind the last channel do not count.
            let there = _mm256_cmpgt_epi32(_mm256_set1_epi32(channels as i32), lane);
            let mut counts = [0u32; LANES];
            _mm256_storeu_si256(counts.as_mut_ptr().cast(), _mm256_and_si256(cuts, there));
            cut += counts.iter().map(|&count| count as u64).sum::<u64>();
        }
    }
    cut
}

/// Returns the numbers of even and odd lanes, shifted, side by side. With `LONG` they contain what `offset` is after the shift; else the shift is 32
/// more.
#[inline]
#[target_feature(enable = "avx2")]
fn shifted<const LONG: bool>(low: __m256i, high: __m256i, shift: __m128i, offset: __m256i) -> __m256i {
    if LONG {
        let low = limit(_mm256_sub_epi64(_mm256_srl_epi64(low, shift), offset));
        let high = limit(_mm256_sub_epi64(_mm256_srl_epi64(high, shift), offset));
        return _mm256_blend_epi32::<0b1010_1010>(low, _mm256_slli_epi64::<32>(high));
    }
    _mm256_sra_epi32(_mm256_blend_epi32::<0b1010_1010>(_mm256_srli_epi64::<32>(low), high), shift)
}

/// Cuts numbers to 31 bits, far beyond any code.
#[inline]
#[target_feature(enable = "avx2")]
fn limit(v: __m256i) -> __m256i {
    let (top, bottom) = (_mm256_set1_epi64x(1 << 30), _mm256_set1_epi64x(-(1 << 30)));
    let v = _mm256_blendv_epi8(v, top, _mm256_cmpgt_epi64(v, top));
    _mm256_blendv_epi8(v, bottom, _mm256_cmpgt_epi64(bottom, v))
}

/// Returns the low bytes of eight codes, then their high bytes plus 128.
#[inline]
#[target_feature(enable = "avx2")]
fn split(codes: __m256i) -> __m128i {
    let order = _mm_setr_epi8(0, 4, 8, 12, 1, 5, 9, 13, -1, -1, -1, -1, -1, -1, -1, -1);
    let bytes = _mm256_shuffle_epi8(codes, _mm256_broadcastsi128_si256(order));
    let both = _mm_unpacklo_epi32(_mm256_castsi256_si128(bytes), _mm256_extracti128_si256::<1>(bytes));
    _mm_xor_si128(both, _mm_set_epi64x(i64::from_ne_bytes([0x80; 8]), 0))
}

/// Stores the first `channels` codes.
///
/// # Safety
/// `channels` bytes, at most eight, are writable at `to`.
#[inline(always)]
unsafe fn store(to: *mut u8, codes: u64, channels: usize) {
    // SAFETY: guaranteed by the caller.
    unsafe {
        match channels {
            LANES => to.cast::<u64>().write_unaligned(codes),
            4 => to.cast::<u32>().write_unaligned(codes as u32),
            _ => core::ptr::copy_nonoverlapping(codes.to_le_bytes().as_ptr(), to, channels),
        }
    }
}

/// Maps the first `channels` codes through a table and stores them.
///
/// # Safety
/// As [`store`].
#[inline(always)]
unsafe fn look_up(to: *mut u8, codes: u64, table: &[u8; CODE_TABLE_LEN], channels: usize) {
    let mapped = |k: usize| table[(codes >> (8 * k)) as usize & 255];
    // SAFETY: guaranteed by the caller.
    unsafe {
        if channels == LANES {
            for k in 0..LANES {
                *to.add(k) = mapped(k);
            }
        } else {
            for k in 0..channels {
                *to.add(k) = mapped(k);
            }
        }
    }
}
