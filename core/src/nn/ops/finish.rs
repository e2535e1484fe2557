//! From a convolution's accumulators to the output's codes: bias, multiplier, added map, rounding, clamping, table.

use crate::nn::arena::{Arena, Row, high};
use crate::nn::kernels::{ACCUMULATORS, PANEL};
use crate::nn::model::Model;
use crate::nn::program::{Conv, Dtype, Tensor};
use crate::quant::lut::CODE_TABLE_LEN;

/// What the accumulators of one panel need.
pub(super) struct Finish<'a> {
    out: &'a Tensor,
    /// First channel, channels that exist, width of the panel.
    first: usize,
    channels: usize,
    width: usize,
    bias: [i32; PANEL],
    multiplier: [i32; PANEL],
    /// With an F32 output: the multipliers.
    scale: [f32; PANEL],
    add: Option<Tensor>,
    add_multiplier: [i32; PANEL],
    add_shift: u32,
    half: i64,
    shift: u32,
    table: Option<&'a [u8]>,
    table_zero: i32,
    relu: bool,
}

/// Output pixels: a row, the first column, the distance between columns.
pub(super) struct Target {
    pub(super) row: usize,
    pub(super) col: usize,
    pub(super) col_step: usize,
    pub(super) pixels: usize,
}

impl<'a> Finish<'a> {
    #[inline(always)]
    pub(super) fn new(
        model: &Model<'a>,
        conv: &Conv,
        out: &'a Tensor,
        (first, width): (usize, usize),
        variant: usize,
    ) -> Self {
        let channels = (out.channels - first).min(width);
        let float = out.dtype == Dtype::F32;
        let list = |offset: usize, skip: usize| {
            let mut values = [0; PANEL];
            let bytes = model.constants(offset + 4 * (skip + first), 4 * channels).as_chunks::<4>().0;
            for (value, &b) in values.iter_mut().zip(bytes) {
                *value = i32::from_le_bytes(b);
            }
            values
        };
        let multiplier = list(conv.multipliers, 0);
        let mut scale = [0.0; PANEL];
        for (scale, bits) in scale.iter_mut().zip(multiplier) {
            *scale = f32::from_bits(bits as u32);
        }
        let added = conv.add.is_some() && !float;
        Self {
            out,
            first,
            channels,
            width,
            bias: list(conv.bias, variant * out.channels),
            multiplier,
            scale,
            add: conv.add.map(|t| model.tensor(t)),
            add_multiplier: if added { list(conv.add_multipliers, 0) } else { [0; PANEL] },
            add_shift: conv.add_shift,
            half: 1 << (conv.shift.max(1) - 1),
            shift: conv.shift & 63,
            table: conv.table.map(|table| model.constants(table, CODE_TABLE_LEN)),
            table_zero: conv.table_zero,
            relu: conv.relu,
        }
    }

    /// Stores the samples of `acc[pixel][channel of the panel]`; returns how many were cut.
    #[inline(always)]
    pub(super) fn run(&self, arena: &mut Arena<'_>, acc: &[i32; ACCUMULATORS], target: &Target) -> u64 {
        if self.out.dtype == Dtype::F32 {
            self.floats(arena, acc, target);
            return 0;
        }
        match self.width {
            32 => self.codes::<32>(arena, acc, target),
            16 => self.codes::<16>(arena, acc, target),
            _ => self.codes::<8>(arena, acc, target),
        }
    }

    #[inline(always)]
    fn floats(&self, arena: &mut Arena<'_>, acc: &[i32; ACCUMULATORS], target: &Target) {
        let t = self.out;
        for c in 0..self.channels {
            let mut added = [0i32; ACCUMULATORS];
            let mut scale = 0.0;
            if let Some(add) = &self.add {
                scale = add.scale;
                let row = Row::of(add, target.row);
                for (p, added) in added[..target.pixels].iter_mut().enumerate() {
                    *added = row.value(arena.bytes, (target.col + p * target.col_step) * t.channels + self.first + c);
                }
            }
            let start = t.row_offset(target.row);
            for (p, added) in added[..target.pixels].iter().enumerate() {
                // Conversions, products and a sum, each rounded as IEEE 754 says: the same bits everywhere.
                let sum = acc[p * self.width + c].wrapping_add(self.bias[c]);
                let value = sum as f32 * self.scale[c] + *added as f32 * scale;
                let value = if self.relu && value < 0.0 { 0.0 } else { value };
                let at = start + 4 * ((target.col + p * target.col_step) * t.channels + self.first + c);
                if let Some(bytes) = arena.bytes[at..].first_chunk_mut() {
                    *bytes = value.to_le_bytes();
                }
            }
        }
    }

    /// `W` is the panel's width, known to the compiler.
    #[inline(always)]
    fn codes<const W: usize>(&self, arena: &mut Arena<'_>, acc: &[i32; ACCUMULATORS], target: &Target) -> u64 {
        // All arrays are [pixel][channel of the panel].
        let mut codes = [0i32; ACCUMULATORS];
        let cut = match &self.add {
            Some(add) => {
                let mut added = [0i32; ACCUMULATORS];
                let row = Row::of(add, target.row);
                for (p, added) in added.as_chunks_mut::<W>().0[..target.pixels].iter_mut().enumerate() {
                    let index = (target.col + p * target.col_step) * self.out.channels + self.first;
                    row.values(arena.bytes, index, &mut added[..self.channels]);
                }
                self.round::<W, true>(acc, &added, &mut codes, target.pixels)
            }
            None => self.round::<W, false>(acc, acc, &mut codes, target.pixels),
        };
        if let Some(table) = self.table {
            for code in &mut codes[..target.pixels * W] {
                *code = table[*code as usize & 255] as i32;
            }
        }
        self.store::<W>(arena, &codes, target);
        cut
    }

    #[inline(always)]
    fn round<const W: usize, const ADD: bool>(
        &self,
        acc: &[i32; ACCUMULATORS],
        added: &[i32; ACCUMULATORS],
        codes: &mut [i32; ACCUMULATORS],
        pixels: usize,
    ) -> u64 {
        let t = self.out;
        let (zero, lo, hi) = match self.table {
            Some(_) => (self.table_zero as i64, 0, 255),
            None => (t.zero as i64, t.lo as i64, t.hi as i64),
        };
        // Cutting at the zero point is a ReLU, and beyond a table's ends it goes on as it ends: no faults.
        let floor = if self.table.is_some() || t.lo == t.zero { i64::MIN } else { lo };
        let ceiling = if self.table.is_some() { i64::MAX } else { hi };
        let (acc, added) = (acc.as_chunks::<W>().0, added.as_chunks::<W>().0);
        let mut cuts = [0i64; W];
        for ((codes, acc), added) in codes.as_chunks_mut::<W>().0[..pixels].iter_mut().zip(acc).zip(added) {
            for c in 0..W {
                let mut v = acc[c].wrapping_add(self.bias[c]) as i64 * self.multiplier[c] as i64 + self.half;
                if ADD {
                    v += (added[c] as i64 * self.add_multiplier[c] as i64) << self.add_shift;
                }
                let v = (v >> self.shift) + zero;
                cuts[c] += (v > ceiling) as i64 + (v < floor) as i64;
                codes[c] = v.clamp(lo, hi) as i32;
            }
        }
        let mut cut = 0;
        for &one in &cuts[..self.channels] {
            cut += one as u64;
        }
        cut
    }

    #[inline(always)]
    fn store<const W: usize>(&self, arena: &mut Arena<'_>, codes: &[i32; ACCUMULATORS], target: &Target) {
        let t = self.out;
        let start = t.row_offset(target.row) + (t.margin + target.col) * t.channels + self.first;
        let pitch = target.col_step * t.channels;
        let mut bytes = [0u8; ACCUMULATORS];
        for plane in 0..t.dtype.bytes() {
            if plane == 0 {
                for (byte, code) in bytes.iter_mut().zip(codes) {
                    *byte = *code as u8;
                }
            } else {
                for (byte, code) in bytes.iter_mut().zip(codes) {
                    *byte = high(*code);
                }
            }
            let start = start + plane * t.plane_bytes();
            for (p, bytes) in bytes.as_chunks::<W>().0[..target.pixels].iter().enumerate() {
                let to = &mut arena.bytes[start + p * pitch..];
                // Copies of a length that is known to the compiler are one or two instructions.
                match (self.channels, to.first_chunk_mut::<W>()) {
                    (channels, Some(to)) if channels == W => *to = *bytes,
                    (12, _) => to[..12].copy_from_slice(&bytes[..12]),
                    (channels, _) => to[..channels].copy_from_slice(&bytes[..channels]),
                }
            }
        }
    }
}
