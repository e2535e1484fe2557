//! PowerPC e500 (Book E, big-endian): maps, exceptions, and the serial port of an MPC8544.

use core::arch::global_asm;
use core::hint::spin_loop;
use core::ptr::write_volatile;

global_asm!(include_str!("e500.s"));

/// Transmitter of the first DUART; QEMU's accepts a byte at any time.
const UART_DATA: *mut u8 = 0xe000_4500 as *mut u8;
/// Reset control of the "global utilities", and its request for a hard reset.
const RESET_CONTROL: *mut u32 = 0xe00e_00b0 as *mut u32;
const HARD_RESET: u32 = 1 << 1;

/// Writes to the serial port.
pub(super) fn write(bytes: &[u8]) {
    for &byte in bytes {
        // SAFETY: a register of the serial port; writing it has no effect on memory.
        unsafe { write_volatile(UART_DATA, byte) };
    }
}

/// Ends the run by a reset request, on which QEMU stops. It cannot pass a status: the last line on the console is the result.
pub(super) fn exit(_status: usize) -> ! {
    // SAFETY: a register of the device; the function does not return.
    unsafe { write_volatile(RESET_CONTROL, HARD_RESET) };
    loop {
        spin_loop();
    }
}
