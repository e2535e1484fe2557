//! Layer normalisation of tokens, each a row of channels.

use super::dense::{add_rows, parts, total};
use super::scratch::Scratch;
use pulp::Arch;
use rayon::prelude::*;

/// Added to the variance; the default of PyTorch and of Burn.
pub(super) const EPSILON: f32 = 1e-5;
/// Number of parallel sums, so that vectors can hold them.
const LANES: usize = 8;
/// Number of tokens of a piece of work.
const TILE: usize = 256;
/// Greatest number of parallel sums over tokens.
const GROUPS: usize = 8;

/// Returns the sum of products.
#[inline(always)]
pub(super) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let ((a, last_a), (b, last_b)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut lanes = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        for i in 0..LANES {
            lanes[i] += a[i] * b[i];
        }
    }
    let last: f32 = last_a.iter().zip(last_b).map(|(a, b)| a * b).sum();
    lanes.iter().sum::<f32>() + last
}

/// Returns the sum.
#[inline(always)]
fn sum(a: &[f32]) -> f32 {
    let (a, last) = a.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    for a in a {
        for i in 0..LANES {
            lanes[i] += a[i];
        }
    }
    lanes.iter().sum::<f32>() + last.iter().sum::<f32>()
}

/// Writes a token with mean 0 and variance 1 to `to`. Returns the factor by which it was scaled.
#[inline(always)]
pub(super) fn normalise(token: &[f32], to: &mut [f32]) -> f32 {
    let share = 1.0 / token.len() as f32;
    let mean = sum(token) * share;
    to.iter_mut().zip(token).for_each(|(to, x)| *to = x - mean);
    let scale = 1.0 / (dot(to, to) * share + EPSILON).sqrt();
    to.iter_mut().for_each(|to| *to *= scale);
    scale
}

/// Turns the gradient of a normalised token into the gradient of the token. `scale` is what [`normalise`] returned.
#[inline(always)]
pub(super) fn token_gradient(normalised: &[f32], scale: f32, gradient: &mut [f32]) {
    let share = 1.0 / normalised.len() as f32;
    let (mean, along) = (sum(gradient) * share, dot(gradient, normalised) * share);
    gradient.iter_mut().zip(normalised).for_each(|(g, x)| *g = scale * (*g - mean - x * along));
}

/// Normalises tokens `[.., C]`, then applies `weight` and `bias` `[C]`.
pub(super) fn forward(x: &[f32], [weight, bias]: [&[f32]; 2]) -> Vec<f32> {
    let (c, arch) = (weight.len(), Arch::new());
    let mut out = vec![0.0; x.len()];
    out.par_chunks_mut(TILE * c).zip(x.par_chunks(TILE * c)).for_each(|(out, x)| {
        arch.dispatch(|| {
            for (out, x) in out.chunks_exact_mut(c).zip(x.chunks_exact(c)) {
                normalise(x, out);
                out.iter_mut().zip(weight).zip(bias).for_each(|((out, w), b)| *out = *out * w + b);
            }
        });
    });
    out
}

/// Returns the gradients of the tokens, the weight and the bias.
pub(super) fn backward(x: &[f32], weight: &[f32], gradient: &[f32]) -> [Vec<f32>; 3] {
    let (c, arch) = (weight.len(), Arch::new());
    let mut out = vec![0.0; x.len()];
    let group = (x.len() / c).div_ceil(GROUPS).max(1) * c;
    let tokens = out.par_chunks_mut(group).zip(x.par_chunks(group)).zip(gradient.par_chunks(group));
    let sums: Vec<Vec<f32>> = tokens
        .map(|((out, x), gradient)| {
            let (mut sums, mut normalised) = (vec![0.0; 2 * c], Scratch::new(c));
            let [of_weight, of_bias] = parts(&mut sums, [c, c]);
            arch.dispatch(|| {
                for ((out, x), g) in out.chunks_exact_mut(c).zip(x.chunks_exact(c)).zip(gradient.chunks_exact(c)) {
                    let scale = normalise(x, &mut normalised);
                    back(&normalised, scale, weight, g, out, [of_weight, of_bias]);
                }
            });
            sums
        })
        .collect();
    let mut of_weight = total(sums);
    let of_bias = of_weight.split_off(c);
    [out, of_weight, of_bias]
}

/// Writes the gradient of one token to `out`, and adds those of weight and bias.
#[inline(always)]
pub(super) fn back(
    normalised: &[f32],
    scale: f32,
    weight: &[f32],
    gradient: &[f32],
    out: &mut [f32],
    [of_weight, of_bias]: [&mut [f32]; 2],
) {
    of_weight.iter_mut().zip(gradient).zip(normalised).for_each(|((to, g), x)| *to += g * x);
    add_rows(gradient, of_bias);
    out.iter_mut().zip(gradient).zip(weight).for_each(|((out, g), w)| *out = g * w);
    token_gradient(normalised, scale, out);
}
