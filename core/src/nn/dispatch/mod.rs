//! The operators, compiled for an instruction set. Only this module asks the processor which of these kernels it runs.

#[cfg(any(target_arch = "x86_64", all(target_arch = "aarch64", target_feature = "neon", target_endian = "little")))]
mod instantiate;
mod select;

pub use select::{ArmExtensions, TilesAllowed};

use super::arena::Arena;
#[cfg(test)]
use super::kernels::Product;
#[cfg(test)]
use super::kernels::requantise::{Requantise, Target};
use super::kernels::scalar::Scalar;
#[cfg(test)]
use super::kernels::softmax::Softmax;
use super::kernels::{Accumulators, Isa, Patch};
use super::ops::{self, Constants, Prepared};
use super::sum::sum;

/// The operators for one instruction set. All kernels compute the same numbers.
#[derive(Clone, Copy)]
pub struct Kernel {
    name: &'static str,
    /// Does one unit of work ([`ops::run`]) and returns the number of codes cut; `None` if its products are wrong.
    pub(crate) unit: fn(&Constants<'_>, &Prepared, &mut Arena<'_>, usize, usize) -> Option<u64>,
    /// Computes the quick checksum of bytes ([`sum`]).
    pub(crate) sum: fn(&[u8]) -> u32,
    pub(crate) gemm: fn(&mut Accumulators, usize, &Patch<'_>, &[u8], usize),
    #[cfg(test)]
    pub(crate) products: ProductsOf,
    #[cfg(test)]
    pub(crate) requantise: fn(&Requantise<'_>, &mut [u8], &Accumulators, &Target) -> u64,
    #[cfg(test)]
    pub(crate) softmax: fn(&Softmax<'_>, &mut [u8], &mut [u8]) -> i64,
}

impl Kernel {
    /// The specification; runs on every processor.
    pub const SCALAR: Self = Self::of::<Scalar>();

    /// Compiles the operators with the features that every processor of the target has.
    pub(crate) const fn of<I: Isa>() -> Self {
        Self {
            name: I::NAME,
            unit: ops::run::<I>,
            sum,
            gemm: gemm::<I>,
            #[cfg(test)]
            products: products::<I>,
            #[cfg(test)]
            requantise: I::requantise,
            #[cfg(test)]
            softmax: I::softmax,
        }
    }

    /// Returns the kernel for AMX, if the processor has it; faster than all of [`Self::available`], which cannot know what the operating system
    /// allows.
    pub fn amx(allowed: TilesAllowed) -> Option<Self> {
        select::amx(allowed)
    }

    /// Returns the kernels for what an AArch64 processor has beside what the binary is compiled for, fastest first; faster than all of
    /// [`Self::available`].
    pub fn arm(has: ArmExtensions) -> impl Iterator<Item = Self> {
        select::arm(has).into_iter().flatten()
    }

    /// Returns the kernels that this processor runs without a word of the operating system, fastest first; the last is always
    /// [`Kernel::SCALAR`].
    pub fn available() -> impl Iterator<Item = Self> {
        select::fastest_first().into_iter().flatten()
    }

    /// Returns the fastest kernel that this processor runs.
    pub fn best() -> Self {
        Self::available().next().unwrap_or(Self::SCALAR)
    }

    /// Returns the kernel's name, by the rule `{isa}-{types}-{variant}`.
    pub fn name(&self) -> &'static str {
        self.name
    }
}

/// A bare product, for tests and benchmarks.
fn gemm<I: Isa>(acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
    I::default().gemm(acc, pixels, patch, weights, width);
}

#[cfg(test)]
type ProductsOf = fn(&mut Accumulators, usize, &[u8], &[Product<'_>], usize, bool);

#[cfg(test)]
fn products<I: Isa>(
    acc: &mut Accumulators,
    pixels: usize,
    bytes: &[u8],
    list: &[Product<'_>],
    width: usize,
    from_zero: bool,
) {
    I::default().products(acc, pixels, bytes, list, width, from_zero);
}

impl core::fmt::Debug for Kernel {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name)
    }
}

#[cfg(test)]
mod tests;
