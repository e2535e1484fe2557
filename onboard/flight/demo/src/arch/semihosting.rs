//! Console and exit status through the debugger, as Arm and RISC-V define it (Arm IHI 0059; RISC-V semihosting 1.0).

use core::arch::asm;

const SYS_WRITEC: usize = 0x03;
const SYS_EXIT_EXTENDED: usize = 0x20;
const APPLICATION_EXIT: usize = 0x20026;

/// Requests `operation` from the debugger, with the data at `argument`.
fn call(operation: usize, argument: *const usize) {
    // SAFETY: these operations read the data at `argument`, which the callers keep alive, and return in one register.
    unsafe {
        #[cfg(all(target_arch = "arm", target_feature = "mclass"))]
        asm!("bkpt 0xab", inout("r0") operation => _, in("r1") argument, options(nostack));
        // In supervisor mode the call overwrites the link register.
        #[cfg(all(target_arch = "arm", not(target_feature = "mclass")))]
        asm!("svc 0x123456", inout("r0") operation => _, in("r1") argument, out("lr") _, options(nostack));
        #[cfg(target_arch = "aarch64")]
        asm!("hlt 0xf000", inout("x0") operation => _, in("x1") argument, options(nostack));
        // The debugger recognises the three words only in one page and uncompressed.
        #[cfg(any(target_arch = "riscv32", target_arch = "riscv64"))]
        asm!(
            ".option push", ".option norvc", ".balign 16",
            "slli zero, zero, 0x1f", "ebreak", "srai zero, zero, 7",
            ".option pop",
            inout("a0") operation => _, in("a1") argument, options(nostack)
        );
    }
}

/// Writes to the debugger's console.
pub(super) fn write(bytes: &[u8]) {
    for byte in bytes {
        call(SYS_WRITEC, (byte as *const u8).cast());
    }
}

/// Ends the run with this exit status.
pub(super) fn exit(status: usize) -> ! {
    call(SYS_EXIT_EXTENDED, [APPLICATION_EXIT, status].as_ptr());
    loop {
        core::hint::spin_loop();
    }
}
