//! DSP extension of ARM's microcontrollers (Cortex-M4, M7): `smlad` adds two products of 16 bits to a sum.
//!
//! ```text
//! sums of 2 pixels x 2 channels stay in registers
//! for every row r of the patch and every group g:
//!     for both pixels:    even, odd = codes 0, 2 and 1, 3 as pairs of 16 bits          ldr, uxtb16, uxtb16
//!     for both channels:  even, odd = weights 0, 2 and 1, 3                             ldr, sxtb16, sxtb16
//!         for both pixels:  sum = smlad(odd, odd, smlad(even, even, sum))
//! ```
#![allow(unsafe_code)]

use super::requantise::{Requantise, Target};
use super::{Accumulators, Isa, Patch, add, blocks};
use core::arch::asm;

/// DSP extension.
#[derive(Default)]
pub(crate) struct Dsp;

impl Isa for Dsp {
    const NAME: &str = "dsp-u8i8-2x2";

    #[inline(always)]
    fn gemm(&mut self, acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        product(acc, pixels, patch, weights, width);
    }

    #[inline(always)]
    fn requantise(requantise: &Requantise<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
        requantise.by_channels(bytes, acc, target)
    }
}

/// Not inlined, because the convolutions and the attention use the same code.
#[inline(never)]
fn product(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
    if !patch.fits(pixels, weights, width) {
        return;
    }
    blocks(width, 2, pixels, |channel, first, left| {
        // The last of an odd number of pixels is computed twice; the second result is not stored.
        let second = (left > 1) as usize;
        let mut sums = [0; 4];
        let mut w = weights.as_ptr().wrapping_add(4 * channel);
        for &start in patch.starts {
            let x = patch.bytes.as_ptr().wrapping_add(start + first * patch.stride);
            let stride = second * patch.stride;
            // SAFETY: the target has the instructions, and `fits` has bounded every read.
            unsafe {
                match width {
                    32 => row::<128>(&mut sums, x, stride, w, patch.groups),
                    16 => row::<64>(&mut sums, x, stride, w, patch.groups),
                    _ => row::<32>(&mut sums, x, stride, w, patch.groups),
                }
            }
            w = w.wrapping_add(4 * width * patch.groups);
        }
        for (p, sums) in sums.as_chunks::<2>().0.iter().enumerate().take(1 + second) {
            add(acc, width, first + p, channel, sums);
        }
        2
    });
}

/// Adds one row's products of two pixels and two channels: `groups` words at `x` and at `x + stride`, pairs of words `STEP` bytes apart at
/// `w`. One block of assembly, because it needs every register: it saves and restores `r6` and `r7`, which the compiler reserves.
///
/// # Safety
/// The processor has the DSP extension, and all these words are readable.
#[inline(always)]
unsafe fn row<const STEP: usize>(sums: &mut [i32; 4], x: *const u8, stride: usize, w: *const u8, groups: usize) {
    let [mut s00, mut s01, mut s10, mut s11] = *sums;
    if groups == 0 {
        return;
    }
    // SAFETY: guaranteed by the caller; the block leaves the stack as it was.
    unsafe {
        asm!(
            "push {{r6, r7}}",
            "2:",
            "ldr r11, [r0, r3]",
            "ldr r10, [r0], #4",
            "ldr r6, [r1, #4]",
            "uxtb16 lr, r11, ror #8",
            "uxtb16 r11, r11",
            "uxtb16 r12, r10, ror #8",
            "uxtb16 r10, r10",
            "sxtb16 r7, r6, ror #8",
            "sxtb16 r6, r6",
            "smlad r5, r10, r6, r5",
            "smlad r9, r11, r6, r9",
            "smlad r5, r12, r7, r5",
            "smlad r9, lr, r7, r9",
            "ldr r6, [r1], #{step}",
            "sxtb16 r7, r6, ror #8",
            "sxtb16 r6, r6",
            "smlad r4, r10, r6, r4",
            "smlad r8, r11, r6, r8",
            "smlad r4, r12, r7, r4",
            "smlad r8, lr, r7, r8",
            "subs r2, r2, #1",
            "bne 2b",
            "pop {{r6, r7}}",
            inout("r0") x => _, inout("r1") w => _, inout("r2") groups => _, in("r3") stride, step = const STEP,
            inout("r4") s00, inout("r5") s01, inout("r8") s10, inout("r9") s11,
            out("r10") _, out("r11") _, out("r12") _, out("r14") _,
            options(readonly),
        );
    }
    *sums = [s00, s01, s10, s11];
}
