//! All kernels of this processor.
#![allow(unsafe_code)]

use crate::nn::{Kernel, TilesAllowed};
use std::io::Write;
use std::sync::Once;

/// Returns the kernels of this processor, fastest first, with that for AMX where Linux allows its tiles.
pub(crate) fn kernels() -> Vec<Kernel> {
    let tiles = tiles_allowed().and_then(Kernel::amx);
    if cfg!(target_arch = "x86_64") && tiles.is_none() {
        static SAID: Once = Once::new();
        // Not `eprintln!`, because the test runner hides its text for tests that pass.
        SAID.call_once(|| {
            let _ =
                writeln!(std::io::stderr(), "SKIPPED: the kernel for AMX: this processor or system does not have it");
        });
    }
    tiles.into_iter().chain(Kernel::available()).collect()
}

#[cfg(all(target_os = "linux", target_arch = "x86_64", not(miri)))]
fn tiles_allowed() -> Option<TilesAllowed> {
    const ARCH_PRCTL: i64 = 158;
    const ARCH_REQ_XCOMP_PERM: u64 = 0x1023;
    const XFEATURE_XTILEDATA: u64 = 18;
    let answer: i64;
    // SAFETY: a call of the system that changes no memory of ours.
    unsafe {
        std::arch::asm!(
            "syscall",
            inlateout("rax") ARCH_PRCTL => answer, in("rdi") ARCH_REQ_XCOMP_PERM, in("rsi") XFEATURE_XTILEDATA,
            lateout("rcx") _, lateout("r11") _, options(nostack),
        );
    }
    // SAFETY: the system has allowed it.
    (answer == 0).then(|| unsafe { TilesAllowed::state() })
}

#[cfg(not(all(target_os = "linux", target_arch = "x86_64", not(miri))))]
fn tiles_allowed() -> Option<TilesAllowed> {
    None
}
