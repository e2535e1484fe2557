//! Requantisation: 16 sums at a time, either 16 channels of a pixel or 8 channels of two pixels.
//!
//! ```text
//! for every vector of 16 channels of the panel:         bias, multipliers in registers
//!     for every pixel (or two):
//!         even, odd = (acc + bias) * multiplier + half  64-bit products of every second lane
//!         [       += added * its multiplier << its shift]
//!         v = even >> shift, odd >> shift, side by side again (with the zero code, which half contains)
//!         cut v to the codes; [count what that has changed]; [look up]; store 16 bytes [and 16 high bytes]
//! ```
//! Everything that is the same for all pixels of a vector is a constant for the compiler, so that the loop has no branch.

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
/// The processor has AVX-512, with VBMI if `VBMI`.
#[inline(always)]
pub(super) unsafe fn run<const VBMI: bool>(
    requantise: &Requantise<'_>,
    bytes: &mut [u8],
    acc: &Accumulators,
    target: &Target,
) -> u64 {
    // SAFETY: guaranteed by the caller.
    unsafe { Job::new(requantise, bytes, acc, target).and_then(|job| job.run::<VBMI>()) }
        .unwrap_or_else(|| requantise.portable(bytes, acc, target))
}

/// A block of sums with the places of its codes.
struct Job<'a> {
    requantise: &'a Requantise<'a>,
    acc: &'a Accumulators,
    bytes: *mut u8,
    pixels: usize,
    /// First byte of the output and bytes from pixel to pixel; the same of the added map.
    to: (usize, usize),
    added: (usize, usize),
    /// Which results count as cut.
    count: u8,
}

impl<'a> Job<'a> {
    /// Returns `None` if a read or write would leave the slices, or if this file cannot compute the operator.
    #[inline(always)]
    fn new(requantise: &'a Requantise<'a>, bytes: &mut [u8], acc: &'a Accumulators, target: &Target) -> Option<Self> {
        let place = |t: &Tensor| {
            let (at, pitch) = target.place(t, requantise.first);
            let reach = target.pixels.saturating_sub(1) * pitch + requantise.channels;
            (at + reach + (t.dtype.bytes() - 1) * t.plane_bytes() <= bytes.len()).then_some((at, pitch))
        };
        let added = requantise.add.as_ref().map_or(Some((0, 0)), place)?;
        let to = place(requantise.out)?;
        let count = match (requantise.ceiling > requantise.hi, requantise.floor < requantise.lo) {
            (true, true) => NOTHING,
            (false, true) => ABOVE,
            _ => BOTH,
        };
        // No network adds a tensor and maps through a table, or has a table after a short shift, or in 16 bits.
        let table = requantise.table.is_some_and(|table| table.len() == 256);
        let usual = requantise.add.is_none() && requantise.shift >= 32 && requantise.out.dtype == Dtype::U8;
        let known = table == requantise.table.is_some() && table == (count == NOTHING) && (!table || usual);
        // With a shift of up to 53, the zero code can be added before the shift to sums of 2^61, added products of 2^60 and half.
        let fits = requantise.shift <= 53 && target.pixels * requantise.width <= ACCUMULATORS;
        let bytes = bytes.as_mut_ptr();
        (known && fits).then_some(Self { requantise, acc, bytes, pixels: target.pixels, to, added, count })
    }

    /// Returns how many results were cut; `None` for an operator that no network has.
    ///
    /// # Safety
    /// The processor has AVX-512, with VBMI if `VBMI`.
    #[inline(always)]
    unsafe fn run<const VBMI: bool>(&self) -> Option<u64> {
        let long = self.requantise.shift < 32;
        // SAFETY: guaranteed by the caller.
        unsafe {
            Some(match (self.requantise.add.map(|add| add.dtype), long, self.count) {
                (None, false, NOTHING) => self.wide::<VBMI, 0, false, NOTHING>(),
                (None, false, ABOVE) => self.wide::<VBMI, 0, false, ABOVE>(),
                (None, false, _) => self.wide::<VBMI, 0, false, BOTH>(),
                (None, true, ABOVE) => self.wide::<VBMI, 0, true, ABOVE>(),
                (None, true, _) => self.wide::<VBMI, 0, true, BOTH>(),
                (Some(Dtype::U8), false, ABOVE) => self.wide::<VBMI, 1, false, ABOVE>(),
                (Some(Dtype::U8), false, _) => self.wide::<VBMI, 1, false, BOTH>(),
                (Some(Dtype::U8), true, ABOVE) => self.wide::<VBMI, 1, true, ABOVE>(),
                (Some(Dtype::U8), true, _) => self.wide::<VBMI, 1, true, BOTH>(),
                (Some(Dtype::I16), false, ABOVE) => self.wide::<VBMI, 2, false, ABOVE>(),
                (Some(Dtype::I16), false, _) => self.wide::<VBMI, 2, false, BOTH>(),
                (Some(Dtype::I16), true, ABOVE) => self.wide::<VBMI, 2, true, ABOVE>(),
                (Some(Dtype::I16), true, _) => self.wide::<VBMI, 2, true, BOTH>(),
                (Some(Dtype::F32), ..) => return None,
            })
        }
    }

    /// # Safety
    /// As [`Self::run`].
    #[inline(always)]
    unsafe fn wide<const VBMI: bool, const ADD: u8, const LONG: bool, const COUNT: u8>(&self) -> u64 {
        // SAFETY: guaranteed by the caller.
        unsafe {
            if self.requantise.out.dtype == Dtype::I16 {
                self.panel::<VBMI, ADD, LONG, COUNT, true>()
            } else {
                self.panel::<VBMI, ADD, LONG, COUNT, false>()
            }
        }
    }

    /// Rounds vector by vector.
    ///
    /// # Safety
    /// As [`Self::run`].
    #[inline(always)]
    unsafe fn panel<const VBMI: bool, const ADD: u8, const LONG: bool, const COUNT: u8, const WIDE: bool>(
        &self,
    ) -> u64 {
        let mut cut = 0;
        for first in (0..self.requantise.channels).step_by(LANES) {
            let channels = (self.requantise.channels - first).min(LANES);
            // SAFETY: guaranteed by the caller; `first` is 0 or 16.
            cut += unsafe {
                match (VBMI, channels) {
                    (true, 16) => vector_vbmi::<ADD, LONG, COUNT, WIDE, 16>(self, first, channels),
                    (true, 12) => vector_vbmi::<ADD, LONG, COUNT, WIDE, 12>(self, first, channels),
                    (true, 8) => vector_vbmi::<ADD, LONG, COUNT, WIDE, 8>(self, first, channels),
                    (true, _) => vector_vbmi::<ADD, LONG, COUNT, WIDE, 0>(self, first, channels),
                    (false, 16) => vector::<ADD, LONG, COUNT, WIDE, 16>(self, first, channels),
                    (false, 12) => vector::<ADD, LONG, COUNT, WIDE, 12>(self, first, channels),
                    (false, 8) => vector::<ADD, LONG, COUNT, WIDE, 8>(self, first, channels),
                    (false, _) => vector::<ADD, LONG, COUNT, WIDE, 0>(self, first, channels),
                }
            };
        }
        cut
    }
}

/// # Safety
/// As [`Vector::new`].
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
unsafe fn vector<const ADD: u8, const LONG: bool, const COUNT: u8, const WIDE: bool, const SHAPE: usize>(
    job: &Job<'_>,
    first: usize,
    channels: usize,
) -> u64 {
    // SAFETY: guaranteed by the caller.
    unsafe { Vector::<false, ADD, LONG, COUNT, WIDE, SHAPE>::new(job, first, channels).pixels() }
}

/// # Safety
/// As [`Vector::new`].
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512vbmi")]
unsafe fn vector_vbmi<const ADD: u8, const LONG: bool, const COUNT: u8, const WIDE: bool, const SHAPE: usize>(
    job: &Job<'_>,
    first: usize,
    channels: usize,
) -> u64 {
    // SAFETY: guaranteed by the caller.
    unsafe { Vector::<true, ADD, LONG, COUNT, WIDE, SHAPE>::new(job, first, channels).pixels() }
}

/// Up to 16 channels with what is the same for all pixels. `ADD` is the number of bytes of an added sample. With `LONG` the shift is below 32,
/// and results, which may have more than 31 bits, are clamped in 64 bits first. With `WIDE` codes have two bytes. `SHAPE` is the number of
/// channels: 16, 12, or 8 of two pixels side by side; 0 for any other.
struct Vector<
    'a,
    const VBMI: bool,
    const ADD: u8,
    const LONG: bool,
    const COUNT: u8,
    const WIDE: bool,
    const SHAPE: usize,
> {
    job: &'a Job<'a>,
    channels: usize,
    mask: u16,
    acc: *const i32,
    to: *mut u8,
    added: *const u8,
    bias: __m512i,
    multiplier: [__m512i; 2],
    add_multiplier: [__m512i; 2],
    half: __m512i,
    lo: __m512i,
    hi: __m512i,
    shift: __m128i,
    add_shift: __m128i,
    tables: [__m512i; 4],
}

impl<const VBMI: bool, const ADD: u8, const LONG: bool, const COUNT: u8, const WIDE: bool, const SHAPE: usize>
    Vector<'_, VBMI, ADD, LONG, COUNT, WIDE, SHAPE>
{
    /// # Safety
    /// The processor has AVX-512, with VBMI if `VBMI`; [`Job::new`]; `first` is 0 or 16, and these channels exist.
    #[inline(always)] // Into functions that have the target features, here and below.
    unsafe fn new<'a>(
        job: &'a Job<'a>,
        first: usize,
        channels: usize,
    ) -> Vector<'a, VBMI, ADD, LONG, COUNT, WIDE, SHAPE> {
        let r = job.requantise;
        // SAFETY: lists have 32 entries, a table 256; the caller has the instructions.
        unsafe {
            let list = |values: &[i32; PANEL]| {
                let all = _mm512_loadu_si512(values.as_ptr().add(first).cast());
                if SHAPE == 8 { _mm512_shuffle_i64x2::<0b01_00_01_00>(all, all) } else { all }
            };
            let (multiplier, add_multiplier) = (list(&r.multiplier), list(&r.add_multiplier));
            let table = r.table.filter(|_| VBMI && COUNT == NOTHING);
            let shift = r.shift as i64 - if LONG { 0 } else { 32 };
            Vector {
                job,
                channels,
                mask: ((1u32 << channels) - 1) as u16,
                acc: job.acc.as_ptr().add(first),
                to: job.bytes.add(job.to.0 + first),
                added: job.bytes.add(job.added.0 + if ADD > 0 { first } else { 0 }),
                bias: list(&r.bias),
                multiplier: [multiplier, _mm512_srli_epi64::<32>(multiplier)],
                add_multiplier: [add_multiplier, _mm512_srli_epi64::<32>(add_multiplier)],
                half: _mm512_set1_epi64(r.half + (r.zero << r.shift)),
                lo: _mm512_set1_epi32(r.lo as i32),
                hi: _mm512_set1_epi32(r.hi as i32),
                shift: _mm_cvtsi64_si128(shift),
                add_shift: _mm_cvtsi64_si128(r.add_shift as i64),
                tables: [0, 64, 128, 192].map(|at| match table {
                    Some(table) => _mm512_loadu_si512(table.as_ptr().add(at).cast()),
                    None => _mm512_setzero_si512(),
                }),
            }
        }
    }

    /// Rounds all pixels; returns how many results were cut.
    ///
    /// # Safety
    /// As [`Self::new`].
    #[inline(always)]
    unsafe fn pixels(&self) -> u64 {
        let (pixels, together) = (self.job.pixels, if SHAPE == 8 { 2 } else { 1 });
        // SAFETY: guaranteed by the caller; sums and codes of these pixels are within the slices.
        unsafe {
            let mut cuts = _mm512_setzero_si512();
            let mut p = 0;
            while p + together <= pixels {
                self.round::<false>(p, &mut cuts);
                p += together;
            }
            if p < pixels {
                self.round::<true>(p, &mut cuts);
            }
            _mm512_reduce_add_epi32(cuts) as u64
        }
    }

    /// Rounds one pixel, or two; `ALONE` is the last one of an odd number of pixels.
    ///
    /// # Safety
    /// As [`Self::new`]; the pixels exist.
    #[inline(always)]
    unsafe fn round<const ALONE: bool>(&self, p: usize, cuts: &mut __m512i) {
        let two = SHAPE == 8 && !ALONE;
        let r = self.job.requantise;
        // SAFETY: guaranteed by the caller.
        unsafe {
            let from = self.acc.add(p * r.width);
            let sums = if SHAPE == 8 {
                // Loads have the size of the matrix product's stores; loads of another size would wait for the cache.
                let first = _mm512_castsi256_si512(_mm256_loadu_si256(from.cast()));
                let second = if two { from.add(r.width) } else { from };
                _mm512_inserti64x4::<1>(first, _mm256_loadu_si256(second.cast()))
            } else {
                _mm512_loadu_si512(from.cast())
            };
            let v = _mm512_add_epi32(sums, self.bias);
            let odd = _mm512_srli_epi64::<32>(v);
            let mut even = _mm512_add_epi64(_mm512_mul_epi32(v, self.multiplier[0]), self.half);
            let mut odd = _mm512_add_epi64(_mm512_mul_epi32(odd, self.multiplier[1]), self.half);
            if ADD > 0 {
                let value = self.added::<ALONE>(p);
                let product = _mm512_mul_epi32(value, self.add_multiplier[0]);
                even = _mm512_add_epi64(even, _mm512_sll_epi64(product, self.add_shift));
                let product = _mm512_mul_epi32(_mm512_srli_epi64::<32>(value), self.add_multiplier[1]);
                odd = _mm512_add_epi64(odd, _mm512_sll_epi64(product, self.add_shift));
            }
            let v = if LONG {
                join::<true>(even, odd, self.shift, self.shift)
            } else {
                // The upper halves of both, side by side.
                let upper = _mm512_mask_shuffle_epi32::<0b11_11_01_01>(odd, 0x5555, even);
                _mm512_sra_epi32(upper, self.shift)
            };
            let code = _mm512_min_epi32(_mm512_max_epi32(v, self.lo), self.hi);
            if COUNT != NOTHING {
                let there = match SHAPE {
                    16 => u16::MAX,
                    8 if two => u16::MAX,
                    _ => self.mask,
                };
                let cut = match COUNT {
                    ABOVE => _mm512_mask_cmpgt_epi32_mask(there, v, self.hi),
                    _ => _mm512_mask_cmpneq_epi32_mask(there, v, code),
                };
                *cuts = _mm512_mask_add_epi32(*cuts, cut, *cuts, _mm512_set1_epi32(1));
            }
            let to = self.to.add(p * self.job.to.1);
            self.store::<ALONE>(to, self.look_up(self.bytes::<0>(code)));
            if WIDE {
                let upper = _mm_xor_si128(self.bytes::<1>(code), _mm_set1_epi8(i8::MIN));
                self.store::<ALONE>(to.add(r.out.plane_bytes()), upper);
            }
        }
    }

    /// Byte `BYTE` of every lane.
    ///
    /// # Safety
    /// The processor has AVX-512, with VBMI if `VBMI`.
    #[inline(always)]
    unsafe fn bytes<const BYTE: u32>(&self, code: __m512i) -> __m128i {
        // SAFETY: guaranteed by the caller.
        unsafe {
            if VBMI {
                let every_fourth = _mm_setr_epi8(0, 4, 8, 12, 16, 20, 24, 28, 32, 36, 40, 44, 48, 52, 56, 60);
                let places = _mm_add_epi8(every_fourth, _mm_set1_epi8(BYTE as i8));
                _mm512_castsi512_si128(_mm512_permutexvar_epi8(_mm512_castsi128_si512(places), code))
            } else if BYTE == 0 {
                _mm512_cvtepi32_epi8(code)
            } else {
                _mm512_cvtepi32_epi8(_mm512_srli_epi32::<8>(code))
            }
        }
    }

    /// Maps codes through the table, if there is one.
    ///
    /// # Safety
    /// The processor has AVX-512, with VBMI if `VBMI`.
    #[inline(always)]
    unsafe fn look_up(&self, codes: __m128i) -> __m128i {
        let Some(table) = self.job.requantise.table.filter(|_| COUNT == NOTHING) else { return codes };
        // SAFETY: guaranteed by the caller; [`Job::new`] has compared the length of the table.
        unsafe {
            if VBMI {
                let at = _mm512_castsi128_si512(codes);
                let low = _mm512_permutex2var_epi8(self.tables[0], at, self.tables[1]);
                let high = _mm512_permutex2var_epi8(self.tables[2], at, self.tables[3]);
                return _mm512_castsi512_si128(_mm512_mask_blend_epi8(_mm512_movepi8_mask(at), low, high));
            }
            let mut bytes = [0u8; LANES];
            _mm_storeu_si128(bytes.as_mut_ptr().cast(), codes);
            let mapped = bytes.map(|code| *table.get_unchecked(code as usize));
            _mm_loadu_si128(mapped.as_ptr().cast())
        }
    }

    /// Reads the values of the added map.
    ///
    /// # Safety
    /// As [`Self::round`].
    #[inline(always)]
    unsafe fn added<const ALONE: bool>(&self, p: usize) -> __m512i {
        let pitch = self.job.added.1;
        // SAFETY: guaranteed by the caller.
        unsafe {
            let Some(add) = &self.job.requantise.add else { return _mm512_setzero_si512() };
            let load = |from: *const u8| {
                let first = match SHAPE {
                    16 => _mm_loadu_si128(from.cast()),
                    8 => _mm_loadl_epi64(from.cast()),
                    _ => _mm_maskz_loadu_epi8(self.mask, from.cast()),
                };
                let both = SHAPE == 8 && !ALONE;
                if both { _mm_unpacklo_epi64(first, _mm_loadl_epi64(from.add(pitch).cast())) } else { first }
            };
            let from = self.added.add(p * pitch);
            let low = _mm512_cvtepu8_epi32(load(from));
            if ADD == 1 {
                return _mm512_sub_epi32(low, _mm512_set1_epi32(add.zero));
            }
            let high = _mm512_cvtepu8_epi32(load(from.add(add.plane_bytes())));
            _mm512_sub_epi32(_mm512_add_epi32(low, _mm512_slli_epi32::<8>(high)), _mm512_set1_epi32(128 * 256))
        }
    }

    /// Stores whole halves and words, because masked stores of bytes are slow on some processors.
    ///
    /// # Safety
    /// As [`Self::round`].
    #[inline(always)]
    unsafe fn store<const ALONE: bool>(&self, to: *mut u8, codes: __m128i) {
        // SAFETY: guaranteed by the caller.
        unsafe {
            match SHAPE {
                16 => _mm_storeu_si128(to.cast(), codes),
                12 => {
                    _mm_storel_epi64(to.cast(), codes);
                    to.add(8).cast::<i32>().write_unaligned(_mm_extract_epi32::<2>(codes));
                }
                8 => {
                    _mm_storel_epi64(to.cast(), codes);
                    if !ALONE {
                        _mm_storeh_pd(to.add(self.job.to.1).cast(), _mm_castsi128_pd(codes));
                    }
                }
                _ => {
                    let mut bytes = [0u8; LANES];
                    _mm_storeu_si128(bytes.as_mut_ptr().cast(), codes);
                    core::ptr::copy_nonoverlapping(bytes.as_ptr(), to, self.channels);
                }
            }
        }
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
