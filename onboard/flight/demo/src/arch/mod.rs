//! Start, output and end on bare processors: the only unsafe code of the demo.
//!
//! The module of each processor family has a `_start` (stack, zeroed memory, floating point and vectors enabled, a handler for traps that
//! prints an error) that calls [`elunar_main`], and the functions `write` and `exit`. Processors with semihosting use it for both
//! functions.

#[cfg(target_arch = "aarch64")]
mod aarch64;
#[cfg(all(target_arch = "arm", not(target_feature = "mclass")))]
mod armv7;
#[cfg(all(target_arch = "arm", target_feature = "mclass"))]
mod cortex_m;
#[cfg(target_arch = "powerpc")]
mod e500;
#[cfg(feature = "inject")]
pub(crate) mod inject;
#[cfg(target_arch = "sparc")]
mod leon3;
#[cfg(any(target_arch = "riscv32", target_arch = "riscv64"))]
mod riscv;
#[cfg(not(any(target_arch = "sparc", target_arch = "powerpc")))]
mod semihosting;
pub(crate) mod stack;

#[cfg(target_arch = "powerpc")]
use e500::{exit, write};
#[cfg(target_arch = "sparc")]
use leon3::{exit, write};
#[cfg(not(any(target_arch = "sparc", target_arch = "powerpc")))]
use semihosting::{exit, write};

use core::fmt::{self, Write};

unsafe extern "C" {
    // From memory.x: first byte of the model file, and end of the memory for it; the same for the arena.
    static __model_start: u8;
    static __model_end: u8;
    static mut __arena_start: u8;
    static mut __arena_end: u8;
}

/// The board's console.
struct Console;

impl Write for Console {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        write(text.as_bytes());
        Ok(())
    }
}

/// Returns the aligned part of `bytes` as numbers of any value.
#[cfg(feature = "two_tiles")]
pub(crate) fn floats(bytes: &mut [u8]) -> &mut [f32] {
    // SAFETY: every pattern of bits is a number, and `align_to_mut` leaves out what is not aligned.
    unsafe { bytes.align_to_mut().1 }
}

/// The entry from `_start`, called once, with a stack and zeroed statics.
#[unsafe(no_mangle)]
extern "C" fn elunar_main() -> ! {
    let (model, arena) = (&raw const __model_start, &raw mut __arena_start);
    let model_bytes = &raw const __model_end as usize - model as usize;
    let arena_bytes = &raw mut __arena_end as usize - arena as usize;
    // SAFETY: the memory map reserves both ranges, they do not overlap, and this runs once.
    let (model, arena) = unsafe {
        (core::slice::from_raw_parts(model, model_bytes), core::slice::from_raw_parts_mut(arena, arena_bytes))
    };
    let passed = crate::report::run(model, arena, &mut Console);
    exit(if passed { 0 } else { 1 })
}

/// Reports a processor fault; `cause` and `address` are the processor's own values.
#[unsafe(no_mangle)]
extern "C" fn elunar_fault(cause: usize, address: usize) -> ! {
    let _ = writeln!(Console, "ERROR: processor fault, cause {cause:#x} at {address:#x}\nFAIL");
    exit(102)
}

/// Ends a run whose work does not end.
#[cfg(feature = "inject")]
fn hang() -> ! {
    let _ = writeln!(Console, "outcome hang 0 0 0x0\nFAIL");
    exit(103)
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    let _ = writeln!(Console, "ERROR: {info}\nFAIL");
    exit(101)
}
