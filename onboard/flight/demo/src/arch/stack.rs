//! How deep a call goes: the unused stack is painted before, and what is no longer painted after was used.

use core::hint::black_box;
use core::ptr::{read_volatile, write_volatile};

unsafe extern "C" {
    // From sections.x: the lowest byte of the stack, which grows towards it.
    static mut __stack_limit: u32;
}

const PAINT: u32 = 0xc5a3_c5a3;
/// Left unpainted below the painter's own local variable: the rest of its frame, which on SPARC holds 96 bytes by convention.
const OWN_BYTES: usize = 128;

/// Runs `call` and says how many bytes of stack it took, counted from this function's own frame. The painter itself takes about 200,
/// so less than that reads as 200.
#[inline(never)]
pub(crate) fn depth(call: impl FnOnce()) -> Option<usize> {
    let here = 0u32;
    let top = black_box(&raw const here) as usize;
    paint();
    call();
    Some(top - lowest_used())
}

/// Paints from the stack's end up to here.
#[inline(never)]
fn paint() {
    let here = 0u32;
    let end = black_box(&raw const here) as usize - OWN_BYTES;
    let mut at = &raw mut __stack_limit;
    while (at as usize) < end {
        // SAFETY: between the stack's end and the frames in use lies memory that nobody has, aligned as the linker script says.
        unsafe {
            write_volatile(at, PAINT);
            at = at.add(1);
        }
    }
}

/// Address of the lowest word that lost its paint.
#[inline(never)]
fn lowest_used() -> usize {
    let mut at = &raw const __stack_limit;
    // SAFETY: ends at the latest where the stack is in use: below this frame lies no word but of the stack.
    unsafe {
        while read_volatile(at) == PAINT {
            at = at.add(1);
        }
    }
    at as usize
}
