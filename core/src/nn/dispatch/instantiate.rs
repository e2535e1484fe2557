//! The operators, compiled for instruction sets that not every processor of the target has: [`super::select`] alone may offer them.
#![allow(unsafe_code)]

use super::Kernel;
use crate::nn::arena::Arena;
use crate::nn::kernels::{Isa, x86_avx2::Avx2, x86_avx512::Avx512};
use crate::nn::ops::{self, Constants, Prepared};
use crate::nn::sum;

/// A [`Kernel`] for a type that implements [`Isa`], with target features. To run it on a processor without these features is undefined
/// behaviour.
macro_rules! instantiate {
    ($isa:ty, $features:literal) => {{
        fn unit(
            constants: &Constants<'_>,
            prepared: &Prepared,
            arena: &mut Arena<'_>,
            step: usize,
            unit: usize,
        ) -> u64 {
            #[target_feature(enable = $features)]
            fn compiled(
                constants: &Constants<'_>,
                prepared: &Prepared,
                arena: &mut Arena<'_>,
                step: usize,
                unit: usize,
            ) -> u64 {
                ops::run::<$isa>(constants, prepared, arena, step, unit)
            }
            // SAFETY: the processor has the features, as selection says.
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
        Kernel { name: <$isa as Isa>::NAME, unit, sum, gemm: <$isa as Isa>::gemm }
    }};
}

/// AVX2.
pub(super) const AVX2: Kernel = instantiate!(Avx2, "avx2");

/// AVX-512 VNNI.
pub(super) const AVX512: Kernel = instantiate!(Avx512<false>, "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni");

/// AVX-512 VNNI and VBMI.
pub(super) const AVX512_VBMI: Kernel =
    instantiate!(Avx512<true>, "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx512vbmi");
