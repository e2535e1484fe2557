//! One tile through the C functions, with one flipped bit. The last words of the model's memory say which ([`Injection`], then the number of
//! reference heights and whether the processor is checked, words of 32 bits), and the heights to compare with lie before them.
//!
//! Without an injection the heights are printed.

use crate::arch::inject::{Injection, code, start, stop};
use core::fmt::Write;
use elunar_capi::elunar_core::nn::code_sum;
use elunar_capi::ffi;
use elunar_capi::status::{ELD_OK, ELD_RUNNING};
use elunar_capi::types::{
    ELD_PIXELS_F32, eld_check_t, eld_context_t, eld_model_info_t, eld_pixels_t, eld_status_t, eld_tile_t,
};

/// Multiply-accumulates per call, as in the budgets.
const BUDGET_MACS: u64 = 5_000_000;
/// Heights that differ by more are wrong, metres.
const LIMIT_M: f32 = 0.1;
/// Words at the end of the model's memory.
const WORDS: usize = 7;

/// Makes the tile; prints what came of it. Returns whether it could be made without an injection.
pub(crate) fn run(model: &[u8], words: &[u8], memory: &mut [u8], console: &mut impl Write) -> bool {
    let (before, [when, class, place, bit, limit, count, checked]) = told(words);
    let mut info = eld_model_info_t { struct_bytes: size_of::<eld_model_info_t>() as u32, ..Default::default() };
    let mut check = eld_check_t::default();
    let (bytes, len) = (model.as_ptr().cast(), model.len());
    // SAFETY: a slice and structures of our own, here and below.
    let mut status =
        repeated(|| unsafe { ffi::eld_model_check_step(bytes, len, BUDGET_MACS, &raw mut check, &raw mut info) });
    let pixels = (info.tile_rows * info.tile_cols) as usize;
    // SAFETY: any bits are numbers; what is not aligned is left out.
    let memory = unsafe { memory.align_to_mut::<f32>().1 };
    let ([image, coarse, heights], rest) = divided(memory, pixels);
    paint(image, coarse, info.tile_cols.max(1) as usize);
    // SAFETY: as above.
    let (valid, rest) = unsafe { rest.align_to_mut::<u8>().1.split_at_mut(pixels.next_multiple_of(64)) };
    let mut context: *mut eld_context_t = core::ptr::null_mut();
    let lent = aligned(rest);
    if status == ELD_OK {
        // SAFETY: as above; the memory lives as long as the context.
        status = unsafe {
            ffi::eld_init_checked(lent.as_mut_ptr().cast(), lent.len(), bytes, len, &raw const check, &raw mut context)
        };
    }
    if status != ELD_OK {
        let _ = writeln!(console, "ERROR: {status:#x}");
        return false;
    }
    let sum = code_sum(code());
    start(Injection { when, class, place, bit, limit });
    let made = tile(context, (image, coarse), (heights, &mut valid[..pixels]), checked != 0);
    let ticks = stop();
    let is_code_whole = code_sum(code()) == sum;
    if class == 0 {
        let _ = writeln!(console, "ticks {ticks} pixels {pixels} status {made:#x}");
        print(heights, valid, console);
        return made == ELD_OK;
    }
    let reference = before.get(before.len() - 4 * count..).unwrap_or_default();
    let (error_m, wrong) = difference(heights, valid, reference);
    let outcome = match made {
        ELD_OK if !is_code_whole => "detected",
        ELD_OK if wrong == 0 => "masked",
        ELD_OK => "silent",
        _ => "detected",
    };
    let what = if made == ELD_OK && !is_code_whole { 1 } else { made };
    let _ = writeln!(console, "outcome {outcome} {error_m:e} {wrong} {what:#x}");
    true
}

/// Returns the memory before the words, and the words.
fn told(memory: &[u8]) -> (&[u8], [usize; WORDS]) {
    let (before, words) = memory.split_at(memory.len() - 4 * WORDS);
    let word = |k: usize| words.get(4 * k..4 * k + 4).and_then(|b| b.try_into().ok()).map_or(0, u32::from_le_bytes);
    (before, core::array::from_fn(|k| word(k) as usize))
}

fn divided(memory: &mut [f32], pixels: usize) -> ([&mut [f32]; 3], &mut [f32]) {
    let (image, memory) = memory.split_at_mut(pixels);
    let (coarse, memory) = memory.split_at_mut(pixels);
    let (heights, rest) = memory.split_at_mut(pixels);
    ([image, coarse, heights], rest)
}

/// Returns the part of memory that has the alignment of a context.
fn aligned(memory: &mut [u8]) -> &mut [u8] {
    let skip = memory.as_ptr().align_offset(64).min(memory.len());
    &mut memory[skip..]
}

/// Calls a function until it is done.
fn repeated(mut call: impl FnMut() -> eld_status_t) -> eld_status_t {
    loop {
        let status = call();
        if status != ELD_RUNNING {
            return status;
        }
    }
}

/// Makes the tile; returns the first status that is not OK.
#[inline(never)]
fn tile(
    context: *mut eld_context_t,
    (image, coarse): (&[f32], &[f32]),
    (heights, valid): (&mut [f32], &mut [u8]),
    is_checked: bool,
) -> eld_status_t {
    let image = eld_pixels_t {
        data: image.as_ptr().cast(),
        data_bytes: size_of_val(image),
        row_bytes: 0,
        format: ELD_PIXELS_F32,
        flags: 0,
        gain: 1.0,
        offset: 0.0,
        null_code: 0,
        saturated_from: 0,
    };
    let tile = eld_tile_t {
        struct_bytes: size_of::<eld_tile_t>() as u32,
        pixel_m: 2.0,
        coarse_px: 8.0,
        sun_azimuth_deg: 315.0,
        sun_elevation_deg: 35.0,
        network_alone: 0,
        processor_checks: is_checked.into(),
        image,
        coarse_m: coarse.as_ptr(),
        coarse_len: coarse.len(),
        valid: core::ptr::null(),
        valid_len: 0,
        posts: core::ptr::null(),
        light: core::ptr::null(),
    };
    // SAFETY: a context and a tile of our own, here and below.
    let begun = repeated(|| unsafe { ffi::eld_begin_step(context, &raw const tile, BUDGET_MACS) });
    if begun != ELD_OK {
        return begun;
    }
    // SAFETY: as above.
    let done = repeated(|| unsafe { ffi::eld_step(context, BUDGET_MACS) });
    if done != ELD_OK {
        return done;
    }
    let ((z, z_len), (v, v_len)) = ((heights.as_mut_ptr(), heights.len()), (valid.as_mut_ptr(), valid.len()));
    // SAFETY: as above, and buffers of our own.
    repeated(|| unsafe { ffi::eld_output(context, z, z_len, v, v_len) })
}

/// Makes rough ground and its image.
fn paint(image: &mut [f32], coarse: &mut [f32], cols: usize) {
    let wave = |place: usize, length: usize| {
        let phase = place % length;
        phase.min(length - phase) as f32 / length as f32 * 2.0
    };
    let height = |row: usize, col: usize| 9.0 * wave(row + 2 * col, 53) + 2.5 * wave(row * 2 + col, 17);
    for (index, (bright, z)) in image.iter_mut().zip(coarse).enumerate() {
        let (row, col) = (index / cols, index % cols);
        *bright = 2000.0 + 900.0 * (height(row + 1, col + 1) - height(row, col)) + (index * 7919 % 61) as f32;
        *z = -1900.0 + height(row, col);
    }
}

/// Prints the heights as numbers of eight hexadecimal digits; NaN where none is valid.
fn print(heights: &[f32], valid: &[u8], console: &mut impl Write) {
    for (z, valid) in heights.iter().zip(valid) {
        let _ = write!(console, "{:08x}", if *valid == 0 { f32::NAN } else { *z }.to_bits());
    }
    let _ = writeln!(console);
}

/// Returns the largest difference of a height, metres, and how many heights differ by more than the limit or in their validity.
fn difference(heights: &[f32], valid: &[u8], reference: &[u8]) -> (f32, usize) {
    let (mut largest, mut wrong) = (0.0_f32, 0);
    for ((z, valid), bytes) in heights.iter().zip(valid).zip(reference.as_chunks::<4>().0) {
        let expected = f32::from_le_bytes(*bytes);
        let far = match (*valid == 0, expected.is_nan()) {
            (true, true) => 0.0,
            (false, false) if z.is_finite() => (z - expected).abs(),
            _ => f32::INFINITY,
        };
        largest = largest.max(far);
        wrong += usize::from(far > LIMIT_M);
    }
    (largest, wrong)
}
