//! Samples of a map, from wherever and in whatever form they are kept.
//!
//! A camera has bytes, 12 or 16 bits, in its own memory. [`Samples`] lets the path of a tile read them there, without a copy in floating point.

use crate::norm::Mirror;
use crate::part::{copy, item, part, put};
use crate::tile::Shape;

/// Samples of a row-major map. One that is not real ([`crate::mask`]) is a void.
pub trait Samples: Copy {
    /// Number of samples.
    fn len(&self) -> usize;

    /// Returns whether there are no samples.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns a sample; NaN beyond the end.
    fn at(&self, index: usize) -> f32;

    /// Cost of reading a sample beyond that of a float in memory, about that of so many multiply-accumulates.
    #[inline]
    fn work(&self) -> u64 {
        0
    }

    /// Writes the samples from `first` on, all of one row.
    #[inline]
    fn read(&self, first: usize, out: &mut [f32]) {
        for (value, index) in out.iter_mut().zip(first..) {
            *value = self.at(index);
        }
    }

    /// Returns as many samples from `first` on as `room` holds, all of one row: in `room`, unless they are kept as floats.
    #[inline]
    fn line<'r>(&'r self, first: usize, room: &'r mut [f32]) -> &'r [f32] {
        self.read(first, room);
        room
    }
}

impl Samples for &[f32] {
    #[inline]
    fn len(&self) -> usize {
        <[f32]>::len(self)
    }

    #[inline]
    fn at(&self, index: usize) -> f32 {
        self.get(index).copied().unwrap_or(f32::NAN)
    }

    #[inline]
    fn read(&self, first: usize, out: &mut [f32]) {
        copy(out, part(self, first, out.len()));
    }

    #[inline]
    fn line<'r>(&'r self, first: usize, room: &'r mut [f32]) -> &'r [f32] {
        part(self, first, room.len())
    }
}

/// Samples of which only those with a bit of 1 count; the others are voids. Bits are in reading order, the lowest of a byte first.
#[derive(Debug, Clone, Copy)]
pub struct Masked<'b, S> {
    /// All samples.
    pub samples: S,
    /// A bit for each.
    pub bits: &'b [u8],
}

impl<S: Samples> Samples for Masked<'_, S> {
    #[inline]
    fn len(&self) -> usize {
        self.samples.len()
    }

    #[inline]
    fn at(&self, index: usize) -> f32 {
        if is_set(self.bits, index) { self.samples.at(index) } else { f32::NAN }
    }

    #[inline]
    fn read(&self, first: usize, out: &mut [f32]) {
        self.samples.read(first, out);
        // Few tiles have voids.
        let bytes = self.bits.get(first / 8..first.saturating_add(out.len()).div_ceil(8)).unwrap_or_default();
        if !bytes.is_empty() && bytes.iter().all(|byte| *byte == u8::MAX) {
            return;
        }
        for (value, index) in out.iter_mut().zip(first..) {
            if !is_set(self.bits, index) {
                *value = f32::NAN;
            }
        }
    }
}

/// Writes samples of a mirrored map of this shape, from the row-major index `first` on, all of one row.
pub(crate) fn read_mirrored(samples: &impl Samples, mirror: Mirror, first: usize, shape: Shape, out: &mut [f32]) {
    let from = mirror.source(first, shape);
    if mirror.cols {
        samples.read(from.saturating_sub(out.len().saturating_sub(1)), out);
        out.reverse();
    } else {
        samples.read(from, out);
    }
}

/// Returns whether the bit of a sample is 1.
#[must_use]
#[inline]
pub fn is_set(bits: &[u8], index: usize) -> bool {
    bits.get(index / 8).is_some_and(|byte| byte >> (index % 8) & 1 == 1)
}

/// Sets the bit of a sample to 1.
#[inline]
pub(crate) fn set(bits: &mut [u8], index: usize) {
    put(bits, index / 8, item(bits, index / 8) | 1 << (index % 8));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masked_samples_are_void_and_lines_are_those_of_single_samples() {
        let samples = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0];
        let masked = Masked { samples: &samples[..], bits: &[0b1010_0101, 0b10] };
        let expected = [true, false, true, false, false, true, false, true, false, true];
        for (i, valid) in expected.into_iter().enumerate() {
            assert_eq!(masked.at(i).is_nan(), !valid);
            assert!(!valid || masked.at(i) == samples[i]);
        }
        assert!(masked.at(10).is_nan() && masked.len() == 10 && !masked.is_empty());
        let mut out = [0.0; 4];
        (&samples[..]).read(3, &mut out);
        assert_eq!(out, samples[3..7]);
        assert_eq!((&samples[..]).line(3, &mut [0.0; 4]), &samples[3..7]);
        masked.read(4, &mut out);
        assert!(out.iter().zip(4..).all(|(v, i)| v.to_bits() == masked.at(i).to_bits()));
        let whole = Masked { samples: &samples[..], bits: &[u8::MAX] };
        whole.read(2, &mut out);
        assert_eq!(out, samples[2..6]);
        whole.read(6, &mut out);
        assert!(out[1] == 8.0 && out[2].is_nan(), "beyond the bits nothing counts: {out:?}");
    }
}
