//! Reads and writes tensors in the caller's bytes.

use super::tensor::{Dtype, Edge, Tensor};
use crate::part::{copy, part, part_mut};

/// The lent memory: tensors at their planned offsets, then scratch memory of the running operator, then a few bytes behind the last sample.
/// Kernels may read these last bytes and multiply them by 0.
#[derive(Debug)]
pub(crate) struct Arena<'m> {
    /// All bytes of the arena.
    pub(crate) bytes: &'m mut [u8],
    /// Offset of the scratch memory.
    pub(crate) scratch: usize,
}

/// Bytes that kernels may read behind the last sample.
pub(crate) const OVERREAD: usize = 4;

impl Arena<'_> {
    /// Returns the f32 at sample `index` of a row.
    #[inline(always)]
    pub(crate) fn float(&self, t: &Tensor, row: usize, index: usize) -> f32 {
        let at = t.row_offset(row) + 4 * index;
        self.bytes.get(at..).and_then(|b| b.first_chunk()).map_or(0.0, |&b| f32::from_le_bytes(b))
    }

    /// Fills the margins of row `row` from its first and last pixel, or with the code of 0.
    #[inline(always)]
    pub(crate) fn fill_margins(&mut self, t: &Tensor, row: usize) {
        if t.margin == 0 {
            return;
        }
        let (planes, plane, side) = (t.dtype.bytes(), t.plane_bytes(), t.margin * t.channels);
        for p in 0..planes {
            let start = t.row_offset(row) + p * plane;
            let row = part_mut(self.bytes, start, plane);
            let Some((left, rest)) = row.split_at_mut_checked(side) else { continue };
            let Some((middle, right)) = rest.split_at_mut_checked(rest.len().saturating_sub(side)) else { continue };
            match t.edge {
                Edge::Zero => {
                    let code = zero_code(t, p);
                    left.fill(code);
                    right.fill(code);
                }
                Edge::Nearest => {
                    let channels = t.channels.max(1);
                    let (first, last) =
                        (part(middle, 0, channels), part(middle, middle.len().wrapping_sub(channels), channels));
                    left.chunks_mut(channels).for_each(|pixel| copy(pixel, first));
                    right.chunks_mut(channels).for_each(|pixel| copy(pixel, last));
                }
            }
        }
    }
}

/// Returns the high plane's byte of a 16-bit code.
#[inline(always)]
pub(crate) const fn high(code: i32) -> u8 {
    ((code >> 8) + 128) as u8
}

/// Returns a 16-bit code from the bytes of its two planes.
#[inline(always)]
pub(crate) const fn join(low: u8, high: u8) -> i32 {
    (high as i32 - 128) * 256 + low as i32
}

/// Returns the byte that stands for 0 in plane `plane` of a tensor.
#[inline(always)]
pub(crate) const fn zero_code(t: &Tensor, plane: usize) -> u8 {
    match (t.dtype, plane) {
        (Dtype::I16, 0) => 0,
        (Dtype::I16, _) => 128,
        _ => t.zero as u8,
    }
}

/// Place of the samples of one row of a U8 or I16 tensor.
#[derive(Clone, Copy)]
pub(crate) struct Row {
    /// Offset of the first sample behind the margin.
    pub(crate) at: usize,
    /// Distance to the high plane; 0 if there is none.
    pub(crate) high: usize,
    zero: i32,
}

impl Row {
    #[inline(always)]
    pub(crate) fn of(t: &Tensor, row: usize) -> Self {
        let high = if t.dtype == Dtype::U8 { 0 } else { t.plane_bytes() };
        Self { at: t.row_offset(row) + t.margin * t.channels, high, zero: t.zero }
    }

    /// Reads the values of the samples from `index` on, as many as `out` holds.
    #[inline(always)]
    pub(crate) fn values(&self, bytes: &[u8], index: usize, out: &mut [i32]) {
        let at = self.at + index;
        let (low, high) = (part(bytes, at, out.len()), part(bytes, at.wrapping_add(self.high), out.len()));
        let wide = self.high != 0;
        let one = |low: u8, high: u8| if wide { join(low, high) } else { low as i32 - self.zero };
        // Whole groups first: rows are short, and compilers vectorise loops of unknown length badly.
        let (groups, rest) = out.as_chunks_mut::<GROUP>();
        let ((lows, low), (highs, high)) = (low.as_chunks::<GROUP>(), high.as_chunks::<GROUP>());
        for ((out, low), high) in groups.iter_mut().zip(lows).zip(highs) {
            for k in 0..GROUP {
                out[k] = one(low[k], high[k]);
            }
        }
        for ((out, &low), &high) in rest.iter_mut().zip(low).zip(high) {
            *out = one(low, high);
        }
    }

    /// Stores codes from sample `index` on.
    #[inline(always)]
    pub(crate) fn store(&self, bytes: &mut [u8], index: usize, codes: &[i32]) {
        let at = self.at + index;
        narrow(part_mut(bytes, at, codes.len()), codes, 0);
        if self.high != 0 {
            narrow(part_mut(bytes, at.wrapping_add(self.high), codes.len()), codes, 1);
        }
    }
}

/// Number of samples in the innermost loops.
const GROUP: usize = 8;

/// Writes plane `plane` of some codes.
#[inline(always)]
fn narrow(bytes: &mut [u8], codes: &[i32], plane: usize) {
    let one = |code: i32| if plane == 0 { code as u8 } else { high(code) };
    let ((groups, rest), (from, last)) = (bytes.as_chunks_mut::<GROUP>(), codes.as_chunks::<GROUP>());
    for (bytes, codes) in groups.iter_mut().zip(from) {
        for k in 0..GROUP {
            bytes[k] = one(codes[k]);
        }
    }
    for (byte, &code) in rest.iter_mut().zip(last) {
        *byte = one(code);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_hold_every_code() {
        for code in -32767..=32767 {
            assert_eq!(join(code as u8, high(code)), code);
        }
    }
}
