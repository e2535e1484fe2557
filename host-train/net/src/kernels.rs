//! The kernels of this machine. Those of `elunar-core` ask no operating system; for the tiles of AMX and the extensions of AArch64 someone
//! must.
#![cfg_attr(any(all(target_os = "linux", target_arch = "x86_64"), target_arch = "aarch64"), allow(unsafe_code))]

use elunar_core::nn::{ArmExtensions, Kernel, TilesAllowed};

/// Returns the kernels of this machine, fastest first.
pub fn kernels() -> impl Iterator<Item = Kernel> {
    let tiles = tiles_allowed().and_then(Kernel::amx).into_iter();
    tiles.chain(arm_extensions().into_iter().flat_map(Kernel::arm)).chain(Kernel::available())
}

/// Returns the fastest kernel of this machine.
#[must_use]
pub fn best() -> Kernel {
    kernels().next().unwrap_or(Kernel::SCALAR)
}

/// Asks the operating system what an AArch64 processor has.
#[cfg(target_arch = "aarch64")]
fn arm_extensions() -> Option<ArmExtensions> {
    use std::arch::is_aarch64_feature_detected;
    // SAFETY: the operating system says so.
    Some(unsafe { ArmExtensions::state(is_aarch64_feature_detected!("dotprod"), is_aarch64_feature_detected!("i8mm")) })
}

#[cfg(not(target_arch = "aarch64"))]
fn arm_extensions() -> Option<ArmExtensions> {
    None
}

/// Asks Linux, once for the process, for the tiles of AMX.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn tiles_allowed() -> Option<TilesAllowed> {
    use std::sync::LazyLock;
    const ARCH_REQ_XCOMP_PERM: libc::c_long = 0x1023;
    const XFEATURE_XTILEDATA: libc::c_long = 18;
    // SAFETY: the call changes no memory of ours.
    static ANSWER: LazyLock<libc::c_long> =
        LazyLock::new(|| unsafe { libc::syscall(libc::SYS_arch_prctl, ARCH_REQ_XCOMP_PERM, XFEATURE_XTILEDATA) });
    // SAFETY: Linux has allowed it, for all threads of the process.
    (*ANSWER == 0).then(|| unsafe { TilesAllowed::state() })
}

#[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
fn tiles_allowed() -> Option<TilesAllowed> {
    None
}
