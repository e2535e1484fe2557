//! Compares attention in cut windows with the paper's definition: shift the map cyclically, attend inside whole windows, and mask pixels
//! that were not neighbours before.

use super::Random;
use super::draft::Draft;
use super::unit::{Expected, Map, check, random_map};
use crate::nn::file::{Attention, Dtype, Operator, Tensor};
use proptest::prelude::*;

/// Entries of the tables of the exponential.
const COARSE: usize = 64;
const FINE: usize = 32;

/// A random attention and its constants, without the file's packing.
struct Case {
    draft: Draft,
    index: usize,
    a: Attention,
    qkv: Map,
    out: Tensor,
    pad: Vec<i64>,
    logit_multipliers: Vec<i64>,
    /// `[heads][(2w-1)²]`.
    position_bias: Vec<i64>,
    /// The coarse table, then the fine one.
    exp: Vec<i64>,
    multipliers: Vec<i64>,
}

impl Case {
    fn new(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let r = &mut random;
        let window = r.size(1, 8);
        let size = (r.size(1, 14), r.size(1, 14));
        let shift = |r: &mut Random, len: usize| if len > window && r.one_in(2) { r.size(0, window - 1) } else { 0 };
        let (shift_rows, shift_cols) = (shift(r, size.0), shift(r, size.1));
        let heads = r.size(1, 3);
        let small = r.size(1, 12);
        let head = if r.one_in(8) { r.size(30, 40) } else { small };
        let mut draft = Draft::new(size);
        let qkv_t = Tensor {
            zero: 128,
            lo: 1,
            hi: 255,
            margin: r.size(0, 2),
            ..Tensor::new(Dtype::U8, size, 3 * heads * head)
        };
        let qkv = random_map(r, &qkv_t);
        let input = draft.made(qkv_t);
        let dtype = r.pick(&[Dtype::U8, Dtype::I16]);
        let (zero, lo, hi) = if dtype == Dtype::U8 { (128, 1, 255) } else { (0, -20000, 20000) };
        let out_t = Tensor { zero, lo, hi, margin: r.size(0, 2), ..Tensor::new(dtype, size, heads * head) };
        let out = draft.place(out_t);
        let side = 2 * window - 1;
        // Tables with any legal values: decreasing like an exponential, or not.
        let mut exp = r.list(COARSE + FINE, 0, 32767);
        if r.one_in(2) {
            let fall = |i: usize, step: f64| (32767.0 * libm::exp(-(i as f64) * step / 256.0)) as i64;
            exp = (0..COARSE).map(|i| fall(i, 32.0)).chain((0..FINE).map(|i| fall(i, 1.0))).collect();
        }
        (exp[0], exp[COARSE]) = (r.within(1 << 14, 32767), r.within(1 << 14, 32767));
        let pad = r.list(3 * heads * head, -127, 127);
        let (logit_multipliers, multipliers) = (r.list(heads, -(1 << 30), 1 << 30), r.list(heads, -(1 << 30), 1 << 30));
        let position_bias = r.list(heads * side * side, -300, 300);
        let a = Attention {
            out,
            input,
            heads,
            window,
            shift_rows,
            shift_cols,
            pad_codes: draft.constant(pad.iter().map(|p| (p + 128) as u8)),
            logit_multipliers: draft.words(logit_multipliers.iter().map(|m| *m as i32)),
            logit_shift: r.size(24, 44) as u32,
            position_bias: draft.constant(position_bias.iter().flat_map(|b| (*b as i16).to_le_bytes())),
            exp_table: draft.constant(exp.iter().flat_map(|e| (*e as i16).to_le_bytes())),
            multipliers: draft.words(multipliers.iter().map(|m| *m as i32)),
            shift: r.size(36, 50) as u32,
        };
        let index = draft.operator(Operator::Attention(a));
        draft.finish();
        draft.in_order();
        Self { draft, index, a, qkv, out: out_t, pad, logit_multipliers, position_bias, exp, multipliers }
    }

    /// Returns the value of channel `k` of a pixel, or of the padding.
    fn value(&self, pixel: Option<usize>, k: usize) -> i64 {
        pixel.map_or(self.pad[k], |pixel| self.qkv[pixel * self.pad.len() + k])
    }

    /// Returns the pixel at a place of the shifted map (`None` in the padding), and its region.
    fn place(&self, row: usize, col: usize) -> (Option<usize>, (usize, usize)) {
        let axis = |at: usize, len: usize, shift: usize| {
            let whole = len.div_ceil(self.a.window) * self.a.window;
            let region = match at {
                _ if at < whole - self.a.window => 0,
                _ if at < whole - shift => 1,
                _ => 2,
            };
            ((at + shift) % whole, region)
        };
        let ((r, down), (c, across)) =
            (axis(row, self.out.rows, self.a.shift_rows), axis(col, self.out.cols, self.a.shift_cols));
        ((r < self.out.rows && c < self.out.cols).then_some(r * self.out.cols + c), (down, across))
    }

    fn expected(&self) -> Expected {
        let (w, channels) = (self.a.window, self.out.channels);
        let (rows, cols) = (self.out.rows.div_ceil(w) * w, self.out.cols.div_ceil(w) * w);
        let (mut map, mut cut) = (vec![0; self.out.len()], 0);
        for (row, col) in (0..rows).flat_map(|r| (0..cols).map(move |c| (r, c))) {
            let (Some(pixel), region) = self.place(row, col) else { continue };
            for head in 0..self.a.heads {
                for (k, code) in self.attend((row, col), pixel, region, head, &mut cut).into_iter().enumerate() {
                    map[pixel * channels + head * (channels / self.a.heads) + k] = code;
                }
            }
        }
        Expected { map, cut: Some(cut) }
    }

    fn exponential(&self, distance: usize) -> i64 {
        if distance >= COARSE * FINE {
            return 0;
        }
        rounded(self.exp[distance / FINE] * self.exp[COARSE + distance % FINE], 15)
    }

    fn attend(&self, at: (usize, usize), pixel: usize, region: (usize, usize), head: usize, cut: &mut u64) -> Map {
        let (w, channels) = (self.a.window, self.out.channels);
        let size = channels / self.a.heads;
        let side = 2 * w - 1;
        let (top, left) = (at.0 / w * w, at.1 / w * w);
        let mut keys = Vec::new();
        for (r, c) in (0..w).flat_map(|r| (0..w).map(move |c| (top + r, left + c))) {
            let (key, other) = self.place(r, c);
            if other != region {
                continue; // masked
            }
            let product: i64 = (head * size..(head + 1) * size)
                .map(|k| self.value(Some(pixel), k) * self.value(key, channels + k))
                .sum();
            let logit = rounded(product * self.logit_multipliers[head], self.a.logit_shift).clamp(-(1 << 24), 1 << 24);
            let relative = (r + w - 1 - at.0) * side + c + w - 1 - at.1;
            keys.push((logit + self.position_bias[head * side * side + relative], key));
        }
        let largest = keys.iter().map(|k| k.0).max().unwrap();
        let exps: Vec<i64> = keys.iter().map(|(logit, _)| self.exponential((largest - logit) as usize)).collect();
        let reciprocal = (1i64 << 43) / exps.iter().sum::<i64>();
        let mean = |k: usize| {
            let channel = 2 * channels + head * size + k;
            let weighted: i64 = exps.iter().zip(&keys).map(|(e, (_, key))| e * self.value(*key, channel)).sum();
            rounded(weighted * reciprocal, 27)
        };
        let mut codes = Vec::new();
        for k in 0..size {
            let code = rounded(mean(k) * self.multipliers[head], self.a.shift) + self.out.zero as i64;
            let kept = code.clamp(self.out.lo as i64, self.out.hi as i64);
            *cut += (kept != code) as u64;
            codes.push(kept - self.out.zero as i64);
        }
        codes
    }
}

/// Returns v / 2^shift, halves up.
fn rounded(v: i64, shift: u32) -> i64 {
    let step = 1i128 << shift;
    (v as i128 + step / 2).div_euclid(step) as i64
}

proptest! {
    #[test]
    fn attention_in_cut_windows_is_that_of_shifted_ones(seed in any::<u64>()) {
        let case = Case::new(seed);
        check(&case.draft, case.index, &[(case.a.input, &case.qkv)], &case.expected(), 0);
    }
}
