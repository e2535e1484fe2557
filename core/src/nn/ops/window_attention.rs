//! Window attention: all heads of one window.
//!
//! ```text
//! for every head
//!     pack k: a panel per 32 keys    [group of 4 channels][key][4], code - 128 as i8
//!     pack v: a panel per 32 channels [group of 4 keys][channel][4]
//!     for every row of the window that lies in the map
//!         logits = q · k                       the convolutions' kernel: q is read where it lies
//!         e = exp(logit - largest)             by table; 15 bits, stored as two planes of u8
//!         mean = (e · v) / Σe                  the same kernel, once per plane; one integer reciprocal per query
//! ```
//! The softmax is not normalised before it meets v.

use super::saturate;
use crate::nn::arena::{Arena, OVERREAD, Row};
use crate::nn::kernels::{ACCUMULATORS, Accumulators, Isa, PANEL, Patch, panelled, panels};
use crate::nn::model::{MAX_WINDOW, Model};
use crate::nn::program::{Attention, Tensor, groups};
use crate::quant::lut::exp_lookup;
use crate::quant::round_shift;

/// Logits are cut here; far beyond any table.
const LOGIT_LIMIT: i64 = 1 << 24;
/// Bits of the reciprocal of the sum of exponentials.
const RECIPROCAL_BITS: u32 = 46;
/// Fraction bits of the weighted mean of v.
pub(crate) const FRACTION_BITS: u32 = 16;
/// Tokens of the largest window.
const MAX_TOKENS: usize = MAX_WINDOW * MAX_WINDOW;

/// Sizes of the scratch memory's parts.
#[derive(Clone, Copy)]
pub(crate) struct Layout {
    keys: usize,
    values: usize,
    row: usize,
}

impl Layout {
    /// For windows of `tokens` and heads of `channels`.
    #[inline(always)]
    pub(crate) const fn new(tokens: usize, channels: usize) -> Self {
        Self {
            keys: 4 * groups(channels) * panelled(tokens),
            values: 4 * groups(tokens) * panelled(channels),
            row: 4 * groups(tokens),
        }
    }

    /// Bytes together: packed keys, packed values, two planes of exponentials for a row of queries.
    pub(crate) const fn bytes(&self) -> usize {
        self.keys + self.values + 2 * MAX_WINDOW * self.row + OVERREAD
    }
}

/// One window: rows and columns of the filled-up map.
struct Window<'a> {
    a: &'a Attention,
    input: &'a Tensor,
    rows: (usize, usize),
    cols: (usize, usize),
}

impl Window<'_> {
    #[inline(always)]
    fn width(&self) -> usize {
        self.cols.1 - self.cols.0
    }

    #[inline(always)]
    fn tokens(&self) -> usize {
        self.width() * (self.rows.1 - self.rows.0)
    }

    /// Place in the arena of sample `channel` of a token, or `None` in the padding.
    #[inline(always)]
    fn place(&self, token: usize, channel: usize) -> Option<usize> {
        let (row, col) = (self.rows.0 + token / self.width(), self.cols.0 + token % self.width());
        let t = self.input;
        (row < t.rows && col < t.cols).then(|| t.row_offset(row) + (t.margin + col) * t.channels + channel)
    }
}

/// Runs unit `unit` (column piece) of step `step` (row piece).
#[inline(always)]
pub(crate) fn run<I: Isa>(model: &Model<'_>, a: &Attention, arena: &mut Arena<'_>, step: usize, unit: usize) -> u64 {
    let (input, out) = (model.tensor(a.input), model.tensor(a.out));
    let (rows, cols) = (a.piece(out.rows, a.shift_rows, step), a.piece(out.cols, a.shift_cols, unit));
    let window = Window { a, input: &input, rows, cols };
    let mut cut = 0;
    for head in 0..a.heads {
        let (offsets, layout) = pack(model, &window, &out, arena, head);
        let head = Head { model, window: &window, out: &out, head, layout, offsets: &offsets };
        for row in rows.0..rows.1.min(out.rows) {
            cut += head.row::<I>(arena, row);
        }
    }
    if cols.1 >= out.cols {
        for row in rows.0..rows.1.min(out.rows) {
            arena.fill_margins(&out, row);
        }
    }
    cut
}

/// Packs k and v of one head; returns what each key's logits owe to the code 128 of q's zero.
#[inline(always)]
fn pack(
    model: &Model<'_>,
    window: &Window<'_>,
    out: &Tensor,
    arena: &mut Arena<'_>,
    head: usize,
) -> ([i32; MAX_TOKENS], Layout) {
    let (tokens, channels) = (window.tokens(), out.channels / window.a.heads);
    let layout = Layout::new(tokens, channels);
    let (tensors, scratch) = arena.bytes.split_at_mut(arena.scratch);
    let (keys, rest) = scratch.split_at_mut(layout.keys);
    let values = &mut rest[..layout.values];
    keys.fill(0);
    values.fill(0);
    let pad = model.constants(window.a.pad_codes, window.input.channels);
    let mut offsets = [0; MAX_TOKENS];
    for (first, width) in panels(tokens) {
        let panel = &mut keys[4 * first * groups(channels)..][..4 * width * groups(channels)];
        for token in first..tokens.min(first + width) {
            let from = out.channels + head * channels;
            let codes = match window.place(token, from) {
                Some(at) => &tensors[at..at + channels],
                None => &pad[from..from + channels],
            };
            let mut sum = 0;
            for (g, four) in codes.chunks(4).enumerate() {
                let to = 4 * (g * width + token - first);
                for (to, &code) in panel[to..to + 4].iter_mut().zip(four) {
                    *to = code ^ 0x80;
                    sum += code as i32 - 128;
                }
            }
            offsets[token] = -128 * sum;
        }
    }
    for (first, width) in panels(channels) {
        let panel = &mut values[4 * first * groups(tokens)..][..4 * width * groups(tokens)];
        let count = (channels - first).min(width);
        for token in 0..tokens {
            let from = 2 * out.channels + head * channels + first;
            let codes = match window.place(token, from) {
                Some(at) => &tensors[at..at + count],
                None => &pad[from..from + count],
            };
            let to = &mut panel[4 * width * (token / 4)..][..4 * width];
            for (to, &code) in to[token % 4..].iter_mut().step_by(4).zip(codes) {
                *to = code ^ 0x80;
            }
        }
    }
    (offsets, layout)
}

/// One head of a window, packed.
struct Head<'a, 'm> {
    model: &'a Model<'m>,
    window: &'a Window<'a>,
    out: &'a Tensor,
    head: usize,
    layout: Layout,
    offsets: &'a [i32; MAX_TOKENS],
}

impl Head<'_, '_> {
    /// The queries of row `row` of the map.
    #[inline(always)]
    fn row<I: Isa>(&self, arena: &mut Arena<'_>, row: usize) -> u64 {
        let (a, out) = (self.window.a, self.out);
        let channels = out.channels / a.heads;
        let cols = self.window.cols.0..self.window.cols.1.min(out.cols);
        let logits = self.products::<I>(arena, row, cols.len());
        let mut reciprocals = [0i64; MAX_WINDOW];
        for (q, reciprocal) in reciprocals[..cols.len()].iter_mut().enumerate() {
            *reciprocal = (1i64 << RECIPROCAL_BITS) / self.exponentials(arena, &logits[q], row, q);
        }
        let multiplier = self.model.constant_i32(a.multipliers, self.head) as i64;
        let exp = arena.scratch + self.layout.keys + self.layout.values;
        let mut cut = 0;
        for (first, width) in panels(channels) {
            let mut acc: Accumulators = [0; ACCUMULATORS];
            let groups = groups(self.window.tokens());
            let start = arena.scratch + self.layout.keys + 4 * first * groups;
            let weights = &arena.bytes[start..start + 4 * width * groups];
            for plane in [1, 0] {
                let starts = [exp + plane * self.layout.row];
                let patch = Patch { bytes: arena.bytes, starts: &starts, stride: 2 * self.layout.row, groups };
                I::gemm(&mut acc, cols.len(), &patch, weights, width);
                if plane == 1 {
                    acc[..cols.len() * width].iter_mut().for_each(|a| *a <<= 8);
                }
            }
            let to = Row::of(out, row);
            let count = (channels - first).min(width);
            for (q, col) in cols.clone().enumerate() {
                let mut codes = [0i32; PANEL];
                for (code, &weighted) in codes[..count].iter_mut().zip(&acc[q * width..]) {
                    let mean = round_shift(weighted as i64 * reciprocals[q], RECIPROCAL_BITS - FRACTION_BITS);
                    let (kept, over) = saturate(round_shift(mean * multiplier, a.shift), out);
                    *code = kept;
                    cut += over as u64;
                }
                to.store(arena.bytes, col * out.channels + self.head * channels + first, &codes[..count]);
            }
        }
        cut
    }

    /// q · k of the queries of a row with all keys.
    #[inline(always)]
    fn products<I: Isa>(&self, arena: &Arena<'_>, row: usize, queries: usize) -> [[i32; MAX_TOKENS]; MAX_WINDOW] {
        let (a, t) = (self.window.a, self.window.input);
        let channels = self.out.channels / a.heads;
        let tokens = self.window.tokens();
        let groups = groups(channels);
        let q = t.row_offset(row) + (t.margin + self.window.cols.0) * t.channels + self.head * channels;
        let starts = [q];
        let patch = Patch { bytes: arena.bytes, starts: &starts, stride: t.channels, groups };
        let mut logits = [[0; MAX_TOKENS]; MAX_WINDOW];
        for (first, width) in panels(tokens) {
            let mut acc: Accumulators = [0; ACCUMULATORS];
            let start = arena.scratch + 4 * first * groups;
            let weights = &arena.bytes[start..start + 4 * width * groups];
            I::gemm(&mut acc, queries, &patch, weights, width);
            let count = (tokens - first).min(width);
            for (q, logits) in logits[..queries].iter_mut().enumerate() {
                let acc = &acc[q * width..q * width + count];
                let offsets = &self.offsets[first..first + count];
                for ((logit, acc), offset) in logits[first..first + count].iter_mut().zip(acc).zip(offsets) {
                    *logit = acc.wrapping_add(*offset);
                }
            }
        }
        logits
    }

    /// Stores the exponentials of query `q` of row `row`; returns their sum, which is at least the table's first entry.
    #[inline(always)]
    fn exponentials(&self, arena: &mut Arena<'_>, products: &[i32; MAX_TOKENS], row: usize, q: usize) -> i64 {
        let a = self.window.a;
        let table = self.model.constants(a.exp_table, 2 * a.exp_len).as_chunks().0;
        let (width, tokens, side) = (self.window.width(), self.window.tokens(), 2 * a.window - 1);
        let multiplier = self.model.constant_i32(a.logit_multipliers, self.head) as i64;
        let bias = self.model.constants(a.position_bias + 2 * self.head * side * side, 2 * side * side);
        let bias = bias.as_chunks::<2>().0;
        let half = 1i64 << (a.logit_shift.max(1) - 1);
        let mut logits = [0i32; MAX_TOKENS];
        let mut largest = i32::MIN;
        let down = row - self.window.rows.0 + a.window - 1;
        for (key_row, start) in (0..tokens).step_by(width).enumerate() {
            // Keys from left to right: the bias from right to left, from index -> index - width + 1.
            let index = (down - key_row) * side + q + a.window - 1;
            let bias = &bias[index + 1 - width..=index];
            for k in 0..width {
                let product = (products[start + k] as i64 * multiplier + half) >> (a.logit_shift & 63);
                let product = product.clamp(-LOGIT_LIMIT, LOGIT_LIMIT) as i32;
                let logit = product + i16::from_le_bytes(bias[width - 1 - k]) as i32;
                logits[start + k] = logit;
                largest = largest.max(logit);
            }
        }
        let at = arena.scratch + self.layout.keys + self.layout.values + 2 * self.layout.row * q;
        let planes = &mut arena.bytes[at..at + 2 * self.layout.row];
        let (low, high) = planes.split_at_mut(self.layout.row);
        let mut sum = 0;
        for (k, logit) in logits[..tokens].iter().enumerate() {
            let e = exp_lookup(table, largest - logit);
            (low[k], high[k]) = (e as u8, (e >> 8) as u8);
            sum += e as i64;
        }
        low[tokens..].fill(0);
        high[tokens..].fill(0);
        sum.max(1)
    }
}

/// Widest head for which a row of queries fits the accumulators: any, as panels are done one by one.
const _: () = assert!(MAX_WINDOW * PANEL <= ACCUMULATORS);
