//! LEON3 (SPARC V8, big-endian): trap table, register windows, the GRLIB console UART.

use core::arch::{asm, global_asm};
use core::ptr::{read_volatile, write_volatile};

global_asm!(include_str!("leon3.s"));

// APBUART of GRLIB, at its usual address.
const UART_DATA: *mut u32 = 0x8000_0100 as *mut u32;
const UART_STATUS: *const u32 = 0x8000_0104 as *const u32;
const UART_CONTROL: *mut u32 = 0x8000_0108 as *mut u32;
const TRANSMITTER_EMPTY: u32 = 1 << 2;
const ENABLE_BOTH: u32 = 0b11;

/// Writes to the UART.
pub(super) fn write(bytes: &[u8]) {
    // SAFETY: the UART's registers; writing them has no effect on memory.
    unsafe {
        write_volatile(UART_CONTROL, ENABLE_BOTH);
        for &byte in bytes {
            while read_volatile(UART_STATUS) & TRANSMITTER_EMPTY == 0 {}
            write_volatile(UART_DATA, u32::from(byte));
        }
    }
}

/// Ends the run: a trap while traps are disabled stops the processor in error mode. It cannot pass a status: the last line on the console
/// is the result.
pub(super) fn exit(_status: usize) -> ! {
    // SAFETY: does not return. Supervisor state, traps disabled, which takes effect after three instructions.
    unsafe { asm!("wr %g0, 0xc0, %psr", "nop", "nop", "nop", "ta 0", options(noreturn)) }
}
