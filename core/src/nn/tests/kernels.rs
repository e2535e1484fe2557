//! All kernels of this processor.
#![allow(unsafe_code)]

use crate::nn::kernels::scalar::Scalar;
use crate::nn::kernels::{ACCUMULATORS, Accumulators, Isa, Patch};
use crate::nn::panels::PANEL;
use crate::nn::{ArmExtensions, Kernel, TilesAllowed};
use std::io::Write;
use std::sync::Once;

/// The scalar kernel with blocks as large as those of AMX, and products of several sources together as there: any processor tests this way through
/// the operators.
#[derive(Default)]
struct Together(Scalar);

impl Isa for Together {
    const NAME: &str = "together-u8i8-4x8";
    const TOGETHER: bool = true;

    fn block(left: usize, _: usize) -> usize {
        left.min(ACCUMULATORS / PANEL)
    }

    fn gemm(&mut self, acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        self.0.gemm(acc, pixels, patch, weights, width);
    }
}

/// Returns the kernels of this processor, fastest first, with those of which the system must be asked; then one that only tests have.
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
    let of_processor = tiles.into_iter().chain(arm.into_iter().flat_map(Kernel::arm)).chain(Kernel::available());
    of_processor.chain([Kernel::of::<Together>()]).collect()
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
