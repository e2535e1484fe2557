//! All kernels of this processor.
#![allow(unsafe_code)]

use crate::nn::{ArmExtensions, Kernel, TilesAllowed};
use std::io::Write;
use std::sync::Once;

/// Returns the kernels of this processor, fastest first, with those of which the system must be asked.
pub(crate) fn kernels() -> Vec<Kernel> {
    static SAID: Once = Once::new();
    let tiles = tiles_allowed().and_then(Kernel::amx);
    let extensions = arm_extensions();
    let missing = [
        ("AMX", cfg!(target_arch = "x86_64") && tiles.is_none()),
        ("dot products", extensions.is_some_and(|[dot_products, _]| !dot_products)),
        ("matrices of i8", extensions.is_some_and(|[_, i8_matrices]| !i8_matrices)),
    ];
    // Not `eprintln!`, because the test runner hides its text for tests that pass.
    SAID.call_once(|| {
        for (name, _) in missing.iter().filter(|(_, missing)| *missing) {
            let _ = writeln!(
                std::io::stderr(),
                "SKIPPED: the kernel for {name}: this processor or system does not have it"
            );
        }
    });
    // SAFETY: the system says that the processor has them.
    let arm = extensions.map(|[dot, matrices]| unsafe { ArmExtensions::state(dot, matrices) });
    tiles.into_iter().chain(arm.into_iter().flat_map(Kernel::arm)).chain(Kernel::available()).collect()
}

/// Whether this AArch64 processor has dot products, and matrices of i8.
fn arm_extensions() -> Option<[bool; 2]> {
    #[cfg(all(target_arch = "aarch64", not(miri)))]
    let found =
        Some([std::arch::is_aarch64_feature_detected!("dotprod"), std::arch::is_aarch64_feature_detected!("i8mm")]);
    #[cfg(not(all(target_arch = "aarch64", not(miri))))]
    let found = None;
    found
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
