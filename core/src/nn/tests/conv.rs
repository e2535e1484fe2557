//! Compares convolutions, with and without a contained upsampling, with sums over all taps.

use super::Random;
use super::draft::Draft;
use super::unit::{Expected, Map, check, random_map};
use crate::nn::file::{Conv, Dtype, Edge, Operator, PHASE_TAPS, PHASES, Tensor};
use proptest::prelude::*;

/// A random convolution and its weights, without the file's packing.
pub(super) struct Case {
    pub(super) draft: Draft,
    conv: Conv,
    /// Sources and the added tensor, with their contents.
    sources: Vec<(Tensor, Map)>,
    add: Option<(Tensor, Map)>,
    out: Tensor,
    /// `[variant][out][rows][cols][input]`.
    weights: Vec<Vec<i64>>,
    /// `[variant][out]`.
    bias: Vec<i64>,
    multipliers: Vec<i64>,
    add_multipliers: Vec<i64>,
    table: Option<Vec<u8>>,
}

/// Returns a random tensor of codes.
fn random_tensor(random: &mut Random, dtype: Dtype, size: (usize, usize), channels: usize) -> Tensor {
    let (low, high) = if dtype == Dtype::U8 { (0, 255) } else { (-32767, 32767) };
    let zero = if dtype == Dtype::U8 { random.within(0, 255) } else { 0 };
    let lo = if random.one_in(3) { zero } else { random.within(low, zero) };
    let margin = random.size(0, 2);
    let edge = random.pick(&[Edge::Zero, Edge::Nearest]);
    let tensor = Tensor::new(dtype, size, channels);
    let hi = random.within(zero, high) as i32;
    let scale = random.within(1, 99) as f32 / 64.0;
    let tensor = Tensor { zero: zero as i32, lo: lo as i32, hi, margin, edge, scale, ..tensor };
    let pitch = tensor.row_bytes() + random.size(0, 9);
    Tensor { pitch: random.pick(&[0, pitch]), ..tensor }
}

/// Returns one or two sources with the margin that the convolution needs.
fn random_sources(r: &mut Random, size: (usize, usize), pad: usize, fold: bool) -> Vec<Tensor> {
    let count = r.size(1, 2);
    let dtypes: Vec<Dtype> = (0..count).map(|_| r.pick(&[Dtype::U8, Dtype::U8, Dtype::I16])).collect();
    let (margin, edge) = if fold { (2, Edge::Nearest) } else { (pad, Edge::Zero) };
    let source = |dtype| {
        let channels = channels(r);
        let mut t = random_tensor(r, dtype, size, channels);
        if margin > 0 {
            (t.margin, t.edge) = (margin + r.size(0, 1), edge);
        }
        t
    };
    dtypes.into_iter().map(source).collect()
}

fn channels(random: &mut Random) -> usize {
    let (few, many) = (random.size(1, 9), random.size(1, 70));
    random.pick(&[1, few, few, many])
}

impl Case {
    pub(super) fn new(seed: u64, fold: bool) -> Self {
        let mut random = Random::new(seed);
        let r = &mut random;
        let low = if fold { 4 } else { 1 };
        let size = (r.size(low, 7), r.size(low, 24));
        let mut draft = Draft::new(size);
        let kernel = |r: &mut Random, len: usize, pad: usize| r.size(pad + 1, 5.max(pad + 1).min(len + 2 * pad));
        let pad = if fold { 2 } else { r.size(0, 2) };
        let (rows, cols) = if fold { (5, 5) } else { (kernel(r, size.0, pad), kernel(r, size.1, pad)) };
        let (stride, stride_cols) = if fold { (1, 1) } else { (r.size(1, 3), r.pick(&[1, 2, 3, 8])) };
        let mut tensors = random_sources(r, size, pad, fold);
        let extent = |len: usize, kernel: usize, stride: usize| match fold {
            true => 2 * len,
            false => (len + 2 * pad - kernel) / stride + 1,
        };
        let out_size = (extent(size.0, rows, stride), extent(size.1, cols, stride_cols));
        let conv = Conv {
            kernel_rows: rows,
            kernel_cols: cols,
            stride,
            stride_cols,
            block: r.size(1, 4.min(out_size.0)),
            pad,
            fold,
            ..Conv::default()
        };
        let weights = random_weights(r, &conv, &mut tensors);
        let out_channels = weights.0;
        let dtype = r.pick(&[Dtype::U8, Dtype::U8, Dtype::I16, Dtype::F32]);
        let mut out = random_tensor(r, dtype, out_size, out_channels);
        if dtype == Dtype::F32 {
            out = Tensor::new(dtype, out_size, out_channels);
        }
        // A step of a folded convolution writes two rows for each row of the block.
        out.ring = r.size(out.rows.min(conv.block * (1 + fold as usize)), out.rows);
        let add_dtype = r.pick(&[Dtype::U8, Dtype::I16]);
        let add = r.one_in(2).then(|| random_tensor(r, add_dtype, out_size, out_channels));
        let mut case = Self {
            conv,
            sources: tensors.iter().map(|t| (*t, random_map(r, t))).collect(),
            add: add.map(|t| (t, random_map(r, &t))),
            out,
            bias: r.list(weights.1.len() * out_channels, -(1 << 20), 1 << 20),
            weights: weights.1,
            multipliers: r.list(out_channels, -(1 << 30), 1 << 30),
            add_multipliers: r.list(out_channels, -(1 << 30), 1 << 30),
            table: (dtype == Dtype::U8 && r.one_in(3))
                .then(|| (0..256).map(|_| r.within(out.lo as i64, out.hi as i64) as u8).collect()),
            draft: draft.clone(),
        };
        case.write(r, &mut draft);
        case.draft = draft;
        case
    }

    /// Writes the record and its constants. The inputs have writers so that the schedule is legal.
    fn write(&mut self, r: &mut Random, draft: &mut Draft) {
        let numbers: Vec<u32> = self.sources.iter().map(|(t, _)| draft.made(*t)).collect();
        (self.conv.first, self.conv.second) = (numbers[0], numbers.get(1).copied());
        // The added map may be larger than the tile. It would be refused as an input, so a convolution writes it.
        let add = self.add.as_ref().map(|(t, _)| {
            let number = draft.place(*t);
            let silent = self.silent(draft, number);
            draft.operator(Operator::Conv(silent));
            number
        });
        self.conv.add = add;
        self.conv.out = draft.place(self.out);
        self.conv.weights = draft.constant(self.packed());
        let stored = self.stored_bias();
        self.conv.bias = draft.words(stored);
        let float = self.out.dtype == Dtype::F32;
        if float {
            let scales: Vec<u8> =
                self.multipliers.iter().flat_map(|m| (*m as f32 / (1u64 << 40) as f32).to_le_bytes()).collect();
            self.conv.multipliers = draft.constant(scales);
            (self.conv.shift, self.conv.relu) = (0, r.one_in(2));
        } else {
            self.conv.multipliers = draft.words(self.multipliers.iter().map(|m| *m as i32));
            let (any, likely) = (r.size(1, 60), r.size(34, 48));
            self.conv.shift = r.pick(&[any, likely, likely]) as u32;
        }
        self.conv.add_multipliers = draft.words(self.add_multipliers.iter().map(|m| *m as i32));
        self.conv.add_shift = r.size(0, 15) as u32;
        if let Some(table) = &self.table {
            self.conv.table = Some(draft.constant(table.iter().copied()));
            self.conv.table_zero = r.within(0, 255) as i32;
        }
        draft.operator(Operator::Conv(self.conv));
        draft.finish();
        draft.in_order();
    }

    /// Returns a convolution of the same form that writes another tensor of the output's shape.
    fn silent(&self, draft: &mut Draft, out: u32) -> Conv {
        let weights = draft.constant(vec![0; self.packed().len()]);
        let bias = draft.words(vec![0; self.bias.len()]);
        let multipliers = draft.words(vec![1; self.out.channels]);
        Conv { out, weights, bias, multipliers, shift: 1, ..self.conv }
    }

    fn extent(&self, variant: usize) -> (usize, usize) {
        extent(&self.conv, variant)
    }

    /// Returns the weights as `[panel][variant][source][kernel row][group][channel of the panel][4]`.
    fn packed(&self) -> Vec<u8> {
        let input: usize = self.sources.iter().map(|(t, _)| t.channels).sum();
        let mut bytes = Vec::new();
        for (first, width) in panels_of(self.out.channels) {
            for (variant, weights) in self.weights.iter().enumerate() {
                let (rows, cols) = self.extent(variant);
                let mut skipped = 0;
                for (t, _) in &self.sources {
                    for row in 0..rows {
                        // Samples of the kernel row, filled up to whole groups.
                        for group in (0..cols * t.channels).collect::<Vec<_>>().chunks(4) {
                            for o in first..first + width {
                                let mut four = [0u8; 4];
                                for (b, sample) in group.iter().enumerate().filter(|_| o < self.out.channels) {
                                    let (col, k) = (sample / t.channels, sample % t.channels);
                                    let at = ((o * rows + row) * cols + col) * input + skipped + k;
                                    four[b] = weights[at] as i8 as u8;
                                }
                                bytes.extend(four);
                            }
                        }
                    }
                    skipped += t.channels;
                }
            }
        }
        bytes
    }

    /// Returns the biases minus the contribution of the zero codes.
    fn stored_bias(&self) -> Vec<i32> {
        let input: usize = self.sources.iter().map(|(t, _)| t.channels).sum();
        let zeros: Vec<i64> = self.sources.iter().flat_map(|(t, _)| vec![zero_code(t); t.channels]).collect();
        let contributed = |variant: usize, o: usize| -> i64 {
            let taps = self.weights[variant].len() / self.out.channels;
            let filter = &self.weights[variant][o * taps..(o + 1) * taps];
            filter.iter().enumerate().map(|(i, w)| w * zeros[i % input]).sum()
        };
        let places = (0..self.weights.len()).flat_map(|v| (0..self.out.channels).map(move |o| (v, o)));
        places.zip(&self.bias).map(|((v, o), bias)| (bias - contributed(v, o)) as i32).collect()
    }

    /// Returns the value of the sources' channel at a place of the input; 0 in the padding.
    fn value(&self, source: usize, row: isize, col: isize, k: usize) -> i64 {
        let (t, map) = &self.sources[source];
        let inside = (0..t.rows as isize).contains(&row) && (0..t.cols as isize).contains(&col);
        if inside { map[(row as usize * t.cols + col as usize) * t.channels + k] } else { 0 }
    }

    /// Returns the filters for an output pixel, and the places that each of them reads.
    fn taps(&self, row: usize, col: usize) -> Vec<(usize, Vec<(isize, isize)>)> {
        if !self.conv.fold {
            let corner = |at: usize, stride: usize| (at * stride) as isize - self.conv.pad as isize;
            let (top, left) = (corner(row, self.conv.stride), corner(col, self.conv.stride_cols));
            let (rows, cols) = (self.conv.kernel_rows as isize, self.conv.kernel_cols as isize);
            let places = (0..rows).flat_map(|r| (0..cols).map(move |c| (top + r, left + c)));
            return vec![(0, places.collect())];
        }
        let t = &self.sources[0].0;
        let place = |r: isize, c: isize| (r.clamp(0, t.rows as isize - 1), c.clamp(0, t.cols as isize - 1));
        let (downs, acrosses) = (phases(row, t.rows), phases(col, t.cols));
        let mut all = Vec::new();
        for down in &downs {
            for across in &acrosses {
                let places = down.1.iter().flat_map(|&r| across.1.iter().map(move |&c| place(r, c)));
                all.push((PHASES * down.0 + across.0, places.collect()));
            }
        }
        all
    }

    fn expected(&self) -> Expected {
        let (mut map, mut cut) = (Vec::new(), 0);
        for (row, col) in (0..self.out.rows).flat_map(|r| (0..self.out.cols).map(move |c| (r, c))) {
            let mut sums = vec![0; self.out.channels];
            for (variant, places) in self.taps(row, col) {
                let mut patch = Vec::new();
                for &(r, c) in &places {
                    for (source, (t, _)) in self.sources.iter().enumerate() {
                        patch.extend((0..t.channels).map(|k| self.value(source, r, c, k)));
                    }
                }
                for (o, sum) in sums.iter_mut().enumerate() {
                    let filter = &self.weights[variant][o * patch.len()..(o + 1) * patch.len()];
                    *sum += filter.iter().zip(&patch).map(|(w, x)| w * x).sum::<i64>();
                    *sum += self.bias[variant * self.out.channels + o];
                }
            }
            for (o, sum) in sums.into_iter().enumerate() {
                let added = self.add.as_ref().map(|(_, map)| map[(row * self.out.cols + col) * self.out.channels + o]);
                map.push(self.finish(sum, added, o, &mut cut));
            }
        }
        let float = self.out.dtype == Dtype::F32;
        Expected { map, cut: Some(if float { 0 } else { cut }) }
    }

    /// Rounding, addition, clamping and table as [`Conv`] describes them.
    fn finish(&self, sum: i64, added: Option<i64>, o: usize, cut: &mut u64) -> i64 {
        assert!(i32::try_from(sum).is_ok(), "the case is legal");
        if self.out.dtype == Dtype::F32 {
            let scale = self.multipliers[o] as f32 / (1u64 << 40) as f32;
            let more = self.add.as_ref().map_or(0.0, |(t, _)| added.unwrap() as f32 * t.scale);
            let value = sum as i32 as f32 * scale + more;
            let value = if self.conv.relu && value < 0.0 { 0.0 } else { value };
            return value.to_bits() as i64;
        }
        let mut v = sum as i128 * self.multipliers[o] as i128;
        v += (added.unwrap_or(0) as i128 * self.add_multipliers[o] as i128) << self.conv.add_shift;
        // Adds half a step and rounds down: division by a power of two, rounded to nearest.
        let step = 1i128 << self.conv.shift;
        let v = (v + step / 2).div_euclid(step);
        let (lo, hi, zero) = (self.out.lo as i128, self.out.hi as i128, self.out.zero as i128);
        if let Some(table) = &self.table {
            let code = (v + self.conv.table_zero as i128).clamp(0, 255);
            return table[code as usize] as i64 - zero as i64;
        }
        let code = v + zero;
        *cut += (code > hi || (code < lo && lo != zero)) as u64;
        (code.clamp(lo, hi) - zero) as i64
    }

    fn check(&self) {
        let index = self.draft.operators.iter().position(|op| *op == Operator::Conv(self.conv)).unwrap();
        let mut inputs = vec![(self.conv.first, &self.sources[0].1)];
        inputs.extend(self.conv.second.map(|t| (t, &self.sources[1].1)));
        inputs.extend(self.conv.add.map(|t| (t, &self.add.as_ref().unwrap().1)));
        check(&self.draft, index, &inputs, &self.expected(), 0);
    }
}

fn extent(conv: &Conv, variant: usize) -> (usize, usize) {
    match conv.fold {
        true => (PHASE_TAPS[variant / PHASES], PHASE_TAPS[variant % PHASES]),
        false => (conv.kernel_rows, conv.kernel_cols),
    }
}

/// Returns the stored code of 0, as kernels read it: the planes of a 16-bit 0 are 0 and 128.
fn zero_code(t: &Tensor) -> i64 {
    if t.dtype == Dtype::I16 { 128 * 256 } else { t.zero as i64 }
}

/// Returns output channels and weights; the range of 16-bit sources is reduced until their sums fit 32 bits.
fn random_weights(r: &mut Random, conv: &Conv, sources: &mut [Tensor]) -> (usize, Vec<Vec<i64>>) {
    let (input, output) = (sources.iter().map(|t| t.channels).sum::<usize>(), channels(r));
    let variants = if conv.fold { PHASES * PHASES } else { 1 };
    let extents: Vec<(usize, usize)> = (0..variants).map(|v| extent(conv, v)).collect();
    let weights: Vec<Vec<i64>> =
        extents.iter().map(|(rows, cols)| r.list(output * rows * cols * input, -127, 127)).collect();
    // A corner of a folded convolution adds filters of 4 x 4, 4 x 1, 1 x 4 and 1 x 1 taps, and as many biases.
    let taps = if conv.fold { 25 } else { conv.kernel_rows * conv.kernel_cols } * input;
    let limit = ((i32::MAX as i64 - (1 << 22)) / (127 * taps as i64)).min(32767) as i32;
    for t in sources.iter_mut().filter(|t| t.dtype == Dtype::I16) {
        (t.lo, t.hi) = (t.lo.max(-limit), if r.one_in(2) { limit } else { t.hi.min(limit) });
    }
    (output, weights)
}

/// Returns first channels and widths of panels, computed independently: whole panels of 32, then the rest.
fn panels_of(channels: usize) -> Vec<(usize, usize)> {
    let whole = channels / 32 * 32;
    let mut panels: Vec<(usize, usize)> = (0..channels / 32).map(|i| (32 * i, 32)).collect();
    match channels - whole {
        0 => {}
        1..=8 => panels.push((whole, 8)),
        9..=16 => panels.push((whole, 16)),
        17..=24 => panels.extend([(whole, 16), (whole + 16, 8)]),
        _ => panels.push((whole, 32)),
    }
    panels
}

/// Returns the numbers of the filter and of the correction for output `index`, and the samples of the small map that they read.
pub(super) fn phases(index: usize, len: usize) -> Vec<(usize, Vec<isize>)> {
    let (middle, last) = ((index / 2) as isize, len as isize - 1);
    let filter = match index.is_multiple_of(2) {
        true => (0, (middle - 2..middle + 2).collect()),
        false => (1, (middle - 1..middle + 3).collect()),
    };
    match 2 * len - 1 - index {
        _ if index == 0 => vec![filter, (2, vec![0])],
        _ if index == 1 => vec![filter, (3, vec![0])],
        0 => vec![filter, (5, vec![last])],
        1 => vec![filter, (4, vec![last])],
        _ => vec![filter],
    }
}

proptest! {
    #[test]
    fn convolutions_equal_their_twin(seed in any::<u64>()) {
        Case::new(seed, false).check();
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn folded_convolutions_equal_their_twin(seed in any::<u64>()) {
        Case::new(seed, true).check();
    }
}

#[test]
fn sums_reach_the_ends_of_32_bits() {
    // All codes and weights at their limits: sums of both signs within a few steps of the limits of 32 bits, with wrapping on the way.
    for (weight, code) in [(127, 1), (127, -1), (-127, 1), (-127, -1)] {
        let mut case = Case::new(0, false);
        case.out = Tensor { lo: -32767, hi: 32767, ..Tensor::new(Dtype::I16, (6, 30), 40) };
        case.conv = Conv { kernel_rows: 5, kernel_cols: 5, pad: 2, stride: 1, ..Conv::default() };
        let limit = i32::MAX / (127 * 25 * 21);
        let t = Tensor { lo: -limit, hi: limit, margin: 2, ..Tensor::new(Dtype::I16, (6, 30), 21) };
        case.sources = vec![(t, vec![code * limit as i64; t.len()])];
        case.weights = vec![vec![weight; 40 * 25 * 21]];
        (case.bias, case.add, case.table) = (vec![0; 40], None, None);
        (case.multipliers, case.add_multipliers) = (vec![1 << 30; 40], vec![0; 40]);
        let mut draft = Draft::new((6, 30));
        case.write(&mut Random::new(1), &mut draft);
        case.conv.shift = 46;
        let index = draft.operators.len() - 2;
        draft.operators[index] = Operator::Conv(case.conv);
        case.draft = draft;
        let largest = (25 * 21 * 127 * limit as i64) as f64 / i32::MAX as f64;
        assert!(largest > 0.99, "{largest}");
        case.check();
    }
}
