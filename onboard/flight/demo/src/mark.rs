//! Two functions that do nothing: `boards/counter/instructions.c` counts the instructions between a call of the first and a call of the
//! second.

use core::hint::black_box;

/// Begins the count.
#[inline(never)]
#[unsafe(no_mangle)]
pub(crate) extern "C" fn elunar_count_start() {
    // Different bodies, so that the two functions are not merged.
    black_box(1u8);
}

/// Ends the count; the counter reports the instructions since the last call of [`elunar_count_start`].
#[inline(never)]
#[unsafe(no_mangle)]
pub(crate) extern "C" fn elunar_count_stop() {
    black_box(2u8);
}
