//! Window attention: one head in one window.
//!
//! Scratch holds q and k `[tokens][head channels]`, v transposed `[head channels][tokens]` and one row of exponentials, all i16
//! and padded with zeros. The softmax is not normalised before it meets v: the weighted sum of v is divided by the sum of the
//! exponentials afterwards, by one integer reciprocal per query.

use super::saturate;
use crate::nn::arena::{Arena, value};
use crate::nn::kernels::{Kernel, Le16, padded};
use crate::nn::model::{MAX_WINDOW, Model};
use crate::nn::program::{Attention, Tensor};
use crate::quant::lut::exp_lookup;
use crate::quant::round_shift;

/// Logits are cut here; far beyond any table.
const LOGIT_LIMIT: i64 = 1 << 24;
/// Bits of the reciprocal of the sum of exponentials.
const RECIPROCAL_BITS: u32 = 46;
/// Fraction bits of the weighted mean of v.
pub(crate) const FRACTION_BITS: u32 = 16;

/// One window: where its tokens lie.
struct Window {
    rows: usize,
    cols: usize,
    padded_rows: usize,
    padded_cols: usize,
    row: usize,
    col: usize,
    side: usize,
    shift_rows: usize,
    shift_cols: usize,
}

impl Window {
    fn new(a: &Attention, out: &Tensor, index: usize) -> Self {
        let (down, across) = (out.rows.div_ceil(a.window), out.cols.div_ceil(a.window));
        Self {
            rows: out.rows,
            cols: out.cols,
            padded_rows: down * a.window,
            padded_cols: across * a.window,
            row: index / across * a.window,
            col: index % across * a.window,
            side: a.window,
            shift_rows: a.shift_rows,
            shift_cols: a.shift_cols,
        }
    }

    /// Pixel number of a token, or `None` in the padding.
    fn pixel(&self, token: usize) -> Option<usize> {
        let row = (self.row + token / self.side + self.shift_rows) % self.padded_rows;
        let col = (self.col + token % self.side + self.shift_cols) % self.padded_cols;
        (row < self.rows && col < self.cols).then_some(row * self.cols + col)
    }

    /// Tokens attend each other only within one region: the cyclic shift brings pixels together that are no neighbours.
    fn region(&self, token: usize) -> usize {
        let band =
            |at: usize, len: usize, shift: usize| (at >= len - self.side) as usize + (at >= len - shift) as usize;
        3 * band(self.row + token / self.side, self.padded_rows, self.shift_rows)
            + band(self.col + token % self.side, self.padded_cols, self.shift_cols)
    }
}

/// Scratch memory by name.
struct Scratch<'s> {
    q: &'s mut [Le16],
    k: &'s mut [Le16],
    v: &'s mut [Le16],
    exp: &'s mut [Le16],
}

impl<'s> Scratch<'s> {
    fn new(scratch: &'s mut [Le16], tokens: usize, head: usize) -> Self {
        let (q, rest) = scratch.split_at_mut(tokens * padded(head));
        let (k, rest) = rest.split_at_mut(tokens * padded(head));
        let (v, rest) = rest.split_at_mut(head * padded(tokens));
        Self { q, k, v, exp: &mut rest[..padded(tokens)] }
    }
}

/// Runs unit `unit` (windows row-major, heads fastest).
pub(crate) fn run(kernel: &Kernel, model: &Model<'_>, a: &Attention, arena: &mut Arena<'_>, unit: usize) -> u64 {
    let out = model.tensor(a.out);
    let (window, head) = (Window::new(a, &out, unit / a.heads), unit % a.heads);
    let (tokens, channels) = (a.window * a.window, out.channels / a.heads);
    gather(model, a, arena, &window, head);
    let multiplier = model.constant_i32(a.multipliers, head) as i64;
    let mut saturated = 0;
    for query in 0..tokens {
        let Some(pixel) = window.pixel(query) else { continue };
        let mut s = Scratch::new(arena.scratch, tokens, channels);
        let sum = exponentials(kernel, model, a, &window, head, query, &mut s);
        let reciprocal = (1i64 << RECIPROCAL_BITS) / sum;
        for channel in 0..channels {
            let s = Scratch::new(arena.scratch, tokens, channels);
            let weighted = (kernel.dot)(s.exp, &s.v[channel * padded(tokens)..(channel + 1) * padded(tokens)]);
            let mean = round_shift(weighted as i64 * reciprocal, RECIPROCAL_BITS - FRACTION_BITS);
            let (code, cut) = saturate(round_shift(mean * multiplier, a.shift), &out);
            arena.store(&out, pixel * out.channels + head * channels + channel, code);
            saturated += cut as u64;
        }
    }
    saturated
}

/// Brings q, k and v of one head into scratch.
fn gather(model: &Model<'_>, a: &Attention, arena: &mut Arena<'_>, window: &Window, head: usize) {
    let (input, out) = (model.tensor(a.input), model.tensor(a.out));
    let (tokens, channels) = (a.window * a.window, out.channels / a.heads);
    let Arena { tensors, scratch } = arena;
    let s = Scratch::new(scratch, tokens, channels);
    [&mut *s.q, &mut *s.k, &mut *s.v, &mut *s.exp].into_iter().for_each(|part| part.fill([0; 2]));
    let pad = model.constants(a.pad_codes, 2 * input.channels).as_chunks::<2>().0;
    for token in 0..tokens {
        let pixel = window.pixel(token);
        for part in 0..3 {
            for channel in 0..channels {
                let from = part * out.channels + head * channels + channel;
                let sample = match pixel {
                    Some(pixel) => (value(tensors, &input, pixel * input.channels + from) as i16).to_le_bytes(),
                    None => pad[from],
                };
                match part {
                    0 => s.q[token * padded(channels) + channel] = sample,
                    1 => s.k[token * padded(channels) + channel] = sample,
                    _ => s.v[channel * padded(tokens) + token] = sample,
                }
            }
        }
    }
}

/// Fills the row of exponentials of one query; returns their sum, which is at least the table's first entry.
fn exponentials(
    kernel: &Kernel,
    model: &Model<'_>,
    a: &Attention,
    window: &Window,
    head: usize,
    query: usize,
    s: &mut Scratch<'_>,
) -> i64 {
    let table = model.constants(a.exp_table, 2 * a.exp_len).as_chunks().0;
    let (tokens, side) = (a.window * a.window, 2 * a.window - 1);
    let width = s.q.len() / tokens;
    let multiplier = model.constant_i32(a.logit_multipliers, head) as i64;
    let bias = model.constants(a.position_bias + 2 * head * side * side, 2 * side * side).as_chunks::<2>().0;
    let q = &s.q[query * width..(query + 1) * width];
    let region = window.region(query);
    let (mut logits, mut largest) = ([None::<i32>; MAX_WINDOW * MAX_WINDOW], i32::MIN);
    for (key, logit) in logits[..tokens].iter_mut().enumerate() {
        if window.region(key) != region {
            continue;
        }
        let acc = (kernel.dot)(q, &s.k[key * width..(key + 1) * width]) as i64;
        let product = round_shift(acc * multiplier, a.logit_shift).clamp(-LOGIT_LIMIT, LOGIT_LIMIT) as i32;
        let (down, across) = (query / a.window + a.window - 1, query % a.window + a.window - 1);
        let index = (down - key / a.window) * side + across - key % a.window;
        let value = product + i16::from_le_bytes(bias[index]) as i32;
        (*logit, largest) = (Some(value), largest.max(value));
    }
    let mut sum = 0;
    for (exp, logit) in s.exp.iter_mut().zip(&logits[..tokens]) {
        let value = logit.map_or(0, |logit| exp_lookup(table, largest - logit));
        *exp = value.to_le_bytes();
        sum += value as i64;
    }
    sum.max(1)
}
