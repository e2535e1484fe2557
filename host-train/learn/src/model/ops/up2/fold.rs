//! Kernels folded along an edge: the weights of five rows become those of one, for each of the two output rows along the edge.

use super::super::scratch::Scratch;
use super::shape::{KERNEL, SIDE};
use rayon::prelude::*;

/// Output rows of a strip.
pub(super) const OUT: usize = 2;
/// Least number of kernels for a separate task.
const MIN_KERNELS: usize = 512;

/// Shares of a kernel's rows, counted from the edge, in the folded kernel of each output row.
pub(super) type Fold = [[f32; SIDE]; OUT];

/// Shares at the first row (or column).
///
/// With kernel rows K0 to K4 and s the outermost small row: phases V0 = (K0 + K2 + K4) s and V1 = (K1 + K3) s beyond the edge add
/// (V0 + 3 V1) / 4 to output row 0, and V1 / 4 to row 1. Zeros take (K0 + K1) s from row 0, and K0 s from row 1.
pub(super) const FIRST: Fold = [[-0.75, -0.25, 0.25, 0.75, 0.25], [-1.0, 0.25, 0.0, 0.25, 0.0]];

/// Shares at the last row (or column). There is one phase row less beyond it.
///
/// With kernel rows counted from the edge as well: V0 = (K0 + K2 + K4) s adds V0 / 4 to output row 0. Zeros take the same as in
/// [`FIRST`].
pub(super) const LAST: Fold = [[-0.75, -1.0, 0.25, 0.0, 0.25], [-1.0, 0.0, 0.0, 0.0, 0.0]];

#[inline(always)]
fn weigh(shares: &[f32; SIDE], [a, b, c, d, e]: [f32; SIDE]) -> f32 {
    shares[0] * a + shares[1] * b + shares[2] * c + shares[3] * d + shares[4] * e
}

/// Folds every kernel of `weight`. `at(row, column)` is the index of a row and column in the kernel.
#[inline(always)]
pub(super) fn fold(weight: &[f32], shares: &'static Fold, at: impl Fn(usize, usize) -> usize + Copy + Sync) -> Scratch {
    let kernels = weight.len() / KERNEL;
    let mut folded = Scratch::new(OUT * kernels * SIDE);
    let (first, second) = folded.split_at_mut(kernels * SIDE);
    let to = first.par_chunks_exact_mut(SIDE).zip(second.par_chunks_exact_mut(SIDE));
    to.zip(weight.par_chunks_exact(KERNEL)).with_min_len(MIN_KERNELS).for_each(|((first, second), kernel)| {
        for x in 0..SIDE {
            let column: [f32; SIDE] = std::array::from_fn(|row| kernel[at(row, x)]);
            (first[x], second[x]) = (weigh(&shares[0], column), weigh(&shares[1], column));
        }
    });
    folded
}

/// Adds the gradient of the folded weights, unfolded, to the gradient of the weights. The rest is as in [`fold`].
#[inline(always)]
pub(super) fn unfold(
    folded: &[f32],
    whole: &mut [f32],
    shares: &'static Fold,
    at: impl Fn(usize, usize) -> usize + Copy + Sync,
) {
    let (first, second) = folded.split_at(whole.len() / KERNEL * SIDE);
    let from = first.par_chunks_exact(SIDE).zip(second.par_chunks_exact(SIDE));
    whole.par_chunks_exact_mut(KERNEL).zip(from).with_min_len(MIN_KERNELS).for_each(|(kernel, (first, second))| {
        for x in 0..SIDE {
            for row in 0..SIDE {
                kernel[at(row, x)] += shares[0][row] * first[x] + shares[1][row] * second[x];
            }
        }
    });
}
