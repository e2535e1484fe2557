//! The first half of a Swin block, on slices: `x + attention(norm(x))`, with attention inside shifted windows.
//!
//! Windows are computed one by one. Everything of a window fits a core's cache, and the gradients compute it again, which costs less than
//! to keep it. The queries' scale is in their weights. Each head's channels are padded to whole vectors.

use super::dense::{Left, add_product, add_rows, padded, parts, total, transpose, unpack};
use super::functions::exp;
use super::layer_norm::{back, normalise};
use super::perceptron::{fill_rows, normed_rows};
use super::scratch::Scratch;
use crate::model::swin::windows::WindowPlan;
use pulp::Arch;
use rayon::prelude::*;

/// Greatest number of parallel sums over windows.
const GROUPS: usize = 8;
/// Position of a padded token.
const NOWHERE: usize = usize::MAX;

/// Sizes of the operator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shape {
    /// Images.
    pub(super) images: usize,
    /// Rows and columns of tokens.
    pub(super) tokens: [usize; 2],
    /// Channels.
    pub(super) channels: usize,
    /// Heads.
    pub(super) heads: usize,
    /// The windows.
    pub(super) plan: WindowPlan,
}

/// Weights, with C channels.
#[derive(Clone, Copy)]
pub(super) struct Weights<'a> {
    /// Weight and bias of the layer norm, `[C]`.
    pub(super) norm: [&'a [f32]; 2],
    /// Weight `[C, 3 C]` and bias `[3 C]` of queries, keys and values.
    pub(super) qkv: [&'a [f32]; 2],
    /// Relative position bias, `[(2 window - 1)², heads]`.
    pub(super) table: &'a [f32],
    /// Row of `table` for each pair of query and key.
    pub(super) index: &'a [usize],
    /// Weight `[C, C]` and bias `[C]` of the projection.
    pub(super) projection: [&'a [f32]; 2],
}

/// Sizes of one window's matrices.
#[derive(Clone, Copy)]
struct Sizes {
    /// Tokens.
    n: usize,
    /// Tokens, padded.
    keys: usize,
    /// Channels.
    c: usize,
    /// Channels, padded.
    wide: usize,
    heads: usize,
    /// Channels of a head.
    depth: usize,
    /// Channels of a head, padded.
    deep: usize,
    /// Padded channels of all heads.
    all: usize,
}

impl Shape {
    fn sizes(&self) -> Sizes {
        let (c, heads, n) = (self.channels, self.heads, self.plan.window * self.plan.window);
        let deep = padded(c / heads);
        Sizes { n, keys: padded(n), c, wide: padded(c), heads, depth: c / heads, deep, all: heads * deep }
    }

    /// Returns the position in the map of each window's tokens, or [`NOWHERE`], window by window of one image.
    fn places(&self) -> Vec<usize> {
        let WindowPlan { window, padded, shift } = self.plan;
        let ([h, w], corners) = (self.tokens, self.corners());
        let inside = (0..window * window).map(|i| [i / window, i % window]);
        let place = move |[top, left]: [usize; 2], [y, x]: [usize; 2]| {
            let (y, x) = ((top + y + shift[0]) % padded[0], (left + x + shift[1]) % padded[1]);
            if y < h && x < w { y * w + x } else { NOWHERE }
        };
        corners.flat_map(|corner| inside.clone().map(move |at| place(corner, at))).collect()
    }

    /// Returns the first token of each window of an image, in the shifted map.
    fn corners(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let WindowPlan { window, padded: [rows, cols], .. } = self.plan;
        (0..rows).step_by(window).flat_map(move |top| (0..cols).step_by(window).map(move |left| [top, left]))
    }

    /// Returns the region of each window's tokens, window by window of one image. Attention stays within a region.
    fn regions(&self) -> Vec<usize> {
        let window = self.plan.window;
        let region = |[top, left]: [usize; 2], i: usize| self.plan.region(top + i / window, left + i % window);
        self.corners().flat_map(|corner| (0..window * window).map(move |i| region(corner, i))).collect()
    }
}

/// Everything that windows have in common.
struct Common<'a> {
    arch: Arch,
    sizes: Sizes,
    weights: Weights<'a>,
    places: Vec<usize>,
    regions: Vec<usize>,
    /// `[C, 3, heads, depth]`, padded, with the queries' scale.
    qkv: Scratch,
    /// `[3, heads, depth]`, padded, with the queries' scale.
    qkv_bias: Vec<f32>,
    /// `[heads, depth, C]`, padded.
    projection: Scratch,
    /// `[heads, queries, keys]`, padded.
    bias: Scratch,
}

impl<'a> Common<'a> {
    fn new(shape: &Shape, weights: Weights<'a>) -> Self {
        let sizes = shape.sizes();
        let Sizes { n, keys, c, wide, heads, depth, deep, all } = sizes;
        let scale = (depth as f32).powf(-0.5);
        let pad = |from: &[f32], to: &mut [f32]| {
            for (i, (to, from)) in to.chunks_exact_mut(deep).zip(from.chunks_exact(depth)).enumerate() {
                let factor = if i < heads { scale } else { 1.0 };
                to.iter_mut().zip(from).for_each(|(to, from)| *to = factor * from);
                to[depth..].fill(0.0);
            }
        };
        let (mut qkv, mut qkv_bias) = (Scratch::new(c * 3 * all), vec![0.0; 3 * all]);
        for (to, from) in qkv.chunks_exact_mut(3 * all).zip(weights.qkv[0].chunks_exact(3 * c)) {
            pad(from, to);
        }
        pad(weights.qkv[1], &mut qkv_bias);
        let mut projection = Scratch::new(all * wide);
        projection.fill(0.0);
        for (i, row) in weights.projection[0].chunks_exact(c).enumerate() {
            projection[(i / depth * deep + i % depth) * wide..][..c].copy_from_slice(row);
        }
        let mut bias = Scratch::new(heads * n * keys);
        for (i, row) in bias.chunks_exact_mut(keys).enumerate() {
            let (head, query) = (i / n, i % n);
            row.iter_mut()
                .zip(&weights.index[query * n..][..n])
                .for_each(|(b, i)| *b = weights.table[i * heads + head]);
            row[n..].fill(0.0);
        }
        let (places, regions, arch) = (shape.places(), shape.regions(), Arch::new());
        Self { arch, sizes, weights, places, regions, qkv, qkv_bias, projection, bias }
    }

    /// Returns the number of windows of an image.
    fn windows(&self) -> usize {
        self.places.len() / self.sizes.n
    }

    fn places_of(&self, window: usize) -> &[usize] {
        &self.places[window % self.windows() * self.sizes.n..][..self.sizes.n]
    }

    /// Computes one window as far as the heads' mixtures of values. `image` are the tokens of its image.
    fn mix(&self, window: usize, image: &[f32], state: &mut State) {
        let Self { arch, sizes, ref weights, .. } = *self;
        let Sizes { n, keys, c, wide, depth, deep, all, heads } = sizes;
        arch.dispatch(|| {
            for ((i, to), scale) in
                self.places_of(window).iter().zip(state.unit.chunks_exact_mut(wide)).zip(&mut *state.scales)
            {
                match *i {
                    NOWHERE => to.fill(0.0),
                    i => *scale = normalise(&image[i * c..][..c], &mut to[..c]),
                }
            }
            normed_rows(state.unit, weights.norm, state.normed);
            for (i, to) in self.places_of(window).iter().zip(state.normed.chunks_exact_mut(wide)) {
                if *i == NOWHERE {
                    to.fill(0.0);
                }
            }
            fill_rows(&self.qkv_bias, state.qkv);
            state.scores.copy_from_slice(&self.bias);
            state.mixed.fill(0.0);
        });
        add_product(arch, [n, 3 * all, c], Left::rows(state.normed, wide), (&self.qkv, 3 * all), (state.qkv, 3 * all));
        let regions = &self.regions[window % self.windows() * n..][..n];
        let divided = regions.iter().any(|region| *region != regions[0]);
        for head in 0..heads {
            let scores = &mut state.scores[head * n * keys..][..n * keys];
            let [queries, key, values] = [0, 1, 2].map(|part| part * all + head * deep);
            transpose((&state.qkv[key..], 3 * all), [n, depth], state.turned);
            let queries = Left::rows(&state.qkv[queries..], 3 * all);
            add_product(arch, [n, keys, depth], queries, (state.turned, keys), (scores, keys));
            if divided {
                mask(regions, scores, keys);
            }
            arch.dispatch(|| scores.chunks_exact_mut(keys).for_each(|row| softmax(&mut row[..n])));
            let (values, mixed) = ((&state.qkv[values..], 3 * all), (&mut state.mixed[head * deep..], all));
            add_product(arch, [n, deep, n], Left::rows(scores, keys), values, mixed);
        }
    }
}

/// Lowers the scores between tokens of different regions, as [`WindowPlan::mask`] does.
fn mask(regions: &[usize], scores: &mut [f32], keys: usize) {
    for (row, query) in scores.chunks_exact_mut(keys).zip(regions) {
        row.iter_mut().zip(regions).for_each(|(score, key)| *score -= if query == key { 0.0 } else { 100.0 });
    }
}

/// Turns scores into shares.
#[inline(always)]
fn softmax(row: &mut [f32]) {
    const LANES: usize = 16;
    let (body, last) = row.as_chunks_mut::<LANES>();
    let mut most = [f32::NEG_INFINITY; LANES];
    for x in &*body {
        for i in 0..LANES {
            most[i] = most[i].max(x[i]);
        }
    }
    let most = most.iter().chain(&*last).fold(f32::NEG_INFINITY, |a, b| a.max(*b));
    let mut sums = [0.0; LANES];
    for x in &mut *body {
        for i in 0..LANES {
            x[i] = exp(x[i] - most);
            sums[i] += x[i];
        }
    }
    let mut sum: f32 = sums.iter().sum();
    for x in last {
        *x = exp(*x - most);
        sum += *x;
    }
    let share = 1.0 / sum;
    row.iter_mut().for_each(|x| *x *= share);
}

/// Working memory of a window.
struct State<'a> {
    /// Normalised tokens, `[n, C]`.
    unit: &'a mut [f32],
    /// Their scales, `[n]`.
    scales: &'a mut [f32],
    /// The norm's output, `[n, C]`.
    normed: &'a mut [f32],
    /// Queries, keys and values, `[n, 3, heads, depth]`.
    qkv: &'a mut [f32],
    /// A transposed matrix of one head, `[depth, n]`.
    turned: &'a mut [f32],
    /// Scores, then shares, `[heads, n, n]`.
    scores: &'a mut [f32],
    /// Mixtures of values, `[n, heads, depth]`.
    mixed: &'a mut [f32],
}

impl Sizes {
    /// Lengths of [`State`]'s parts.
    fn lengths(&self) -> [usize; 7] {
        let Self { n, keys, wide, deep, all, heads, .. } = *self;
        [n * wide, n, n * wide, n * 3 * all, deep * keys, heads * n * keys, n * all]
    }
}

impl<'a> State<'a> {
    fn new(sizes: &Sizes, memory: &'a mut [f32]) -> Self {
        let [unit, scales, normed, qkv, turned, scores, mixed] = parts(memory, sizes.lengths());
        scales.fill(0.0);
        // The padding, which nothing else writes.
        unit.fill(0.0);
        Self { unit, scales, normed, qkv, turned, scores, mixed }
    }
}

/// Returns the ranges of windows that are computed together.
fn groups(windows: usize) -> (usize, usize) {
    let per_group = windows.div_ceil(GROUPS).max(1);
    (windows.div_ceil(per_group), per_group)
}

/// Copies windows `[windows, n, C]` to their places in the map, with `x` added.
fn gather(shape: &Shape, common: &Common, windows: &[f32], x: &[f32]) -> Vec<f32> {
    let (Sizes { c, n, .. }, [h, w]) = (common.sizes, shape.tokens);
    let (map, all) = (h * w * c, common.windows() * n * c);
    let mut out = vec![0.0; x.len()];
    out.par_chunks_mut(map).zip(x.par_chunks(map)).zip(windows.par_chunks(all)).for_each(|((out, x), windows)| {
        for (&place, y) in common.places.iter().zip(windows.chunks_exact(c)).filter(|(place, _)| **place != NOWHERE) {
            let at = place * c..(place + 1) * c;
            out[at.clone()].iter_mut().zip(&x[at]).zip(y).for_each(|((out, x), y)| *out = x + y);
        }
    });
    out
}

/// Maps tokens `[B, H, W, C]` to the same shape.
pub(super) fn forward(shape: &Shape, x: &[f32], weights: Weights) -> Vec<f32> {
    let common = Common::new(shape, weights);
    let Sizes { n, c, wide, all, .. } = common.sizes;
    let (map, count) = (shape.tokens[0] * shape.tokens[1] * c, shape.images * common.windows());
    let (_, per_group) = groups(count);
    let mut windows = Scratch::new(count * n * c);
    windows.par_chunks_mut(per_group * n * c).enumerate().for_each(|(group, out)| {
        let mut memory = Scratch::new(common.sizes.lengths().iter().sum::<usize>() + n * wide);
        let (memory, projected) = memory.split_at_mut(common.sizes.lengths().iter().sum());
        let mut state = State::new(&common.sizes, memory);
        for (i, out) in out.chunks_exact_mut(n * c).enumerate() {
            let window = group * per_group + i;
            common.mix(window, &x[window / common.windows() * map..][..map], &mut state);
            fill_rows(weights.projection[1], projected);
            let product = (&*common.projection, wide);
            add_product(common.arch, [n, wide, all], Left::rows(state.mixed, all), product, (projected, wide));
            for (out, from) in out.chunks_exact_mut(c).zip(projected.chunks_exact(wide)) {
                out.copy_from_slice(&from[..c]);
            }
        }
    });
    gather(shape, &common, &windows, x)
}

/// Returns the gradients of the tokens, and of the weights in the order of [`Weights`].
pub(super) fn backward(shape: &Shape, x: &[f32], weights: Weights, gradient: &[f32]) -> [Vec<f32>; 8] {
    let common = Common::new(shape, weights);
    let Sizes { n, keys, c, wide, heads, depth, deep, all } = common.sizes;
    let mut qkv_transposed = Scratch::new(3 * all * wide);
    transpose((&common.qkv, 3 * all), [c, 3 * all], &mut qkv_transposed);
    let mut projection_transposed = Scratch::new(c * all);
    transpose((&common.projection, wide), [all, c], &mut projection_transposed);
    let back = Back { common: &common, qkv_transposed, projection_transposed };
    let (map, count) = (shape.tokens[0] * shape.tokens[1] * c, shape.images * common.windows());
    let (_, per_group) = groups(count);
    let lengths = [c, c, c * 3 * all, 3 * all, heads * n * keys, all * wide, wide];
    let mut windows = Scratch::new(count * n * c);
    let sums: Vec<Vec<f32>> = windows
        .par_chunks_mut(per_group * n * c)
        .enumerate()
        .map(|(group, out)| {
            let mut sums = vec![0.0; lengths.iter().sum()];
            let mut memory =
                Scratch::new(common.sizes.lengths().iter().sum::<usize>() + back.lengths().iter().sum::<usize>());
            let (memory, more) = memory.split_at_mut(common.sizes.lengths().iter().sum());
            let mut state = State::new(&common.sizes, memory);
            for (i, out) in out.chunks_exact_mut(n * c).enumerate() {
                let window = group * per_group + i;
                let [image, slope] = [x, gradient].map(|x| &x[window / common.windows() * map..][..map]);
                back.window(
                    window,
                    [image, slope],
                    &mut state,
                    parts(more, back.lengths()),
                    (out, parts(&mut sums, lengths)),
                );
            }
            sums
        })
        .collect();
    let out = gather(shape, &common, &windows, gradient);
    let mut sums = total(sums);
    let [norm, shift, qkv, qkv_bias, bias, projection, projection_bias] = parts(&mut sums, lengths).map(|part| &*part);
    let scale = (depth as f32).powf(-0.5);
    let unpad = |from: &[f32]| -> Vec<f32> {
        let heads_of = |row: &[f32]| -> Vec<f32> {
            let real = row.chunks_exact(deep).enumerate().map(|(i, head)| (if i < heads { scale } else { 1.0 }, head));
            real.flat_map(|(factor, head)| head[..depth].iter().map(move |x| factor * x)).collect()
        };
        from.chunks_exact(3 * all).flat_map(heads_of).collect()
    };
    let mut table = vec![0.0; weights.table.len()];
    for (i, row) in bias.chunks_exact(keys).enumerate() {
        for (x, at) in row.iter().zip(&weights.index[i % n * n..][..n]) {
            table[at * heads + i / n] += x;
        }
    }
    let of_heads = projection.chunks_exact(deep * wide).flat_map(|head| &head[..depth * wide]).copied();
    let projection = unpack(&of_heads.collect::<Vec<f32>>(), c);
    let projection_bias = projection_bias[..c].into();
    [out, norm.into(), shift.into(), unpad(qkv), unpad(qkv_bias), table, projection, projection_bias]
}

/// What the gradients need besides.
struct Back<'a> {
    common: &'a Common<'a>,
    /// `[3, heads, depth, C]`, padded.
    qkv_transposed: Scratch,
    /// `[C, heads, depth]`, padded.
    projection_transposed: Scratch,
}

impl Back<'_> {
    /// Lengths of a window's gradients: of its output, mixtures, queries with keys and values, one head's shares, and the norm's output.
    fn lengths(&self) -> [usize; 5] {
        let Sizes { n, keys, wide, all, .. } = self.common.sizes;
        [n * wide, n * all, n * 3 * all, n * keys, n * wide]
    }

    /// Writes the gradient of a window's tokens, without that of the residual connection, to `out`, and adds those of the weights.
    fn window(
        &self,
        window: usize,
        [image, gradient]: [&[f32]; 2],
        state: &mut State,
        [slope, of_mixed, of_qkv, of_shares, of_normed]: [&mut [f32]; 5],
        (out, sums): (&mut [f32], [&mut [f32]; 7]),
    ) {
        let [of_norm, of_shift, of_qkv_weight, of_qkv_bias, of_bias, of_projection, of_projection_bias] = sums;
        let Common { arch, sizes, ref weights, .. } = *self.common;
        let Sizes { n, keys, c, wide, heads, depth, deep, all } = sizes;
        self.common.mix(window, image, state);
        let places = self.common.places_of(window);
        for (i, to) in places.iter().zip(slope.chunks_exact_mut(wide)) {
            let real = if *i == NOWHERE { 0 } else { c };
            to[real..].fill(0.0);
            if real > 0 {
                to[..c].copy_from_slice(&gradient[i * c..][..c]);
            }
        }
        [&mut *of_mixed, &mut *of_qkv, &mut *of_normed].into_iter().for_each(|part| part.fill(0.0));
        arch.dispatch(|| add_rows(slope, of_projection_bias));
        add_product(arch, [all, wide, n], Left::columns(state.mixed, all), (slope, wide), (of_projection, wide));
        let transposed = (&*self.projection_transposed, all);
        add_product(arch, [n, all, c], Left::rows(slope, wide), transposed, (&mut *of_mixed, all));
        for head in 0..heads {
            let shares = &state.scores[head * n * keys..][..n * keys];
            let [queries, key, values] = [0, 1, 2].map(|part| part * all + head * deep);
            let mixed = &of_mixed[head * deep..];
            transpose((&state.qkv[values..], 3 * all), [n, depth], state.turned);
            of_shares.fill(0.0);
            add_product(arch, [n, keys, depth], Left::rows(mixed, all), (state.turned, keys), (of_shares, keys));
            add_product(
                arch,
                [n, deep, n],
                Left::columns(shares, keys),
                (mixed, all),
                (&mut of_qkv[values..], 3 * all),
            );
            let of_bias = &mut of_bias[head * n * keys..][..n * keys];
            arch.dispatch(|| scores_gradient(shares, of_shares, of_bias, [n, keys]));
            let scores = &*of_shares;
            let qkv = |part: usize| (&state.qkv[part..], 3 * all);
            add_product(arch, [n, deep, n], Left::rows(scores, keys), qkv(key), (&mut of_qkv[queries..], 3 * all));
            add_product(arch, [n, deep, n], Left::columns(scores, keys), qkv(queries), (&mut of_qkv[key..], 3 * all));
        }
        arch.dispatch(|| add_rows(of_qkv, of_qkv_bias));
        add_product(
            arch,
            [c, 3 * all, n],
            Left::columns(state.normed, wide),
            (of_qkv, 3 * all),
            (of_qkv_weight, 3 * all),
        );
        let transposed = (&*self.qkv_transposed, wide);
        add_product(arch, [n, wide, 3 * all], Left::rows(of_qkv, 3 * all), transposed, (&mut *of_normed, wide));
        arch.dispatch(|| {
            let rows = state.unit.chunks_exact(wide).zip(of_normed.chunks_exact(wide)).zip(&*state.scales);
            for ((i, out), ((unit, normed), &scale)) in places.iter().zip(out.chunks_exact_mut(c)).zip(rows) {
                if *i != NOWHERE {
                    back(&unit[..c], scale, weights.norm[0], &normed[..c], out, [&mut *of_norm, &mut *of_shift]);
                }
            }
        });
    }
}

/// Turns the gradient of one head's shares into that of its scores, and adds it to that of the bias.
#[inline(always)]
fn scores_gradient(shares: &[f32], gradient: &mut [f32], of_bias: &mut [f32], [n, keys]: [usize; 2]) {
    let rows = shares.chunks_exact(keys).zip(gradient.chunks_exact_mut(keys)).zip(of_bias.chunks_exact_mut(keys));
    for ((shares, gradient), bias) in rows {
        let (shares, gradient) = (&shares[..n], &mut gradient[..n]);
        let along = super::layer_norm::dot(shares, gradient);
        for ((g, s), bias) in gradient.iter_mut().zip(shares).zip(bias) {
            *g = s * (*g - along);
            *bias += *g;
        }
    }
}
