//! The way from accumulators to the output's codes: bias, multiplier, added map, rounding, clamping, table.

use super::{ACCUMULATORS, Accumulators, BLOCK, Isa, pixels_at_once};
use crate::nn::arena::{Arena, Row, high, join};
use crate::nn::panels::PANEL;
use crate::nn::tensor::{Dtype, Tensor};
use crate::part::{copy, head, head_mut, item, put};
use crate::quant::limit::{Alone, limit, limit_wide};
use crate::quant::lut::CODE_TABLE_LEN;

/// Constants for the accumulators of one panel.
#[derive(PartialEq)]
pub(crate) struct Requantise<'a> {
    pub(crate) out: &'a Tensor,
    /// First channel, number of existing channels, width of the panel.
    pub(crate) first: usize,
    pub(crate) channels: usize,
    pub(crate) width: usize,
    pub(crate) bias: [i32; PANEL],
    pub(crate) multiplier: [i32; PANEL],
    pub(crate) add: Option<Tensor>,
    pub(crate) add_multiplier: [i32; PANEL],
    pub(crate) add_shift: u32,
    pub(crate) half: i64,
    pub(crate) shift: u32,
    pub(crate) table: Option<&'a [u8]>,
    /// Code of 0, and the limits that codes are clamped to, before the table.
    pub(crate) zero: i64,
    pub(crate) lo: i64,
    pub(crate) hi: i64,
    /// Results outside `floor..=ceiling` count as cut.
    pub(crate) floor: i64,
    pub(crate) ceiling: i64,
    /// With an F32 output: negative results become 0.
    pub(crate) relu: bool,
}

/// Output pixels: row, first column, distance between columns, number of pixels.
pub(crate) struct Target {
    pub(crate) row: usize,
    pub(crate) col: usize,
    pub(crate) col_step: usize,
    pub(crate) pixels: usize,
}

impl Target {
    /// Returns the offset in the arena of the first sample from channel `first` on of a U8 or I16 tensor, and the bytes from pixel to
    /// pixel.
    #[inline(always)]
    pub(crate) fn place(&self, t: &Tensor, first: usize) -> (usize, usize) {
        (t.row_offset(self.row) + (t.margin + self.col) * t.channels + first, self.col_step * t.channels)
    }
}

impl Requantise<'_> {
    /// Stores the samples of `acc[pixel][channel of the panel]`; returns how many were cut.
    #[inline(always)]
    pub(crate) fn run<I: Isa>(&self, arena: &mut Arena<'_>, acc: &Accumulators, target: &Target) -> u64 {
        if self.out.dtype == Dtype::F32 {
            self.floats(arena, acc, target);
            return 0;
        }
        I::requantise(self, arena.bytes, acc, target)
    }

    /// Stores the F32 output tensor: a map of one channel. A pixel here may be several columns of it.
    #[inline(always)]
    fn floats(&self, arena: &mut Arena<'_>, acc: &Accumulators, target: &Target) {
        let scale = self.multiplier.map(|bits| f32::from_bits(bits as u32));
        let (mut added, mut added_scale) = ([0i32; PANEL], 0.0);
        let relu = -(self.relu as i32);
        for p in 0..target.pixels {
            let first = (target.col + p * target.col_step) * self.out.channels + self.first;
            if let Some(add) = &self.add {
                added_scale = add.scale;
                Row::of(add, target.row).values(arena.bytes, first, head_mut(&mut added, self.channels));
            }
            let to = arena.bytes.get_mut(self.out.row_offset(target.row) + 4 * first..).unwrap_or_default();
            let numbers = self.bias.iter().zip(&scale).zip(&added);
            let channels = to.as_chunks_mut::<4>().0.iter_mut().zip(numbers).take(self.channels);
            for (c, (to, ((bias, scale), added))) in channels.enumerate() {
                // Conversions, products and a sum, each rounded by IEEE 754: the same bits on every processor.
                let sum = item(acc, p * self.width + c).wrapping_add(*bias);
                let value = sum as f32 * scale + *added as f32 * added_scale;
                // The ReLU sets every value with a sign bit to 0, without a branch.
                let bits = value.to_bits() as i32;
                *to = (bits & !((bits >> 31) & relu)).to_le_bytes();
            }
        }
    }

    /// The portable version of [`Isa::requantise`].
    #[inline(always)]
    pub(crate) fn portable(&self, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
        if let Some(acc) =
            acc.first_chunk().filter(|_| BLOCK == ACCUMULATORS || target.pixels <= pixels_at_once(self.width))
        {
            return self.block(bytes, acc, target);
        }
        let (mut cut, mut acc) = (0, head(acc, target.pixels * self.width));
        for first in (0..target.pixels).step_by(pixels_at_once(self.width)) {
            let pixels = (target.pixels - first).min(pixels_at_once(self.width));
            let (now, rest) = acc.split_at_checked(pixels * self.width).unwrap_or_default();
            let mut block = [0; BLOCK];
            copy(head_mut(&mut block, now.len()), now);
            let col = target.col + first * target.col_step;
            cut += self.block(bytes, &block, &Target { col, pixels, ..*target });
            acc = rest;
        }
        cut
    }

    #[inline(always)]
    fn block(&self, bytes: &mut [u8], acc: &[i32; BLOCK], target: &Target) -> u64 {
        // [pixel][channel of the panel].
        let mut codes = [0i32; BLOCK];
        let cut = match self.width {
            32 => self.codes::<32>(bytes, acc, &mut codes, target),
            16 => self.codes::<16>(bytes, acc, &mut codes, target),
            _ => self.codes::<8>(bytes, acc, &mut codes, target),
        };
        let table: Option<&[u8; CODE_TABLE_LEN]> = self.table.and_then(|table| table.first_chunk());
        if let Some(table) = table {
            for code in head_mut(&mut codes, target.pixels * self.width) {
                *code = table[*code as usize & 255] as i32;
            }
        }
        match self.width {
            32 => self.store::<32>(bytes, &codes, target),
            16 => self.store::<16>(bytes, &codes, target),
            _ => self.store::<8>(bytes, &codes, target),
        }
        cut
    }

    /// As [`Self::portable`], for processors without vectors: channel by channel, whose constants stay in registers, with stores directly
    /// to the arena.
    #[inline(always)]
    pub(crate) fn by_channels(&self, bytes: &mut [u8], acc: &Accumulators, target: &Target) -> u64 {
        if self.shift < 32 {
            return self.portable(bytes, acc, target);
        }
        let added = self.add.as_ref().map(|t| t.dtype);
        match (added, self.out.dtype == Dtype::I16) {
            (None, false) => self.channels::<0, false>(bytes, acc, target),
            (None, true) => self.channels::<0, true>(bytes, acc, target),
            (Some(Dtype::U8), false) => self.channels::<1, false>(bytes, acc, target),
            (Some(Dtype::U8), true) => self.channels::<1, true>(bytes, acc, target),
            (_, false) => self.channels::<2, false>(bytes, acc, target),
            (_, true) => self.channels::<2, true>(bytes, acc, target),
        }
    }

    /// `ADD` is the number of bytes of an added map's sample. `WIDE` says that the output has two planes. The shift is 32 or more, see
    /// [`Self::round_by`].
    #[inline(always)]
    fn channels<const ADD: usize, const WIDE: bool>(
        &self,
        bytes: &mut [u8],
        acc: &Accumulators,
        target: &Target,
    ) -> u64 {
        let table: Option<&[u8; CODE_TABLE_LEN]> = self.table.and_then(|table| table.first_chunk());
        let (start, pitch) = target.place(self.out, self.first);
        let plane = self.out.plane_bytes();
        let (from, add_pitch) = self.add.as_ref().map_or((0, 0), |t| target.place(t, self.first));
        let (add_plane, add_zero) = self.add.as_ref().map_or((0, 0), |t| (t.plane_bytes(), t.zero));
        let (zero, lo, hi) = (self.zero as i32, self.lo as i32, self.hi as i32);
        let (floor, ceiling) = (narrow(self.floor), narrow(self.ceiling));
        let mut cut = 0;
        for c in 0..self.channels.min(PANEL) {
            let (bias, multiplier, add_multiplier) = (self.bias[c], self.multiplier[c], self.add_multiplier[c]);
            let (mut to, mut from) = (start + c, from + c);
            for acc in acc.chunks_exact(self.width.max(1)).take(target.pixels) {
                let mut v = item(acc, c).wrapping_add(bias) as i64 * multiplier as i64 + self.half;
                if ADD > 0 {
                    let low = item(bytes, from);
                    let added = if ADD == 1 { low as i32 - add_zero } else { join(low, item(bytes, from + add_plane)) };
                    v += (added << (self.add_shift & 31)) as i64 * add_multiplier as i64;
                    from += add_pitch;
                }
                let v = ((v >> 32) as i32 >> (self.shift & 31)) + zero;
                let mut code = limit(v, lo, hi);
                cut += (v > ceiling) as u32 + (v < floor) as u32;
                if let Some(table) = table {
                    code = table[code as usize & 255] as i32;
                }
                put(bytes, to, code as u8);
                if WIDE {
                    put(bytes, to + plane, high(code));
                }
                to += pitch;
            }
        }
        cut as u64
    }

    /// Finds codes before the table of codes, and counts those that were cut. `W` is the panel's width, a constant for the compiler.
    #[inline(always)]
    fn codes<const W: usize>(
        &self,
        bytes: &[u8],
        acc: &[i32; BLOCK],
        codes: &mut [i32; BLOCK],
        target: &Target,
    ) -> u64 {
        let Some(add) = &self.add else { return self.round::<W, false>(acc, acc, codes, target.pixels) };
        let mut added = [0i32; BLOCK];
        let row = Row::of(add, target.row);
        for (p, added) in added.as_chunks_mut::<W>().0.iter_mut().take(target.pixels).enumerate() {
            let index = (target.col + p * target.col_step) * self.out.channels + self.first;
            row.values(bytes, index, head_mut(added, self.channels));
        }
        self.round::<W, true>(acc, &added, codes, target.pixels)
    }

    #[inline(always)]
    fn round<const W: usize, const ADD: bool>(
        &self,
        acc: &[i32; BLOCK],
        added: &[i32; BLOCK],
        codes: &mut [i32; BLOCK],
        pixels: usize,
    ) -> u64 {
        if self.shift >= 32 {
            self.round_by::<W, ADD, true>(acc, added, codes, pixels)
        } else {
            self.round_by::<W, ADD, false>(acc, added, codes, pixels)
        }
    }

    /// With `HIGH` the shift is 32 or more, as in almost every model. Then the upper half of the product is enough, and all following
    /// numbers have 32 bits.
    #[inline(always)]
    fn round_by<const W: usize, const ADD: bool, const HIGH: bool>(
        &self,
        acc: &[i32; BLOCK],
        added: &[i32; BLOCK],
        codes: &mut [i32; BLOCK],
        pixels: usize,
    ) -> u64 {
        let (acc, added) = (acc.as_chunks::<W>().0, added.as_chunks::<W>().0);
        let (low_shift, alone) = (self.shift & 31, Alone::new());
        let (zero, lo, hi) = (narrow(self.zero), narrow(self.lo), narrow(self.hi));
        let (floor, ceiling) = (narrow(self.floor), narrow(self.ceiling));
        let mut cuts = [0i32; W];
        for ((codes, acc), added) in codes.as_chunks_mut::<W>().0.iter_mut().take(pixels).zip(acc).zip(added) {
            for c in 0..W {
                let mut v = acc[c].wrapping_add(self.bias[c]) as i64 * self.multiplier[c] as i64 + self.half;
                if ADD {
                    // An i16 shifted by up to 15 bits fits into an i32.
                    v += (added[c] << (self.add_shift & 31)) as i64 * self.add_multiplier[c] as i64;
                }
                let (v, code) = if HIGH {
                    // Sums stay below 2^62, their upper halves below 2^30.
                    let v = ((v >> 32) as i32 >> low_shift) + zero;
                    (v, limit(v, lo, hi))
                } else {
                    let v = alone.limit((v >> low_shift) + self.zero, i32::MIN as i64, i32::MAX as i64);
                    (v as i32, alone.limit(v, lo as i64, hi as i64) as i32)
                };
                cuts[c] += (v > ceiling) as i32 + (v < floor) as i32;
                codes[c] = code;
            }
        }
        let mut cut = 0;
        for &one in head(&cuts, self.channels) {
            cut += one as u64;
        }
        cut
    }

    #[inline(always)]
    fn store<const W: usize>(&self, arena: &mut [u8], codes: &[i32; BLOCK], target: &Target) {
        let t = self.out;
        let (start, pitch) = target.place(t, self.first);
        let mut bytes = [0u8; BLOCK];
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
            for (p, bytes) in bytes.as_chunks::<W>().0.iter().take(target.pixels).enumerate() {
                let Some(to) = arena.get_mut(start + p * pitch..) else { continue };
                // A copy of constant length is one or two instructions.
                match (self.channels, to.first_chunk_mut::<W>()) {
                    (channels, Some(to)) if channels == W => *to = *bytes,
                    (12, _) => copy(head_mut(to, 12), head(bytes, 12)),
                    (channels, _) => copy(head_mut(to, channels), bytes),
                }
            }
        }
    }
}

/// Clamps a limit to the range of i32, which no code exceeds.
#[inline(always)]
pub(crate) fn narrow(limit: i64) -> i32 {
    limit_wide(limit, i32::MIN as i64, i32::MAX as i64) as i32
}

#[cfg(test)]
mod tests;
