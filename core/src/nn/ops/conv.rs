//! Convolution: one output row of up to [`CHANNEL_GROUP`] channels.
//!
//! Scratch holds the kernel's input rows as i16 with the zero point removed, in a ring (row r in slot r mod kernel rows), each
//! padded with zeros left and right. A kernel row against a stretch of such a row is then one dot product of contiguous
//! samples. Sources are read side by side into the ring, enlarged on the way if they ask for it.

use super::saturate;
use crate::nn::arena::{Arena, Sample};
use crate::nn::kernels::{CHANNEL_GROUP, Kernel, Le16, PIXELS, Sums};
use crate::nn::model::{ConvShape, Model};
use crate::nn::program::{Conv, Dtype, Source, Tensor};
use crate::quant::lut::CODE_TABLE_LEN;
use crate::quant::round_shift;

/// Runs unit `unit` (row-major over output rows and channel groups).
pub(crate) fn run(kernel: &Kernel, model: &Model<'_>, conv: &Conv, arena: &mut Arena<'_>, unit: usize) -> u64 {
    let out = model.tensor(conv.out);
    let shape = model.conv_shape(conv);
    let groups = out.channels.div_ceil(CHANNEL_GROUP);
    let (row, group) = (unit / groups, unit % groups);
    if group == 0 {
        let fresh = if row == 0 { conv.kernel_rows } else { conv.kernel_rows.min(conv.stride) };
        let end = row * conv.stride + conv.kernel_rows;
        for padded_row in end - fresh..end {
            fill_row(model, conv, &shape, arena, padded_row);
        }
    }
    let first = group * CHANNEL_GROUP;
    let job = Row { model, conv, shape: &shape, out: &out, row };
    if out.channels - first >= CHANNEL_GROUP {
        return job.run(arena, first, |sums: &mut Sums, x, w| (kernel.group)(sums, x, w));
    }
    let single = |channel| job.run(arena, channel, |[sums]: &mut [_; 1], x, [w]| (kernel.single)(sums, x, w));
    (first..out.channels).map(single).sum()
}

/// One output row of a convolution.
struct Row<'a, 'm> {
    model: &'a Model<'m>,
    conv: &'a Conv,
    shape: &'a ConvShape,
    out: &'a Tensor,
    row: usize,
}

impl Row<'_, '_> {
    /// `C` channels from `first` on, their sums made by `add`.
    #[inline(always)]
    fn run<const C: usize>(
        &self,
        arena: &mut Arena<'_>,
        first: usize,
        add: impl Fn(&mut [[i32; PIXELS]; C], [&[Le16]; PIXELS], [&[u8]; C]),
    ) -> u64 {
        let Self { model, conv, shape, out, row } = *self;
        let size = conv.kernel_rows * shape.segment;
        let weights = model.constants(conv.weights + first * size, C * size);
        let finish: [Finish<'_>; C] = core::array::from_fn(|c| Finish::new(model, conv, out, first + c));
        let mut saturated = 0;
        let mut col = 0;
        while col < out.cols {
            // At the end of a row the last block steps back; its first pixels are computed twice and stored once.
            let start = col.min(out.cols.saturating_sub(PIXELS));
            let mut sums = finish.each_ref().map(|finish| [finish.bias; PIXELS]);
            for k in 0..conv.kernel_rows {
                let slot = (row * conv.stride + k) % conv.kernel_rows * shape.row_samples;
                let stretch = |p: usize| {
                    let x = slot + (start + p).min(out.cols - 1) * conv.stride * shape.in_channels;
                    &arena.scratch[x..x + shape.segment]
                };
                let weights = |c: usize| &weights[c * size + k * shape.segment..][..shape.segment];
                add(&mut sums, core::array::from_fn(stretch), core::array::from_fn(weights));
            }
            let end = out.cols.min(start + PIXELS);
            for pixel in col..end {
                let index = (row * out.cols + pixel) * out.channels + first;
                for (c, finish) in finish.iter().enumerate() {
                    saturated += finish.store(arena, out, index + c, sums[c][pixel - start]) as u64;
                }
            }
            col = end;
        }
        saturated
    }
}

/// What turns one output channel's accumulator into its stored sample.
struct Finish<'a> {
    bias: i32,
    multiplier: i32,
    scale: f32,
    shift: u32,
    add: Option<(Tensor, i64)>,
    table: Option<(&'a [u8], i64)>,
    relu: bool,
}

impl<'a> Finish<'a> {
    fn new(model: &Model<'a>, conv: &Conv, out: &Tensor, channel: usize) -> Self {
        let float = out.dtype == Dtype::F32;
        let add_multiplier = if float { 0 } else { model.constant_i32(conv.add_multipliers, channel) };
        Self {
            bias: model.constant_i32(conv.bias, channel),
            multiplier: model.constant_i32(conv.multipliers, channel),
            scale: model.constant_f32(conv.multipliers, channel),
            shift: conv.shift,
            add: conv.add.map(|add| (model.tensor(add), (add_multiplier as i64) << conv.add_shift)),
            table: conv.table.map(|table| (model.constants(table, CODE_TABLE_LEN), conv.table_zero as i64)),
            relu: conv.relu,
        }
    }

    #[inline(always)]
    fn store(&self, arena: &mut Arena<'_>, out: &Tensor, index: usize, acc: i32) -> bool {
        if out.dtype == Dtype::F32 {
            let added = self.add.map_or(0.0, |(tensor, _)| arena.float(&tensor, index));
            // One conversion, one product, one sum, each rounded as IEEE 754 says: the same bits everywhere.
            let value = acc as f32 * self.scale + added;
            arena.store_float(out, index, if self.relu && value < 0.0 { 0.0 } else { value });
            return false;
        }
        let added = self.add.map_or(0, |(tensor, m)| arena.value(&tensor, index) as i64 * m);
        let v = round_shift(acc as i64 * self.multiplier as i64 + added, self.shift);
        let (code, cut) = match self.table {
            Some((table, zero)) => (table[(v + zero).clamp(0, 255) as usize] as i32, false),
            None => saturate(v, out),
        };
        arena.store(out, index, code);
        cut
    }
}

/// Fills the ring slot of row `padded_row` (counted with the top padding) from all sources.
fn fill_row(model: &Model<'_>, conv: &Conv, shape: &ConvShape, arena: &mut Arena<'_>, padded_row: usize) {
    let slot = padded_row % conv.kernel_rows * shape.row_samples;
    let Arena { tensors, scratch } = arena;
    let dst = &mut scratch[slot..slot + shape.row_samples];
    dst.fill([0; 2]);
    let Some(row) = padded_row.checked_sub(conv.pad).filter(|&row| row < shape.in_rows) else { return };
    let pad = conv.pad * shape.in_channels;
    let dst = &mut dst[pad..pad + shape.in_cols * shape.in_channels];
    let mut first = 0;
    for source in conv.sources() {
        let tensor = model.tensor(source.tensor);
        let place = Place { first, channels: tensor.channels, step: shape.in_channels };
        match tensor.dtype {
            Dtype::U8 => fill_source::<u8>(tensors, &tensor, &source, row, dst, place),
            _ => fill_source::<Le16>(tensors, &tensor, &source, row, dst, place),
        }
        first += tensor.channels;
    }
}

/// Which channels of the row a source fills.
#[derive(Clone, Copy)]
struct Place {
    first: usize,
    channels: usize,
    step: usize,
}

fn fill_source<S: Sample>(tensors: &[u8], t: &Tensor, source: &Source, row: usize, dst: &mut [Le16], place: Place) {
    let row_at = |r: usize| S::cast(&tensors[t.offset + r * t.row_bytes()..][..t.row_bytes()]);
    if !source.up {
        let pixels = row_at(row).chunks_exact(t.channels);
        for (dst, src) in dst.chunks_exact_mut(place.step).zip(pixels) {
            for (d, s) in dst[place.first..place.first + place.channels].iter_mut().zip(src) {
                *d = ((s.code() - t.zero) as i16).to_le_bytes();
            }
        }
        return;
    }
    let (near, far) = taps(row, t.rows);
    let (near_row, far_row) = (row_at(near), row_at(far));
    let half = if source.shift == 0 { 0 } else { 1 << (source.shift - 1) };
    for (col, dst) in dst.chunks_exact_mut(place.step).enumerate() {
        let (near, far) = taps(col, t.cols);
        let (near, far) = (near * t.channels, far * t.channels);
        let (a, b) = (&near_row[near..near + t.channels], &near_row[far..far + t.channels]);
        let (c, d) = (&far_row[near..near + t.channels], &far_row[far..far + t.channels]);
        let dst = &mut dst[place.first..place.first + place.channels];
        for i in 0..t.channels.min(dst.len()) {
            let sum = 9 * a[i].code() + 3 * (b[i].code() + c[i].code()) + d[i].code() - 16 * t.zero;
            dst[i] = (((sum + half) >> source.shift) as i16).to_le_bytes();
        }
    }
}

/// Twofold bilinear enlargement with half-pixel centres: output `index` takes 3/4 of the first and 1/4 of the second input
/// sample returned; beyond the border the border sample repeats.
fn taps(index: usize, len: usize) -> (usize, usize) {
    let near = index / 2;
    let far = if index.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(len - 1) };
    (near, far)
}

#[cfg(test)]
mod tests {
    use super::taps;

    #[test]
    fn bilinear_taps_are_those_of_half_pixel_centres() {
        for len in 1..6 {
            for index in 0..2 * len {
                let centre = ((index as f64 + 0.5) / 2.0 - 0.5).clamp(0.0, (len - 1) as f64);
                let (near, far) = taps(index, len);
                assert_eq!(0.75 * near as f64 + 0.25 * far as f64, centre, "output {index} of {len}");
            }
        }
    }
}
