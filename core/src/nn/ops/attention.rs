//! TokenWindow attention: all heads of one window.
//!
//! ```text
//! for every head
//!     pack k: a panel per 32 keys    [group of 4 channels][key][4], code - 128 as i8
//!     pack v: a panel per 32 channels [group of 4 keys][channel][4]
//!     for every row of the window that lies in the map
//!         logits = q · k                       the convolutions' kernel: q is read where it lies
//!         e = exp(logit - largest)             by table; 15 bits, stored as two planes of u8 (kernels with table lookups have their own)
//!         mean = (e · v) / Σe                  the same kernel, once per plane; one integer reciprocal per query
//! ```
//! The softmax is not normalised before the product with v.

use super::attention_layout::Layout;
use super::{Constants, Prepared};
use crate::nn::arena::{Arena, Row};
use crate::nn::file::{Attention, MAX_WINDOW, MEAN_FRACTION_BITS};
use crate::nn::kernels::softmax::{MAX_TOKENS, Softmax};
use crate::nn::kernels::{ACCUMULATORS, Accumulators, Isa, Patch};
use crate::nn::panels::{PANEL, groups, panels};
use crate::nn::tensor::Tensor;
use crate::part::{head, head_mut, item, part, part_mut, put};
use crate::quant::limit::limit_wide;
use crate::quant::lut::EXP_COARSE;
use crate::quant::round_shift;

/// Bits of the reciprocal of the sum of exponentials.
const RECIPROCAL_BITS: u32 = 43;
const _: () = assert!(MAX_WINDOW * MAX_WINDOW == MAX_TOKENS);

/// One window: a range of rows and a range of columns of the extended map.
struct TokenWindow<'a> {
    a: &'a Attention,
    input: &'a Tensor,
    rows: (usize, usize),
    cols: (usize, usize),
}

impl TokenWindow<'_> {
    #[inline(always)]
    fn width(&self) -> usize {
        self.cols.1 - self.cols.0
    }

    #[inline(always)]
    fn tokens(&self) -> usize {
        self.width() * (self.rows.1 - self.rows.0)
    }

    /// Returns a walk over the offsets in the arena of sample `channel` of every token, from the first on.
    #[inline(always)]
    fn walk(&self, channel: usize) -> Walk<'_> {
        let mut walk = Walk { window: self, channel, row: self.rows.0, col: self.cols.0, at: 0 };
        walk.begin_row();
        walk
    }
}

/// A walk over the tokens of a window, without a division per token.
struct Walk<'a> {
    window: &'a TokenWindow<'a>,
    channel: usize,
    row: usize,
    col: usize,
    /// Offset of the token at (row, col), if it is inside the map.
    at: usize,
}

impl Walk<'_> {
    #[inline(always)]
    fn begin_row(&mut self) {
        let t = self.window.input;
        self.at =
            t.row_offset(self.row.min(t.rows.saturating_sub(1))) + (t.margin + self.col) * t.channels + self.channel;
    }

    /// Returns the offset of the next token; `None` in the padding.
    #[inline(always)]
    fn next_place(&mut self) -> Option<usize> {
        let t = self.window.input;
        let place = (self.row < t.rows && self.col < t.cols).then_some(self.at);
        (self.col, self.at) = (self.col + 1, self.at + t.channels);
        if self.col == self.window.cols.1 {
            (self.row, self.col) = (self.row + 1, self.window.cols.0);
            self.begin_row();
        }
        place
    }
}

/// Runs unit `unit` (column piece) of step `step` (row piece).
#[inline(always)]
pub(crate) fn run<I: Isa>(
    isa: &mut I,
    constants: &Constants<'_>,
    a: &Attention,
    prepared: &Prepared,
    arena: &mut Arena<'_>,
    step: usize,
    unit: usize,
) -> u64 {
    let (input, out) = (prepared.input(0), prepared.out);
    let (rows, cols) = (a.piece(out.rows, a.shift_rows, step), a.piece(out.cols, a.shift_cols, unit));
    let window = TokenWindow { a, input: &input, rows, cols };
    let (mut cut, mut acc) = (0, [0; ACCUMULATORS]);
    for head in 0..a.heads {
        let (offsets, layout) = pack(constants, &window, &out, arena, head);
        let head = Head { constants, window: &window, out: &out, head, layout, offsets: &offsets };
        for row in rows.0..rows.1.min(out.rows) {
            cut += head.row(isa, arena, &mut acc, row);
        }
    }
    if cols.1 >= out.cols {
        for row in rows.0..rows.1.min(out.rows) {
            arena.fill_margins(&out, row);
        }
    }
    cut
}

/// Packs k and v of one head; returns for each key the part of its logits that comes from the zero of q, code 128.
#[inline(always)]
fn pack(
    constants: &Constants<'_>,
    window: &TokenWindow<'_>,
    out: &Tensor,
    arena: &mut Arena<'_>,
    head: usize,
) -> ([i32; MAX_TOKENS], Layout) {
    let (tokens, channels) = (window.tokens().min(MAX_TOKENS), out.channels / window.a.heads.max(1));
    let layout = Layout::new(tokens, channels);
    let (tensors, scratch) = arena.bytes.split_at_mut_checked(arena.scratch).unwrap_or_default();
    let (keys, rest) = scratch.split_at_mut_checked(layout.keys).unwrap_or_default();
    let values = head_mut(rest, layout.values);
    let pad = constants.slice(window.a.pad_codes, window.input.channels);
    let source = Source { window, tensors, pad, tokens, channels };
    let offsets = source.pack_keys(out.channels + head * channels, keys);
    source.pack_values(2 * out.channels + head * channels, values);
    (offsets, layout)
}

/// Where k or v of one head is read.
struct Source<'a> {
    window: &'a TokenWindow<'a>,
    tensors: &'a [u8],
    pad: &'a [u8],
    tokens: usize,
    channels: usize,
}

impl Source<'_> {
    /// Packs k, which begins at sample `from` of a token.
    #[inline(always)]
    fn pack_keys(&self, from: usize, keys: &mut [u8]) -> [i32; MAX_TOKENS] {
        let &Self { window, tensors, pad, tokens, channels } = self;
        let mut offsets = [0; MAX_TOKENS];
        let mut walk = window.walk(from);
        for (first, width) in panels(tokens) {
            let panel = part_mut(keys, 4 * first * groups(channels), 4 * width * groups(channels));
            if tokens < first + width || !channels.is_multiple_of(4) {
                panel.fill(0);
            }
            for token in first..tokens.min(first + width) {
                let codes = match walk.next_place() {
                    Some(at) => part(tensors, at, channels),
                    None => part(pad, from, channels),
                };
                let mut sum = 0;
                let (fours, rest) = codes.as_chunks::<4>();
                for (g, four) in fours.iter().enumerate() {
                    let word = u32::from_ne_bytes(*four) ^ 0x8080_8080;
                    if let Some(to) =
                        panel.get_mut(4 * (g * width + token - first)..).and_then(|to| to.first_chunk_mut())
                    {
                        *to = word.to_ne_bytes();
                    }
                    sum += four[0] as i32 + four[1] as i32 + four[2] as i32 + four[3] as i32;
                }
                for (b, &code) in rest.iter().enumerate() {
                    put(panel, 4 * (fours.len() * width + token - first) + b, code ^ 0x80);
                    sum += code as i32;
                }
                sum -= 128 * channels as i32;
                put(&mut offsets, token, -128 * sum);
            }
        }
        offsets
    }

    /// Packs v, which begins at sample `start` of a token.
    #[inline(always)]
    fn pack_values(&self, start: usize, values: &mut [u8]) {
        let &Self { window, tensors, pad, tokens, channels } = self;
        for (first, width) in panels(channels) {
            let panel = part_mut(values, 4 * first * groups(tokens), 4 * width * groups(tokens));
            let count = (channels - first).min(width);
            if count < width {
                panel.fill(0);
            }
            let from = start + first;
            let mut walk = window.walk(from);
            for (group, to) in panel.chunks_exact_mut((4 * width).max(1)).enumerate() {
                // Missing tokens are zeros: the code 128.
                const NOTHING: [u8; PANEL] = [128; PANEL];
                let mut four = [part(&NOTHING, 0, count); 4];
                for (b, codes) in four.iter_mut().enumerate() {
                    let token = 4 * group + b;
                    if token < tokens {
                        *codes = match walk.next_place() {
                            Some(at) => part(tensors, at, count),
                            None => part(pad, from, count),
                        };
                    }
                }
                let [a, b, c, d] = four;
                for ((((to, a), b), c), d) in to.as_chunks_mut::<4>().0.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                    *to = [a ^ 0x80, b ^ 0x80, c ^ 0x80, d ^ 0x80];
                }
            }
        }
    }
}

/// One packed head of a window.
struct Head<'a, 'm> {
    constants: &'a Constants<'m>,
    window: &'a TokenWindow<'a>,
    out: &'a Tensor,
    head: usize,
    layout: Layout,
    offsets: &'a [i32; MAX_TOKENS],
}

impl Head<'_, '_> {
    /// Computes the queries of row `row` of the map.
    #[inline(always)]
    fn row<I: Isa>(&self, isa: &mut I, arena: &mut Arena<'_>, acc: &mut Accumulators, row: usize) -> u64 {
        let (a, out) = (self.window.a, self.out);
        let channels = out.channels / a.heads.max(1);
        let cols = self.window.cols.0..self.window.cols.1.min(out.cols);
        let logits = self.products(isa, arena, acc, row, cols.len());
        let mut reciprocals = [0i32; MAX_WINDOW];
        for (q, (reciprocal, logits)) in reciprocals.iter_mut().zip(&logits).take(cols.len()).enumerate() {
            *reciprocal = reciprocal_of(self.exponentials::<I>(arena, logits, row, q));
        }
        let multiplier = self.constants.i32_at(a.multipliers, self.head);
        let exp = arena.scratch + self.layout.keys + self.layout.values;
        let mut cut = 0;
        for (first, width) in panels(channels) {
            let groups = groups(self.window.tokens());
            let start = arena.scratch + self.layout.keys + 4 * first * groups;
            let weights = part(arena.bytes, start, 4 * width * groups);
            for plane in [1, 0] {
                let starts = [exp + plane * self.layout.row];
                let patch = Patch { bytes: arena.bytes, starts: &starts, stride: 2 * self.layout.row, groups };
                if plane == 1 {
                    isa.gemm_from_zero(acc, cols.len(), &patch, weights, width);
                    head_mut(acc, cols.len() * width).iter_mut().for_each(|a| *a <<= 8);
                } else {
                    isa.gemm(acc, cols.len(), &patch, weights, width);
                }
            }
            let channel = self.head * channels + first;
            let count = (channels - first).min(width);
            for (q, col) in cols.clone().enumerate() {
                let (scale, place) = ((item(&reciprocals, q), multiplier), (row, col * out.channels + channel));
                cut += match width {
                    32 => self.means::<32>(arena.bytes, acc.as_chunks().0.get(q), scale, place, count),
                    16 => self.means::<16>(arena.bytes, acc.as_chunks().0.get(q), scale, place, count),
                    _ => self.means::<8>(arena.bytes, acc.as_chunks().0.get(q), scale, place, count),
                };
            }
        }
        cut
    }

    /// Turns sums of v into codes and stores `count` of them in a row of the output, from a sample on; returns how many were cut. `W` is
    /// the panel's width, a constant for the compiler.
    #[inline(always)]
    fn means<const W: usize>(
        &self,
        bytes: &mut [u8],
        weighted: Option<&[i32; W]>,
        (reciprocal, multiplier): (i32, i32),
        (row, sample): (usize, usize),
        count: usize,
    ) -> u64 {
        let (Some(weighted), out, shift) = (weighted, self.out, self.window.a.shift) else { return 0 };
        let (lo, hi, zero) = (out.lo as i64, out.hi as i64, out.zero as i64);
        let (mut codes, mut cuts) = ([0i32; W], [0i64; W]);
        for c in 0..W {
            let mean = round_shift(weighted[c] as i64 * reciprocal as i64, RECIPROCAL_BITS - MEAN_FRACTION_BITS);
            let code = round_shift(mean as i32 as i64 * multiplier as i64, shift) + zero;
            cuts[c] = (code > hi) as i64 + (code < lo) as i64;
            codes[c] = limit_wide(code, lo, hi) as i32;
        }
        let mut cut = 0;
        for &one in head(&cuts, count) {
            cut += one as u64;
        }
        Row::of(out, row).store(bytes, sample, head(&codes, count));
        cut
    }

    /// Returns q · k of the queries of a row with all keys.
    #[inline(always)]
    fn products<I: Isa>(
        &self,
        isa: &mut I,
        arena: &Arena<'_>,
        acc: &mut Accumulators,
        row: usize,
        queries: usize,
    ) -> [[i32; MAX_TOKENS]; MAX_WINDOW] {
        let (a, t) = (self.window.a, self.window.input);
        let channels = self.out.channels / a.heads;
        let tokens = self.window.tokens();
        let groups = groups(channels);
        let q = t.row_offset(row) + (t.margin + self.window.cols.0) * t.channels + self.head * channels;
        let starts = [q];
        let patch = Patch { bytes: arena.bytes, starts: &starts, stride: t.channels, groups };
        let mut logits = [[0; MAX_TOKENS]; MAX_WINDOW];
        for (first, width) in panels(tokens) {
            let start = arena.scratch + 4 * first * groups;
            let weights = part(arena.bytes, start, 4 * width * groups);
            isa.gemm_from_zero(acc, queries, &patch, weights, width);
            let count = (tokens - first).min(width);
            for (q, logits) in logits.iter_mut().take(queries).enumerate() {
                let (acc, offsets) = (part(acc, q * width, count), part(self.offsets, first, count));
                for ((logit, acc), offset) in part_mut(logits, first, count).iter_mut().zip(acc).zip(offsets) {
                    *logit = acc.wrapping_add(*offset);
                }
            }
        }
        logits
    }

    /// Stores the exponentials of query `q` of row `row`; returns their sum.
    #[inline(always)]
    fn exponentials<I: Isa>(&self, arena: &mut Arena<'_>, products: &[i32; MAX_TOKENS], row: usize, q: usize) -> i64 {
        let a = self.window.a;
        let (width, side) = (self.window.width(), 2 * a.window - 1);
        let bias = self.constants.slice(a.position_bias + 2 * self.head * side * side, 2 * side * side);
        // The table is stored so that keys and entries have the same order from left to right.
        let first = (a.window - 1 - (row - self.window.rows.0)) * side + a.window - 1 - q;
        let softmax = Softmax {
            products,
            tokens: self.window.tokens(),
            width,
            bias: bias.as_chunks().0.get(first..).unwrap_or_default(),
            bias_pitch: side,
            multiplier: self.constants.i32_at(a.logit_multipliers, self.head),
            shift: a.logit_shift & 63,
            coarse: table(self.constants, a.exp_table),
            fine: table(self.constants, a.exp_table + 2 * EXP_COARSE),
        };
        let at = arena.scratch + self.layout.keys + self.layout.values + 2 * self.layout.row * q;
        let planes = part_mut(arena.bytes, at, 2 * self.layout.row);
        let (low, high) = planes.split_at_mut_checked(self.layout.row).unwrap_or_default();
        I::softmax(&softmax, low, high).max(1)
    }
}

/// Returns a part of the exponential's table.
#[inline(always)]
fn table<'a, const N: usize>(constants: &Constants<'a>, offset: usize) -> &'a [[u8; 2]; N] {
    constants.slice(offset, 2 * N).as_chunks().0.first_chunk().unwrap_or(&[[0; 2]; N])
}

/// Returns `2^RECIPROCAL_BITS / sum`, rounded down, for the sum of a row's exponentials. Validation guarantees that the sum is at least
/// 2^13 and below 2^21. The division is done in pieces of 32 bits, because small processors divide 64 bits in a loop whose length depends
/// on the data. The sum of a table that has changed is clamped to the range in which the pieces are exact.
#[inline(always)]
fn reciprocal_of(sum: i64) -> i32 {
    const PIECES: [u32; 3] = [31, 10, 2];
    const _: () = assert!(PIECES[0] + PIECES[1] + PIECES[2] == RECIPROCAL_BITS && MAX_TOKENS << 15 <= 1 << 21);
    let sum = (sum as u32).clamp(1 << 13, 1 << 22);
    let (mut quotient, mut rest) = ((1 << PIECES[0]) / sum, (1 << PIECES[0]) % sum);
    for bits in [PIECES[1], PIECES[2]] {
        rest <<= bits;
        (quotient, rest) = ((quotient << bits) + rest / sum, rest % sum);
    }
    quotient as i32
}

/// A row of queries fits into the accumulators for any width of the head, because panels are computed one by one.
const _: () = assert!(MAX_WINDOW * PANEL <= ACCUMULATORS);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reciprocal_in_pieces_is_that_in_one() {
        for sum in (1 << 13)..=(1 << 21) {
            assert_eq!(reciprocal_of(sum) as i64, (1 << RECIPROCAL_BITS) / sum);
        }
    }
}
