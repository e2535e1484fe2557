//! What only the benchmarks and tests of this repository call. It is no part of the interface, and may change with every version.

use super::kernels::{self, ACCUMULATORS, Patch};
use super::{Kernel, Runner};
use crate::part::part;

/// The arguments of a bare matrix product.
#[doc(hidden)]
#[derive(Debug, Clone, Copy)]
pub struct MatrixProduct<'a> {
    /// Number of pixels.
    pub pixels: usize,
    /// Channels of the panel: 8, 16 or 32 ([`super::file::panels`]).
    pub width: usize,
    /// The bytes that contain the codes.
    pub bytes: &'a [u8],
    /// First byte of each row of the first pixel's patch.
    pub starts: &'a [usize],
    /// Bytes from one pixel to the next.
    pub stride: usize,
    /// Four-byte groups in a row.
    pub groups: usize,
    /// Weights, `starts.len() * groups * width * 4`.
    pub weights: &'a [u8],
}

impl Kernel {
    /// Number of pixels computed together against a panel of this width.
    #[doc(hidden)]
    pub const fn pixels_at_once(width: usize) -> usize {
        kernels::pixels_at_once(width)
    }

    /// Computes the bare matrix product: `acc[p][c] += Σ x[starts[r] + p*stride + 4g + b] * w[r][g][c][b]`.
    ///
    /// # Errors
    /// The name of the argument that does not fit; `acc` is unchanged then.
    #[doc(hidden)]
    pub fn matrix_product(&self, acc: &mut [i32], product: &MatrixProduct<'_>) -> Result<(), &'static str> {
        let &MatrixProduct { pixels, width, bytes, starts, stride, groups, weights } = product;
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
            let now = (pixels - done).min(kernels::pixels_at_once(width));
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

impl Runner<'_, '_> {
    /// Returns the current bytes of tensor `index` in the arena, from its first to its last.
    #[doc(hidden)]
    pub fn tensor_bytes(&self, index: u32) -> &[u8] {
        let tensor = self.model().tensor(index);
        part(self.arena(), tensor.offset, tensor.size_bytes())
    }
}
