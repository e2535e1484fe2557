//! Random inputs and operators with constants within their limits. What a choice makes illegal, the model's validation refuses.

use super::{Dice, Program, ends};
use alloc::vec::Vec;
use elunar_core::nn::Illumination;
use elunar_core::nn::file::*;

/// Returns a map with all codes of its type; its place and pitch are chosen later.
fn map(dtype: Dtype, size: (usize, usize), channels: usize) -> Tensor {
    let (lo, hi) = ends(dtype);
    Tensor { lo, hi, ..Tensor::new(dtype, size, channels) }
}

/// Chooses codes, and margins up to `margin`.
fn dress(d: &mut Dice<'_>, mut t: Tensor, margin: usize) -> Tensor {
    let (low, high) = ends(t.dtype);
    let any = |d: &mut Dice<'_>| low + d.size(0, (high - low) as usize) as i32;
    let (a, b) = (any(d), any(d));
    if d.chance(40) {
        (t.lo, t.hi) = (a.min(b), a.max(b));
    }
    t.zero = if t.dtype == Dtype::U8 { d.pick(&[0, 128, 255, t.lo, t.hi]) } else { 0 };
    (t.margin, t.edge) = (d.size(0, margin), d.pick(&[Edge::Zero, Edge::Nearest]));
    t
}

/// Adds the image and, sometimes, the coarse DTM.
pub(super) fn inputs(d: &mut Dice<'_>, p: &mut Program) {
    let dtype = d.pick(&[Dtype::U8, Dtype::I16]);
    // The image alone, or as the four maps of a guide.
    let channels = if d.chance(10) { 4 } else { 1 };
    p.illumination = if channels == 4 { Illumination::Given } else { Illumination::Any };
    let mut image = dress(d, map(dtype, p.tile, channels), 4);
    image.scale = d.pick(&[1.0 / 255.0, 1.0, 1e-3, 1e-30]);
    p.tensors.push(image);
    if d.chance(40) {
        let dtype = d.pick(&[Dtype::U8, Dtype::I16]);
        let coarse = dress(d, map(dtype, p.tile, 1), 3);
        p.tensors.push(coarse);
        p.coarse = 1;
    }
}

/// Adds an operator over any earlier map, mostly the last one.
pub(super) fn add(d: &mut Dice<'_>, p: &mut Program) -> Option<()> {
    let last = p.tensors.len() - 1;
    let input = if d.chance(60) { last } else { d.size(0, last) } as u32;
    match d.size(0, 7) {
        0 | 1 => layer_norm(d, p, input),
        2 => attention(d, p, input),
        3 => upsampling(d, p, input),
        _ => conv(d, p, input, false),
    }
}

/// Adds the output, computed from a map of the tile's size.
pub(super) fn output(d: &mut Dice<'_>, p: &mut Program) -> Option<()> {
    let fits = |t: &u32| (p.tensor(*t).rows, p.tensor(*t).cols) == p.tile;
    let input = (0..p.tensors.len() as u32).rev().find(fits)?;
    conv(d, p, input, true)
}

fn layer_norm(d: &mut Dice<'_>, p: &mut Program, input: u32) -> Option<()> {
    let x = p.tensor(input);
    let even = x.rows.is_multiple_of(2) && x.cols.is_multiple_of(2);
    let merge = if even && d.chance(40) { 2 } else { 1 };
    let dtype = d.pick(&[Dtype::U8, Dtype::I16]);
    let out = dress(d, map(dtype, (x.rows / merge, x.cols / merge), x.channels * merge * merge), 3);
    let gains: Vec<i32> = (0..out.channels).map(|_| d.signed(1 << 30) as i32 >> d.pick(&[0, 10, 20])).collect();
    let biases: Vec<i64> = (0..out.channels).map(|_| d.signed(1 << 60) >> d.pick(&[0, 20, 40])).collect();
    let gains = p.words(gains);
    let biases = p.constant(biases.into_iter().flat_map(i64::to_le_bytes));
    let (shift, epsilon) = (d.pick(&[1, 8, 16, 24, 30, 40, 60]), d.pick(&[1, 1000, 1 << 40, 1 << 56]));
    p.operators.push(Operator::LayerNorm(LayerNorm { out: number(p), input, merge, gains, biases, shift, epsilon }));
    p.tensors.push(out);
    Some(())
}

/// Adds a projection to q, k and v, and the attention over it.
fn attention(d: &mut Dice<'_>, p: &mut Program, input: u32) -> Option<()> {
    let x = p.tensor(input);
    let (heads, window) = (d.size(1, 3), d.size(1, d.sizes.window));
    let channels = heads * d.pick(d.sizes.head_channels);
    let mut qkv = map(Dtype::U8, (x.rows, x.cols), 3 * channels);
    (qkv.zero, qkv.lo, qkv.margin) = (128, d.size(1, 100) as i32, d.size(0, 2));
    let projected = number(p);
    p.tensors.push(qkv);
    let block = d.size(1, 4);
    finish(d, p, Conv { out: projected, first: input, block, ..Conv::default() });
    let dtype = d.pick(&[Dtype::U8, Dtype::I16]);
    let out = dress(d, map(dtype, (x.rows, x.cols), channels), 3);
    let pad: Vec<u8> = (0..3 * channels).map(|_| d.size(1, 255) as u8).collect();
    let multipliers = |d: &mut Dice<'_>| -> Vec<i32> {
        (0..heads).map(|_| d.signed(1 << 30) as i32 >> d.pick(&[0, 8, 16])).collect()
    };
    let (logits, means) = (multipliers(d), multipliers(d));
    let bias: Vec<u8> = (0..heads * (2 * window - 1).pow(2))
        .flat_map(|_| (d.signed(32767) as i16 >> d.pick(&[0, 7])).to_le_bytes())
        .collect();
    let first = |i: usize| i == 0 || i == 64;
    let exp: Vec<u8> =
        (0..96).flat_map(|i| (d.size(if first(i) { 1 << 14 } else { 0 }, 32767) as i16).to_le_bytes()).collect();
    let attention = Attention {
        out: number(p),
        input: projected,
        heads,
        window,
        shift_rows: d.size(0, window.min(x.rows) - 1),
        shift_cols: d.size(0, window.min(x.cols) - 1),
        pad_codes: p.constant(pad),
        logit_multipliers: p.words(logits),
        logit_shift: d.pick(&[1, 5, 12, 20, 31, 32, 40, 60]),
        position_bias: p.constant(bias),
        exp_table: p.constant(exp),
        multipliers: p.words(means),
        shift: d.pick(&[1, 8, 16, 30, 40, 60]),
    };
    p.operators.push(Operator::Attention(attention));
    p.tensors.push(out);
    Some(())
}

fn upsampling(d: &mut Dice<'_>, p: &mut Program, input: u32) -> Option<()> {
    let x = p.tensor(input);
    let (margin, edge) = (d.size(0, 3), d.pick(&[Edge::Zero, Edge::Nearest]));
    let out = Tensor { rows: 2 * x.rows, cols: 2 * x.cols, ring: 2 * x.rows, margin, edge, ..x };
    if out.rows > 64 || out.cols > 64 {
        return None;
    }
    p.operators.push(Operator::Upsample2(Upsample2 { out: number(p), input }));
    p.tensors.push(out);
    Some(())
}

fn conv(d: &mut Dice<'_>, p: &mut Program, first: u32, last: bool) -> Option<()> {
    let x = p.tensor(first);
    let mut c = Conv { out: number(p), first, block: d.size(1, 5), ..Conv::default() };
    let alike = |p: &Program, fits: &dyn Fn(&Tensor) -> bool| -> Vec<u32> {
        (0..p.tensors.len() as u32).filter(|t| fits(&p.tensor(*t))).collect()
    };
    if d.chance(30) {
        c.second = Some(d.pick(&alike(p, &|t| (t.rows, t.cols) == (x.rows, x.cols))));
    }
    let margin = |edge: Edge| {
        let of = |t: Tensor| if t.edge == edge { t.margin } else { 0 };
        c.sources().map(|source| of(p.tensor(source))).min().unwrap_or(0)
    };
    let (zeros, nearest) = (margin(Edge::Zero), margin(Edge::Nearest));
    let dtype = if last { Dtype::F32 } else { d.pick(&[Dtype::U8, Dtype::I16]) };
    let mut shape = (2 * x.rows, 2 * x.cols);
    if !last && nearest >= 2 && x.rows.min(x.cols) >= 4 && x.rows <= 24 && d.chance(40) {
        (c.fold, c.kernel_rows, c.kernel_cols, c.pad) = (true, 5, 5, 2);
    } else {
        c.pad = d.size(0, zeros.min(if last { 2 } else { 9 }));
        let kernel = |d: &mut Dice<'_>| if last { 2 * c.pad + 1 } else { c.pad + d.size(1, 4) };
        (c.kernel_rows, c.kernel_cols) = (kernel(d), kernel(d));
        if !last {
            (c.stride, c.stride_cols) = (d.size(1, 3), d.size(1, 3));
        }
        let extent = |len: usize, kernel: usize, stride: usize| {
            (len + 2 * c.pad).checked_sub(kernel).map(|rest| rest / stride + 1)
        };
        shape = (extent(x.rows, c.kernel_rows, c.stride)?, extent(x.cols, c.kernel_cols, c.stride_cols)?);
    }
    let usual = d.pick(d.sizes.channels);
    let channels = if last { 1 } else { d.pick(&[usual, x.channels]) };
    let mut out = map(dtype, shape, channels);
    if !last {
        out = dress(d, out, 3);
    }
    let adds = alike(p, &|t| (t.rows, t.cols, t.channels) == (out.rows, out.cols, out.channels));
    if !adds.is_empty() && d.chance(60) {
        let add = d.pick(&adds);
        let t = p.tensor(add);
        if !last && t.dtype != Dtype::F32 && d.chance(50) {
            // So that the sum may take the added map's place.
            out = Tensor { margin: t.margin, edge: t.edge, ..dress(d, map(t.dtype, shape, channels), 0) };
        }
        c.add = Some(add);
    }
    p.tensors.push(out);
    finish(d, p, c);
    Some(())
}

/// Adds a convolution with random constants; its tensors exist.
fn finish(d: &mut Dice<'_>, p: &mut Program, mut c: Conv) {
    let out = p.tensor(c.out);
    let weights = weights(d, p, &c);
    c.weights = p.constant(weights);
    let limit = if d.chance(15) { 1 << 28 } else { 1 << 12 };
    let bias: Vec<i32> = (0..c.variants() * out.channels).map(|_| d.signed(limit) as i32).collect();
    c.bias = p.words(bias);
    if out.dtype == Dtype::F32 {
        let scales: Vec<u8> = (0..out.channels).flat_map(|_| (d.signed(1000) as f32 * 1e-4).to_le_bytes()).collect();
        (c.multipliers, c.shift, c.relu) = (p.constant(scales), 0, d.chance(30));
    } else {
        c.shift = d.pick(&[1, 2, 8, 15, 20, 30, 31, 32, 33, 38, 40, 45, 53, 60]);
        let size = 1i64 << d.size(0, 30.min(c.shift as usize + 2));
        let multipliers = |d: &mut Dice<'_>| -> Vec<i32> { (0..out.channels).map(|_| d.signed(size) as i32).collect() };
        let (first, added) = (multipliers(d), multipliers(d));
        c.multipliers = p.words(first);
        if c.add.is_some() {
            (c.add_multipliers, c.add_shift) = (p.words(added), d.size(0, 15) as u32);
        }
        if out.dtype == Dtype::U8 && d.chance(25) {
            let codes: Vec<u8> = (0..256).map(|_| d.size(out.lo as usize, out.hi as usize) as u8).collect();
            (c.table, c.table_zero) = (Some(p.constant(codes)), d.size(0, 255) as i32);
        }
    }
    p.operators.push(Operator::Conv(c));
}

/// Returns weights in the order of the file; filling is 0.
fn weights(d: &mut Dice<'_>, p: &Program, c: &Conv) -> Vec<u8> {
    let (channels, way, mut bytes) = (p.tensor(c.out).channels, d.size(0, 3), Vec::new());
    for (first, width) in panels(channels) {
        for variant in 0..c.variants() {
            let (rows, cols) = c.extent(variant);
            for source in c.sources() {
                let used = cols * p.tensor(source).channels;
                for at in 0..rows * groups(used) * width * 4 {
                    let (sample, channel) = (at / (4 * width) % groups(used) * 4 + at % 4, first + at / 4 % width);
                    let weight = match way {
                        0 => d.pick(&[-127i8, 127]),
                        1 => d.signed(3) as i8,
                        2 => d.signed(127) as i8,
                        _ => d.chance(20) as i8,
                    };
                    bytes.push(if sample >= used || channel >= channels { 0 } else { weight as u8 });
                }
            }
        }
    }
    bytes
}

/// Returns the number of the next tensor.
fn number(p: &Program) -> u32 {
    p.tensors.len() as u32
}
