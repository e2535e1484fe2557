//! The operators, compiled for an instruction set.

/// A [`super::Kernel`] of the given name, for a type that implements [`super::Isa`], with target features. For
/// [`super::select`] alone: to run it on a processor without these features is undefined behaviour.
macro_rules! instantiate {
    ($name:expr, $isa:ty, $features:literal) => {{
        fn unit(
            model: &crate::nn::model::Model<'_>,
            prepared: &crate::nn::prepared::Prepared,
            arena: &mut crate::nn::arena::Arena<'_>,
            step: usize,
            unit: usize,
        ) -> u64 {
            #[target_feature(enable = $features)]
            fn compiled(
                model: &crate::nn::model::Model<'_>,
                prepared: &crate::nn::prepared::Prepared,
                arena: &mut crate::nn::arena::Arena<'_>,
                step: usize,
                unit: usize,
            ) -> u64 {
                crate::nn::ops::run::<$isa>(model, prepared, arena, step, unit)
            }
            // SAFETY: the processor has the features, as selection says.
            unsafe { compiled(model, prepared, arena, step, unit) }
        }
        fn sum(bytes: &[u8]) -> u32 {
            #[target_feature(enable = $features)]
            fn compiled(bytes: &[u8]) -> u32 {
                crate::nn::sum::sum(bytes)
            }
            // SAFETY: as above.
            unsafe { compiled(bytes) }
        }
        super::Kernel { name: $name, unit, sum, gemm: <$isa as super::Isa>::gemm }
    }};
}
pub(super) use instantiate;
