//! The operators, compiled for instruction sets that only some processors of the target have. Only [`super::select`] may offer them.
#![allow(unsafe_code)]

use super::Kernel;
use crate::nn::arena::Arena;
use crate::nn::kernels::Isa;
#[cfg(test)]
use crate::nn::kernels::{
    Accumulators,
    requantise::{Requantise, Target},
    softmax::Softmax,
};
#[cfg(target_arch = "aarch64")]
use crate::nn::kernels::{neon_dot::NeonDot, neon_i8mm::NeonI8mm};
#[cfg(target_arch = "x86_64")]
use crate::nn::kernels::{x86_amx::Amx, x86_avx_vnni::AvxVnni, x86_avx2::Avx2, x86_avx512::Avx512};
use crate::nn::ops::{self, Constants, Prepared};
use crate::nn::sum;

/// Makes a [`Kernel`] of a type that implements [`Isa`], with target features. Running it on a processor without these features is
/// undefined behaviour.
macro_rules! instantiate {
    ($isa:ty, $features:literal) => {{
        fn unit(
            constants: &Constants<'_>,
            prepared: &Prepared,
            arena: &mut Arena<'_>,
            step: usize,
            unit: usize,
        ) -> Option<u64> {
            #[target_feature(enable = $features)]
            fn compiled(
                constants: &Constants<'_>,
                prepared: &Prepared,
                arena: &mut Arena<'_>,
                step: usize,
                unit: usize,
            ) -> Option<u64> {
                ops::run::<$isa>(constants, prepared, arena, step, unit)
            }
            // SAFETY: [`super::select`] offers this kernel only to processors with the features.
            unsafe { compiled(constants, prepared, arena, step, unit) }
        }
        fn sum(bytes: &[u8]) -> u32 {
            #[target_feature(enable = $features)]
            fn compiled(bytes: &[u8]) -> u32 {
                sum::sum(bytes)
            }
            // SAFETY: as above.
            unsafe { compiled(bytes) }
        }
        #[cfg(test)]
        fn requantise(numbers: &Requantise<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
            #[target_feature(enable = $features)]
            fn compiled(numbers: &Requantise<'_>, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
                <$isa as Isa>::requantise(numbers, bytes, acc, target)
            }
            // SAFETY: as above.
            unsafe { compiled(numbers, bytes, acc, target) }
        }
        #[cfg(test)]
        fn softmax(numbers: &Softmax<'_>, low: &mut [u8], high: &mut [u8]) -> i64 {
            #[target_feature(enable = $features)]
            fn compiled(numbers: &Softmax<'_>, low: &mut [u8], high: &mut [u8]) -> i64 {
                <$isa as Isa>::softmax(numbers, low, high)
            }
            // SAFETY: as above.
            unsafe { compiled(numbers, low, high) }
        }
        Kernel {
            name: <$isa as Isa>::NAME,
            unit,
            sum,
            gemm: super::gemm::<$isa>,
            #[cfg(test)]
            products: super::products::<$isa>,
            #[cfg(test)]
            requantise,
            #[cfg(test)]
            softmax,
        }
    }};
}

/// Kernel for AArch64 with dot products.
#[cfg(target_arch = "aarch64")]
pub(super) const NEON_DOT: Kernel = instantiate!(NeonDot, "neon,dotprod");

/// Kernel for AArch64 with matrices of i8.
#[cfg(target_arch = "aarch64")]
pub(super) const NEON_I8MM: Kernel = instantiate!(NeonI8mm, "neon,i8mm");

/// Kernel for AVX2.
#[cfg(target_arch = "x86_64")]
pub(super) const AVX2: Kernel = instantiate!(Avx2, "avx2");

/// Kernel for AVX-VNNI.
#[cfg(target_arch = "x86_64")]
pub(super) const AVX_VNNI: Kernel = instantiate!(AvxVnni, "avx2,avxvnni");

/// Kernel for AVX-512 VNNI.
#[cfg(target_arch = "x86_64")]
pub(super) const AVX512: Kernel = instantiate!(Avx512<false>, "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni");

/// Kernel for AVX-512 VNNI and VBMI.
#[cfg(target_arch = "x86_64")]
pub(super) const AVX512_VBMI: Kernel =
    instantiate!(Avx512<true>, "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512vbmi");

/// Kernel for AMX with 8-bit integers. The operating system must allow tiles, too.
#[cfg(target_arch = "x86_64")]
pub(super) const AMX: Kernel = instantiate!(Amx, "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512vbmi");
