//! The second half of a Swin block, on slices: `x + second(gelu(first(norm(x))))` of every token.
//!
//! Tokens are computed in tiles, of which everything fits a core's cache. The gradients compute a tile's hidden numbers again, which costs
//! less than to keep them.

use super::dense::{Left, add_product, add_rows, pack, pack_transposed, padded, parts, total, unpack};
use super::functions::{gelu, gelu_slope};
use super::layer_norm::{back, normalise};
use super::scratch::Scratch;
use pulp::Arch;
use rayon::prelude::*;

/// Number of tokens of a tile.
const TILE: usize = 64;
/// Greatest number of parallel sums over tiles.
const GROUPS: usize = 8;

/// Weights, with C channels and H hidden ones.
#[derive(Clone, Copy)]
pub(super) struct Weights<'a> {
    /// Weight and bias of the layer norm, `[C]`.
    pub(super) norm: [&'a [f32]; 2],
    /// Weight `[C, H]` and bias `[H]` of the first linear layer.
    pub(super) first: [&'a [f32]; 2],
    /// Weight `[H, C]` and bias `[C]` of the second linear layer.
    pub(super) second: [&'a [f32]; 2],
}

impl Weights<'_> {
    /// Returns C and H.
    fn sizes(&self) -> [usize; 2] {
        [self.norm[0].len(), self.first[1].len()]
    }
}

/// Writes the normalised tokens with weight and bias to padded rows.
#[inline(always)]
pub(super) fn normed_rows(normalised: &[f32], [weight, bias]: [&[f32]; 2], to: &mut [f32]) {
    let wide = padded(weight.len());
    for (to, x) in to.chunks_exact_mut(wide).zip(normalised.chunks_exact(wide)) {
        let (real, rest) = to.split_at_mut(weight.len());
        real.iter_mut().zip(x).zip(weight).zip(bias).for_each(|(((to, x), w), b)| *to = x * w + b);
        rest.fill(0.0);
    }
}

/// Fills padded rows with a bias.
#[inline(always)]
pub(super) fn fill_rows(bias: &[f32], rows: &mut [f32]) {
    for row in rows.chunks_exact_mut(padded(bias.len())) {
        let (real, rest) = row.split_at_mut(bias.len());
        real.copy_from_slice(bias);
        rest.fill(0.0);
    }
}

/// Computes normalised tokens, their scales, the norm's output and the hidden numbers before GELU.
fn hidden(arch: Arch, weights: &Weights, first: &[f32], x: &[f32], [unit, scales, normed, hidden]: [&mut [f32]; 4]) {
    let [c, h] = weights.sizes();
    let (wide, deep, rows) = (padded(c), padded(h), x.len() / c);
    arch.dispatch(|| {
        for ((x, to), scale) in x.chunks_exact(c).zip(unit.chunks_exact_mut(wide)).zip(&mut *scales) {
            *scale = normalise(x, &mut to[..c]);
        }
        normed_rows(&unit[..rows * wide], weights.norm, &mut normed[..rows * wide]);
        fill_rows(weights.first[1], &mut hidden[..rows * deep]);
    });
    add_product(arch, [rows, deep, c], Left::rows(normed, wide), (first, deep), (hidden, deep));
}

/// Maps tokens `[.., C]` to the same shape.
pub(super) fn forward(x: &[f32], weights: &Weights) -> Vec<f32> {
    let ([c, h], arch) = (weights.sizes(), Arch::new());
    let (wide, deep) = (padded(c), padded(h));
    let (first, second) = (pack(weights.first[0], h), pack(weights.second[0], c));
    let mut out = vec![0.0; x.len()];
    out.par_chunks_mut(TILE * c).zip(x.par_chunks(TILE * c)).for_each(|(out, x)| {
        let rows = x.len() / c;
        let mut memory = Scratch::new(TILE * (2 * wide + deep + 1));
        let [unit, normed, between, scales] = parts(&mut memory, [rows * wide, rows * wide, rows * deep, rows]);
        hidden(arch, weights, &first, x, [&mut *unit, scales, normed, &mut *between]);
        arch.dispatch(|| {
            between.iter_mut().for_each(|h| *h = gelu(*h));
            fill_rows(weights.second[1], unit);
        });
        add_product(arch, [rows, wide, h], Left::rows(between, deep), (&second, wide), (&mut *unit, wide));
        for ((out, x), y) in out.chunks_exact_mut(c).zip(x.chunks_exact(c)).zip(unit.chunks_exact(wide)) {
            out.iter_mut().zip(x).zip(y).for_each(|((out, x), y)| *out = x + y);
        }
    });
    out
}

/// Returns the gradients of the tokens, and of the weights in the order of [`Weights`].
pub(super) fn backward(x: &[f32], weights: &Weights, gradient: &[f32]) -> [Vec<f32>; 7] {
    let ([c, h], arch) = (weights.sizes(), Arch::new());
    let packed = Packed {
        first: pack(weights.first[0], h),
        first_transposed: pack_transposed(weights.first[0], h),
        second_transposed: pack_transposed(weights.second[0], c),
    };
    let group = (x.len() / c).div_ceil(TILE).div_ceil(GROUPS).max(1) * TILE * c;
    let mut out = vec![0.0; x.len()];
    let lengths = [c, c, c * padded(h), padded(h), h * padded(c), padded(c)];
    let tokens = out.par_chunks_mut(group).zip(x.par_chunks(group)).zip(gradient.par_chunks(group));
    let sums: Vec<Vec<f32>> = tokens
        .map(|((out, x), gradient)| {
            let mut sums = vec![0.0; lengths.iter().sum()];
            let tiles = out.chunks_mut(TILE * c).zip(x.chunks(TILE * c)).zip(gradient.chunks(TILE * c));
            for ((out, x), gradient) in tiles {
                tile(arch, weights, &packed, [x, gradient], out, parts(&mut sums, lengths));
            }
            sums
        })
        .collect();
    let mut sums = total(sums);
    let [norm, shift, first, first_bias, second, second_bias] = parts(&mut sums, lengths).map(|part| &*part);
    let (first, second) = (unpack(first, h), unpack(second, c));
    [out, norm.into(), shift.into(), first, first_bias[..h].into(), second, second_bias[..c].into()]
}

/// Weights as the gradients need them.
struct Packed {
    first: Scratch,
    first_transposed: Scratch,
    second_transposed: Scratch,
}

/// Writes the gradient of a tile of tokens to `out`, and adds those of the weights to `sums`.
fn tile(
    arch: Arch,
    weights: &Weights,
    packed: &Packed,
    [x, gradient]: [&[f32]; 2],
    out: &mut [f32],
    [of_norm, of_shift, of_first, of_first_bias, of_second, of_second_bias]: [&mut [f32]; 6],
) {
    let [c, h] = weights.sizes();
    let (wide, deep, rows) = (padded(c), padded(h), x.len() / c);
    let mut memory = Scratch::new(TILE * (3 * wide + 3 * deep + 1));
    let [unit, normed, slope, between, active, of_hidden, scales] =
        parts(&mut memory, [rows * wide, rows * wide, rows * wide, rows * deep, rows * deep, rows * deep, rows]);
    hidden(arch, weights, &packed.first, x, [&mut *unit, &mut *scales, &mut *normed, &mut *between]);
    arch.dispatch(|| {
        for (to, g) in slope.chunks_exact_mut(wide).zip(gradient.chunks_exact(c)) {
            to[..c].copy_from_slice(g);
            to[c..].fill(0.0);
        }
        active.iter_mut().zip(&*between).for_each(|(to, h)| *to = gelu(*h));
        of_hidden.fill(0.0);
        add_rows(slope, of_second_bias);
    });
    add_product(arch, [h, wide, rows], Left::columns(active, deep), (slope, wide), (of_second, wide));
    add_product(arch, [rows, deep, c], Left::rows(slope, wide), (&packed.second_transposed, deep), (of_hidden, deep));
    arch.dispatch(|| {
        of_hidden.iter_mut().zip(&*between).for_each(|(to, h)| *to *= gelu_slope(*h));
        add_rows(of_hidden, of_first_bias);
    });
    add_product(arch, [c, deep, rows], Left::columns(normed, wide), (of_hidden, deep), (of_first, deep));
    normed.fill(0.0);
    let of_normed = normed;
    let transposed = (&*packed.first_transposed, wide);
    add_product(arch, [rows, wide, h], Left::rows(of_hidden, deep), transposed, (&mut *of_normed, wide));
    arch.dispatch(|| {
        let tokens = out.chunks_exact_mut(c).zip(gradient.chunks_exact(c)).zip(&*scales);
        let rows = unit.chunks_exact(wide).zip(of_normed.chunks_exact(wide));
        for (((out, g), &scale), (unit, normed)) in tokens.zip(rows) {
            back(&unit[..c], scale, weights.norm[0], &normed[..c], out, [&mut *of_norm, &mut *of_shift]);
            add_rows(g, out);
        }
    });
}
