//! Which kernels this processor runs, fastest first.

use super::Kernel;
#[cfg(target_arch = "x86_64")]
use super::instantiate as x86;
#[cfg(not(target_arch = "x86_64"))]
#[allow(unused_imports, reason = "processors with the scalar kernel alone")]
use crate::nn::kernels;

/// Returns the kernels that this processor runs, fastest first.
#[cfg(target_arch = "x86_64")]
pub(super) fn fastest_first() -> [Option<Kernel>; 5] {
    let has = Features::of_this_processor();
    [
        has.avx512_vbmi.then_some(x86::AVX512_VBMI),
        has.avx512_vnni.then_some(x86::AVX512),
        has.avx_vnni.then_some(x86::AVX_VNNI),
        has.avx2.then_some(x86::AVX2),
        Some(Kernel::SCALAR),
    ]
}

/// Returns the kernels that the binary is compiled for, fastest first.
#[cfg(not(target_arch = "x86_64"))]
#[allow(unused_variables, reason = "the last one that the target has holds")]
pub(super) fn fastest_first() -> [Option<Kernel>; 2] {
    let fastest: Option<Kernel> = None;
    #[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
    let fastest = Some(Kernel::of::<kernels::neon::Neon>());
    #[cfg(all(target_arch = "aarch64", target_feature = "dotprod", target_endian = "little"))]
    let fastest = Some(Kernel::of::<kernels::neon_dot::NeonDot>());
    #[cfg(arm_dsp)]
    let fastest = Some(Kernel::of::<kernels::dsp::Dsp>());
    #[cfg(arm_mve)]
    let fastest = Some(Kernel::of::<kernels::helium::Helium>());
    #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
    let fastest = Some(Kernel::of::<kernels::simd128::Simd128>());
    [fastest, Some(Kernel::SCALAR)]
}

/// Proof that the operating system lets this process use the tiles of AMX. Linux wants to be asked first:
/// `arch_prctl(ARCH_REQ_XCOMP_PERM, XFEATURE_XTILEDATA)`.
#[derive(Debug, Clone, Copy)]
pub struct TilesAllowed(());

impl TilesAllowed {
    /// States that it does, for all threads that will run the kernel. Where the processor has no AMX, the statement means nothing.
    ///
    /// # Safety
    /// The operating system has allowed it. Otherwise the kernel's instructions end the process.
    #[allow(unsafe_code)]
    pub const unsafe fn state() -> Self {
        Self(())
    }
}

/// Returns the kernel for AMX, if the processor has it.
pub(super) fn amx(_: TilesAllowed) -> Option<Kernel> {
    #[cfg(target_arch = "x86_64")]
    let kernel = Features::of_this_processor().amx.then_some(x86::AMX);
    #[cfg(not(target_arch = "x86_64"))]
    let kernel = None;
    kernel
}

/// Extensions of an AArch64 processor beside NEON. Only the operating system can say which there are.
#[derive(Debug, Clone, Copy)]
#[allow(dead_code, reason = "other processors read nothing of it")]
pub struct ArmExtensions {
    dot_products: bool,
    i8_matrices: bool,
}

impl ArmExtensions {
    /// States that the processor has dot products (`FEAT_DotProd`) and products of matrices of i8 (`FEAT_I8MM`). On other processors the
    /// statement means nothing.
    ///
    /// # Safety
    /// An AArch64 processor has what is stated. Otherwise the kernels' instructions end the process.
    #[allow(unsafe_code)]
    pub const unsafe fn state(dot_products: bool, i8_matrices: bool) -> Self {
        Self { dot_products, i8_matrices }
    }
}

/// Returns the kernels for extensions that the binary is not compiled for, fastest first.
#[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
pub(super) fn arm(has: ArmExtensions) -> [Option<Kernel>; 2] {
    let dot_products = has.dot_products && cfg!(not(target_feature = "dotprod"));
    [has.i8_matrices.then_some(super::instantiate::NEON_I8MM), dot_products.then_some(super::instantiate::NEON_DOT)]
}

#[cfg(not(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little")))]
pub(super) fn arm(_: ArmExtensions) -> [Option<Kernel>; 2] {
    [None; 2]
}

/// Features of the processor whose registers the operating system saves on a task switch.
#[cfg(target_arch = "x86_64")]
struct Features {
    avx2: bool,
    /// AVX-VNNI, beside `avx2`.
    avx_vnni: bool,
    /// AVX-512 F, DQ, BW, VL and VNNI.
    avx512_vnni: bool,
    /// VBMI, beside those of `avx512_vnni`.
    avx512_vbmi: bool,
    /// AMX with 8-bit integers, beside those of `avx512_vbmi`.
    amx: bool,
}

#[cfg(target_arch = "x86_64")]
impl Features {
    #[allow(unsafe_code)]
    fn of_this_processor() -> Self {
        use core::arch::x86_64::{__cpuid, __cpuid_count, _xgetbv};
        const OSXSAVE_AND_AVX: u32 = 1 << 27 | 1 << 28;
        const AVX2: u32 = 1 << 5;
        // Of leaf 7's second part.
        const AVX_VNNI: u32 = 1 << 4;
        const AVX512_F_DQ_BW_VL: u32 = 1 << 16 | 1 << 17 | 1 << 30 | 1 << 31;
        const AVX512_VNNI: u32 = 1 << 11;
        const AVX512_VBMI: u32 = 1 << 1;
        const AMX_TILE_AND_INT8: u32 = 1 << 24 | 1 << 25;
        // State components: SSE and AVX; then these and the three of AVX-512; the two of AMX.
        const AVX_STATE: u64 = 0b110;
        const AVX512_STATE: u64 = 0b1110_0110;
        const AMX_STATE: u64 = 0b11 << 17;
        let all = |value: u32, bits: u32| value & bits == bits;
        if __cpuid(0).eax < 7 || !all(__cpuid(1).ecx, OSXSAVE_AND_AVX) {
            return Self { avx2: false, avx_vnni: false, avx512_vnni: false, avx512_vbmi: false, amx: false };
        }
        // SAFETY: OSXSAVE means that the instruction exists and the operating system allows it.
        let state = unsafe { _xgetbv(0) };
        let found = __cpuid_count(7, 0);
        let saves = |bits: u64| state & bits == bits;
        let avx512_vnni = saves(AVX512_STATE) && all(found.ebx, AVX512_F_DQ_BW_VL) && all(found.ecx, AVX512_VNNI);
        let avx512_vbmi = avx512_vnni && all(found.ecx, AVX512_VBMI);
        let avx2 = saves(AVX_STATE) && all(found.ebx, AVX2);
        Self {
            avx2,
            avx_vnni: avx2 && found.eax >= 1 && all(__cpuid_count(7, 1).eax, AVX_VNNI),
            avx512_vnni,
            avx512_vbmi,
            amx: avx512_vbmi && saves(AMX_STATE) && all(found.edx, AMX_TILE_AND_INT8),
        }
    }
}
