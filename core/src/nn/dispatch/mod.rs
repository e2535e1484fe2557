//! The operators, compiled for an instruction set. Only this module asks the processor which of these kernels it runs.

#[cfg(target_arch = "x86_64")]
mod instantiate;
mod select;

use super::arena::Arena;
use super::kernels::scalar::Scalar;
use super::kernels::{self, ACCUMULATORS, Accumulators, Isa, Patch, pixels_at_once};
use super::ops::{self, Constants, Prepared};
use super::sum::sum;

/// The operators for one instruction set. All kernels compute the same numbers.
#[derive(Clone, Copy)]
pub struct Kernel {
    name: &'static str,
    /// Does one unit of work ([`ops::run`]) and returns the number of codes cut.
    pub(crate) unit: fn(&Constants<'_>, &Prepared, &mut Arena<'_>, usize, usize) -> u64,
    /// Computes the quick checksum of bytes ([`sum`]).
    pub(crate) sum: fn(&[u8]) -> u32,
    pub(crate) gemm: fn(&mut Accumulators, usize, &Patch<'_>, &[u8], usize),
}

impl Kernel {
    /// The specification; runs on every processor.
    pub const SCALAR: Self = Self::of::<Scalar>();

    /// Compiles the operators with the features that every processor of the target has.
    const fn of<I: Isa>() -> Self {
        Self { name: I::NAME, unit: ops::run::<I>, sum, gemm: I::gemm }
    }

    /// Returns the kernels that this processor runs, fastest first; the last is always [`Kernel::SCALAR`].
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

    /// Number of pixels computed together against a panel of this width.
    pub const fn pixels_at_once(width: usize) -> usize {
        kernels::pixels_at_once(width)
    }

    /// Computes the bare matrix product, for benchmarks and tests: `acc[p][c] += Σ x[starts[r] + p*stride + 4g + b] * w[r][g][c][b]` for
    /// `pixels` pixels and the channels of a panel ([`super::file::panels`]). The length of `weights` is
    /// `starts.len() * groups * width * 4`.
    ///
    /// # Errors
    /// The name of the argument that does not fit; `acc` is unchanged then.
    pub fn matrix_product(
        &self,
        acc: &mut [i32],
        (pixels, width): (usize, usize),
        (bytes, starts): (&[u8], &[usize]),
        (stride, groups): (usize, usize),
        weights: &[u8],
    ) -> Result<(), &'static str> {
        if ![8, 16, 32].contains(&width) || pixels.checked_mul(width).is_none_or(|n| acc.len() < n) {
            return Err("panel width (8, 16, 32) or accumulators");
        }
        // All checks come before the first block, and sums of addresses must not wrap.
        let reach = || pixels.saturating_sub(1).checked_mul(stride)?.checked_add(groups.checked_mul(4)?);
        let ends_inside = |end: usize| end <= bytes.len();
        let inside = |reach: usize| starts.iter().all(|s| s.checked_add(reach).is_some_and(ends_inside));
        let needed = || groups.checked_mul(4 * width)?.checked_mul(starts.len());
        if !reach().is_some_and(inside) || needed().is_none_or(|n| weights.len() < n) {
            return Err("activations or weights");
        }
        // Empty sums need no kernel.
        let pixels = if starts.is_empty() || groups == 0 { 0 } else { pixels };
        let mut done = 0;
        while done < pixels {
            let now = (pixels - done).min(pixels_at_once(width));
            let mut block = [0; ACCUMULATORS];
            let patch = Patch { bytes: bytes.get(done * stride..).ok_or("activations")?, starts, stride, groups };
            let part = &mut acc[done * width..(done + now) * width];
            block[..part.len()].copy_from_slice(part);
            (self.gemm)(&mut block, now, &patch, weights, width);
            part.copy_from_slice(&block[..part.len()]);
            done += now;
        }
        Ok(())
    }
}

impl core::fmt::Debug for Kernel {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name)
    }
}

#[cfg(test)]
mod tests;
