//! Layer norm: one row of pixels, block by block.

use super::{Constants, Prepared};
use crate::nn::arena::{Arena, Row};
use crate::nn::file::LayerNorm;
use crate::nn::kernels::Isa;
use crate::nn::kernels::layer_norm::{Job, PIXELS};

/// Runs step `row`.
#[inline(always)]
pub(crate) fn run<I: Isa>(
    constants: &Constants<'_>,
    norm: &LayerNorm,
    prepared: &Prepared,
    arena: &mut Arena<'_>,
    row: usize,
) -> u64 {
    let (input, out) = (prepared.input(0), prepared.out);
    let m = norm.merge;
    let rows = [Row::of(&input, m * row), Row::of(&input, m * row + m - 1)];
    let job = Job {
        input: &input,
        out: &out,
        merge: m,
        gains: constants.slice(norm.gains, 4 * out.channels),
        biases: constants.slice(norm.biases, 8 * out.channels),
        shift: norm.shift,
        epsilon: norm.epsilon,
        rows,
        to: Row::of(&out, row),
    };
    let mut cut = 0;
    let mut col = 0;
    while col < out.cols {
        let pixels = (out.cols - col).min(PIXELS);
        cut += I::layer_norm(&job, arena.bytes, col, pixels);
        col += pixels;
    }
    arena.fill_margins(&out, row);
    cut
}
