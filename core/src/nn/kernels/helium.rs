//! Helium (Cortex-M55): `vmladava` adds 16 products of u8 to a sum in a general register.
//!
//! It needs 16 weights of one channel side by side. These are in four groups, so a gather reads four words. Both factors have the same
//! type, so the weights become u8 by flipping their highest bit: w = w' - 128, and 128 Σx is subtracted.
//!
//! ```text
//! deficit[p] = -128 Σ x of pixel p                                once per call
//! sums of 3 pixels x 2 channels stay in registers
//! for every row r of the patch and every four groups (the last of them cut off by the loop instruction, `dlstp`):
//!     for every pixel p:    x[p] = 16 codes                                     vldrb
//!     for both channels c:  w = 16 weights, flipped                              vldrw (gather), veor
//!         for every pixel p:  sum[p][c] += Σ x[p] * w                            vmladava
//! ```
#![allow(unsafe_code)]

use super::requantise::{Requantise, Target};
use super::{Accumulators, Isa, Patch, add, blocks, scalar::Scalar};
use core::arch::asm;

/// Helium, integers.
#[derive(Default)]
pub(crate) struct Helium;

impl Isa for Helium {
    const NAME: &str = "helium-u8i8-3x2";

    #[inline(always)]
    fn gemm(&mut self, acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        product(acc, pixels, patch, weights, width);
    }

    #[inline(always)]
    fn requantise(requantise: &Requantise<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
        requantise.by_channels(bytes, acc, target)
    }
}

/// Pixels whose sums are kept in registers.
const PIXELS: usize = 3;
/// Largest number of pixels of a call.
const MOST: usize = super::ACCUMULATORS / 8;

/// Not inlined, because the convolutions and the attention use the same code.
#[inline(never)]
fn product(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
    // Gathers of words need addresses that are multiples of four.
    if !weights.as_ptr().cast::<u32>().is_aligned() {
        return Scalar.gemm(acc, pixels, patch, weights, width);
    }
    if !patch.fits(pixels, weights, width) || patch.groups == 0 || pixels == 0 {
        return;
    }
    let mut deficits = [0; MOST];
    for (p, deficit) in deficits.iter_mut().enumerate().take(pixels) {
        let mut sum = 0;
        for &start in patch.starts {
            let x = patch.bytes.as_ptr().wrapping_add(start + p * patch.stride);
            // SAFETY: the target has the instructions, and `fits` has bounded every read.
            sum = unsafe { total(sum, x, 4 * patch.groups) };
        }
        *deficit = sum.wrapping_mul(-128);
    }
    let offsets = [0, 4 * width, 8 * width, 12 * width];
    blocks(width, 2, pixels, |channel, first, left| {
        // Missing pixels repeat the last one and are not stored.
        let pixel = [first, (first + 1).min(pixels - 1), (first + 2).min(pixels - 1)];
        let mut sums = pixel.map(|p| [deficits[p.min(MOST - 1)]; 2]);
        let mut w = weights.as_ptr().wrapping_add(4 * channel);
        for &start in patch.starts {
            let x = pixel.map(|p| patch.bytes.as_ptr().wrapping_add(start + p * patch.stride));
            // SAFETY: as above.
            unsafe { row(&mut sums, x, w, &offsets, patch.groups) };
            w = w.wrapping_add(4 * width * patch.groups);
        }
        for (p, sums) in sums.iter().enumerate().take(left) {
            add(acc, width, first + p, channel, sums);
        }
        PIXELS
    });
}

/// Returns `sum` plus the sum of `len` codes.
///
/// # Safety
/// The processor has Helium, the codes are readable, and `len` is not 0.
#[inline(always)]
unsafe fn total(mut sum: i32, x: *const u8, len: usize) -> i32 {
    // SAFETY: guaranteed by the caller.
    unsafe {
        asm!(
            "dlstp.8 lr, {len}",
            "2:",
            "vldrb.u8 q0, [{x}], #16",
            "vaddva.u8 r0, q0",
            "letp lr, 2b",
            x = inout(reg) x => _, len = in(reg) len, inout("r0") sum, out("r14") _,
            out("d0") _, out("d1") _,
            options(readonly, nostack),
        );
    }
    sum
}

/// Adds one row's products of three pixels and two channels: `groups` words at every `x`, and words at `w` and `w + 4`, with `offsets[1]`
/// bytes from group to group.
///
/// # Safety
/// The processor has Helium, all these words are readable, `w` is a multiple of four, and `groups` is not 0.
#[inline(always)]
unsafe fn row(
    sums: &mut [[i32; 2]; PIXELS],
    x: [*const u8; PIXELS],
    w: *const u8,
    offsets: &[usize; 4],
    groups: usize,
) {
    let [[s00, s01], [s10, s11], [s20, s21]] = sums;
    // SAFETY: guaranteed by the caller.
    unsafe {
        asm!(
            "vldrw.u32 q5, [r11]",          // addresses of the first channel's words in four groups
            "ldr r11, [r11, #4]",
            "lsl r11, r11, #2",
            "vadd.i32 q5, q5, r9",
            "vmov.i8 q4, #0x80",
            "dlstp.32 lr, lr",
            "2:",
            "vldrb.u8 q0, [r1], #16",
            "vldrb.u8 q1, [r3], #16",
            "vldrb.u8 q2, [r5], #16",
            "vldrw.u32 q3, [q5]",
            "veor q3, q3, q4",
            "vmladava.u8 r0, q0, q3",
            "vmladava.u8 r4, q1, q3",
            "vmladava.u8 r10, q2, q3",
            "vldrw.u32 q3, [q5, #4]",
            "vadd.i32 q5, q5, r11",
            "veor q3, q3, q4",
            "vmladava.u8 r2, q0, q3",
            "vmladava.u8 r8, q1, q3",
            "vmladava.u8 r12, q2, q3",
            "letp lr, 2b",
            inout("r1") x[0] => _, inout("r3") x[1] => _, inout("r5") x[2] => _, in("r9") w,
            inout("r11") offsets.as_ptr() => _, inout("r14") groups => _,
            inout("r0") *s00, inout("r2") *s01, inout("r4") *s10, inout("r8") *s11, inout("r10") *s20, inout("r12") *s21,
            out("d0") _, out("d1") _, out("d2") _, out("d3") _, out("d4") _, out("d5") _, out("d6") _, out("d7") _,
            out("d8") _, out("d9") _, out("d10") _, out("d11") _,
            options(readonly, nostack),
        );
    }
}
