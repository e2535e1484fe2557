//! Two functions that do nothing: `boards/counter/instructions.c` counts what is executed between a call of the first and a
//! call of the second.

use core::hint::black_box;

/// Counting begins.
#[inline(never)]
#[unsafe(no_mangle)]
pub(crate) extern "C" fn elunar_count_start() {
    // Bodies that differ, lest the two become one.
    black_box(1u8);
}

/// Counting ends; the counter reports what was counted since the last call of [`elunar_count_start`].
#[inline(never)]
#[unsafe(no_mangle)]
pub(crate) extern "C" fn elunar_count_stop() {
    black_box(2u8);
}
