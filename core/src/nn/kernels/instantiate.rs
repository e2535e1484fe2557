//! The operators, compiled for an instruction set.

/// Makes `unit` and `gemm` of a [`super::Kernel`] for a type `$isa` that implements [`super::Isa`], with the given target features.
macro_rules! instantiate {
    ($isa:ty, $features:literal) => {
        /// For [`super::select`] alone: to run it on a processor without these features is undefined behaviour.
        pub(super) const KERNEL: super::Kernel = super::Kernel { name: NAME, unit, gemm };

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
            // SAFETY: the processor has the features (see `KERNEL`).
            unsafe { compiled(model, operator, arena, step, unit) }
        }

        fn gemm(acc: &mut super::Accumulators, pixels: usize, patch: &super::Patch<'_>, weights: &[u8], width: usize) {
            <$isa as super::Isa>::gemm(acc, pixels, patch, weights, width)
        }
    };
}
pub(super) use instantiate;
