//! The places of the parts in the lent memory.
//!
//! ```text
//! | context, twice | validity, 1 bit a pixel | scratch of begin, f32 | arena of the network |
//! ```

use crate::sealed::HEAD_BYTES;
use core::ops::Range;
use elunar_core::nn::{Model, required};
use elunar_core::tile::Shape;

/// Alignment of the lent memory, bytes: an array of `uint64_t` has it everywhere.
pub(crate) const ALIGN_BYTES: usize = 8;
/// Alignment of the parts (a cache line), if the memory has it.
const LINE_BYTES: usize = 64;

/// Byte ranges within the lent memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Layout {
    /// Bits of valid heights, one per pixel.
    pub(crate) validity: Range<usize>,
    /// Scratch memory, `f32`, to begin a tile; empty for models without a given light.
    pub(crate) scratch: Range<usize>,
    /// Arena of the network's tensors.
    pub(crate) arena: Range<usize>,
}

impl Layout {
    /// Returns the layout for a model; `None` if this machine cannot address it.
    pub(crate) fn of(model: &Model<'_>) -> Option<Self> {
        let Shape { rows, cols } = model.tile();
        let behind = |end: usize, bytes: usize| {
            let start = end.checked_next_multiple_of(LINE_BYTES)?;
            let end = start.checked_add(bytes).filter(|end| *end <= isize::MAX as usize)?;
            Some(start..end)
        };
        let validity = behind(HEAD_BYTES, rows.checked_mul(cols)?.div_ceil(8))?;
        let scratch = behind(validity.end, model.scratch_len().checked_mul(4)?)?;
        let arena = behind(scratch.end, required(model))?;
        Some(Self { validity, scratch, arena })
    }

    /// Number of bytes of all parts.
    pub(crate) fn bytes(&self) -> usize {
        self.arena.end
    }
}
