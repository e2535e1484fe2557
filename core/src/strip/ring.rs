//! Lines that are kept, in pieces under checksums.
//!
//! ```text
//! line        | piece, 640 bytes | piece | ... | piece, the rest | checksum, u32 | checksum | ... |
//! ```
//! Whoever uses a line in a later call compares its pieces first ([`Ring::check`]). A piece that has changed is lost: its checksum becomes 0, and
//! its samples are voids until the line is written again.

use crate::nn::sum_bytes;
use crate::part::{copy, item, part, part_mut};
use core::ops::Range;

/// Number of bytes under one checksum.
pub(super) const PIECE: usize = 640;
/// Number of bytes of a checksum.
const SEAL: usize = 4;

/// The size of a ring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RingShape {
    /// Number of lines; a line takes the place of the line that is so many lines older.
    pub(super) lines: usize,
    /// Number of bytes of a line.
    pub(super) line_bytes: usize,
}

impl RingShape {
    /// Number of bytes of memory; `None` if they overflow.
    pub(super) fn bytes(self) -> Option<usize> {
        self.line_bytes.checked_add(self.seals())?.checked_mul(self.lines)
    }

    fn seals(self) -> usize {
        self.line_bytes.div_ceil(PIECE) * SEAL
    }
}

/// A ring of lines.
#[derive(Debug)]
pub(super) struct Ring<'m> {
    bytes: &'m mut [u8],
    shape: RingShape,
}

impl<'m> Ring<'m> {
    /// Takes a ring from the front of a block of memory; returns it with the rest.
    pub(super) fn cut(memory: &'m mut [u8], shape: RingShape) -> (Self, &'m mut [u8]) {
        let (bytes, rest) = memory.split_at_mut_checked(shape.bytes().unwrap_or(usize::MAX)).unwrap_or_default();
        (Self { bytes, shape }, rest)
    }

    /// Returns line `row`.
    pub(super) fn line(&self, row: usize) -> Line<'_> {
        let RingShape { line_bytes, .. } = self.shape;
        let at = self.first(row);
        Line { bytes: part(self.bytes, at, line_bytes), seals: part(self.bytes, at + line_bytes, self.shape.seals()) }
    }

    /// Writes line `row` as a whole.
    pub(super) fn write(&mut self, row: usize, fill: impl FnOnce(&mut [u8])) {
        let (bytes, seals) = self.parts(row);
        fill(bytes);
        for (piece, seal) in bytes.chunks(PIECE).zip(seals.chunks_mut(SEAL)) {
            copy(seal, &seal_of(piece));
        }
    }

    /// Writes the pieces of line `row` one after the other. `each` is told whether a piece was lost. They must have been compared in this call.
    pub(super) fn rewrite(&mut self, row: usize, mut each: impl FnMut(&mut [u8], bool)) {
        let (bytes, seals) = self.parts(row);
        for (piece, seal) in bytes.chunks_mut(PIECE).zip(seals.chunks_mut(SEAL)) {
            each(piece, *seal == LOST);
            copy(seal, &seal_of(piece));
        }
    }

    /// Changes a piece of line `row`, unless it is lost. It must have been compared in this call.
    pub(super) fn change(&mut self, row: usize, piece: usize, change: impl FnOnce(&mut [u8])) {
        let (bytes, seals) = self.parts(row);
        if let (Some(bytes), Some(seal)) = (bytes.chunks_mut(PIECE).nth(piece), seals.chunks_mut(SEAL).nth(piece))
            && *seal != LOST
        {
            change(bytes);
            copy(seal, &seal_of(bytes));
        }
    }

    /// Compares the pieces of line `row` that hold a range of bytes; returns the number of those that are lost since the last comparison.
    pub(super) fn check(&mut self, row: usize, range: Range<usize>) -> u64 {
        let (bytes, seals) = self.parts(row);
        let (first, end) = (range.start / PIECE, range.end.div_ceil(PIECE));
        let pieces = bytes.chunks(PIECE).zip(seals.chunks_mut(SEAL)).take(end).skip(first);
        let changed = pieces.filter(|(piece, seal)| **seal != LOST && **seal != seal_of(piece));
        changed.map(|(_, seal)| seal.fill(0)).count() as u64
    }

    fn parts(&mut self, row: usize) -> (&mut [u8], &mut [u8]) {
        let RingShape { line_bytes, .. } = self.shape;
        let (at, len) = (self.first(row), line_bytes + self.shape.seals());
        part_mut(self.bytes, at, len).split_at_mut_checked(line_bytes).unwrap_or_default()
    }

    fn first(&self, row: usize) -> usize {
        (row % self.shape.lines.max(1)).saturating_mul(self.shape.line_bytes + self.shape.seals())
    }
}

/// The place of the checksum of a piece that is lost.
const LOST: [u8; SEAL] = [0; SEAL];

fn seal_of(piece: &[u8]) -> [u8; SEAL] {
    sum_bytes(piece).max(1).to_ne_bytes()
}

/// A line of a ring.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line<'r> {
    pub(super) bytes: &'r [u8],
    seals: &'r [u8],
}

impl Line<'_> {
    /// Returns whether the piece of a byte is lost.
    pub(super) fn is_lost(&self, byte: usize) -> bool {
        part(self.seals, byte / PIECE * SEAL, SEAL) == LOST
    }

    /// Returns the float at an index; NaN if its piece is lost.
    pub(super) fn float(&self, index: usize) -> f32 {
        let at = 4 * index;
        let bytes = core::array::from_fn(|k| item(self.bytes, at + k));
        if self.is_lost(at) { f32::NAN } else { f32::from_ne_bytes(bytes) }
    }
}

/// Writes floats as bytes.
pub(super) fn put_floats(bytes: &mut [u8], values: impl IntoIterator<Item = f32>) {
    for (bytes, value) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(values) {
        *bytes = value.to_ne_bytes();
    }
}
