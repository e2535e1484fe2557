//! The operators, compiled for an instruction set.

/// A [`super::Kernel`] of the given name, for a type that implements [`super::Isa`], with target features. For
/// [`super::select`] alone: to run it on a processor without these features is undefined behaviour.
macro_rules! instantiate {
    ($name:expr, $isa:ty, $features:literal) => {{
        fn unit(
            model: &crate::nn::model::Model<'_>,
            operator: &crate::nn::program::Operator,
            arena: &mut crate::nn::arena::Arena<'_>,
            step: usize,
            unit: usize,
        ) -> u64 {
            #[target_feature(enable = $features)]
            fn compiled(
                model: &crate::nn::model::Model<'_>,
                operator: &crate::nn::program::Operator,
                arena: &mut crate::nn::arena::Arena<'_>,
                step: usize,
                unit: usize,
            ) -> u64 {
                crate::nn::ops::run::<$isa>(model, operator, arena, step, unit)
            }
            // SAFETY: the processor has the features, as selection says.
            unsafe { compiled(model, operator, arena, step, unit) }
        }
        super::Kernel { name: $name, unit, gemm: <$isa as super::Isa>::gemm }
    }};
}
pub(super) use instantiate;
