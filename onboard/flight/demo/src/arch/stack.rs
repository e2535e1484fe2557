//! Measures the stack depth of a call: the unused stack is painted before the call, and words without paint after it were used.

use core::hint::black_box;
use core::ptr::{read_volatile, write_volatile};

unsafe extern "C" {
    // From sections.x: the lowest byte of the stack, which grows towards it.
    static mut __stack_limit: u32;
}

const PAINT: u32 = 0xc5a3_c5a3;
/// Bytes left unpainted below the painter's own local variable: the rest of its frame, which on SPARC contains 96 bytes by convention.
const OWN_BYTES: usize = 128;

/// Runs `call` and returns the bytes of stack that it used, counted from this function's own frame. The painter itself uses about 200, so
/// smaller values read as 200.
#[inline(never)]
pub(crate) fn depth(call: impl FnOnce()) -> Option<usize> {
    let here = 0u32;
    let top = black_box(&raw const here) as usize;
    paint();
    call();
    Some(top - lowest_used())
}

/// Paints from the stack's end up to this frame.
#[inline(never)]
fn paint() {
    let here = 0u32;
    let end = black_box(&raw const here) as usize - OWN_BYTES;
    let mut at = &raw mut __stack_limit;
    while (at as usize) < end {
        // SAFETY: the memory between the stack's end and the used frames is unused, and aligned by the linker script.
        unsafe {
            write_volatile(at, PAINT);
            at = at.add(1);
        }
    }
}

/// Returns the address of the lowest word that lost its paint.
#[inline(never)]
fn lowest_used() -> usize {
    let mut at = &raw const __stack_limit;
    // SAFETY: the loop ends at the used part of the stack at the latest; all words below this frame belong to the stack.
    unsafe {
        while read_volatile(at) == PAINT {
            at = at.add(1);
        }
    }
    at as usize
}
