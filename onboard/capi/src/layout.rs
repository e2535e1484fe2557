//! The places of the parts in the lent memory.
//!
//! ```text
//! | context, twice | job, twice | bits of valid pixels | bits of dark pixels | coarse heights, f32 | scratch, f32 | lines, f64 | light of the scene, twice | arena |
//! ```

use crate::sealed::{self, HEAD_BYTES};
use core::ops::Range;
use elunar_core::job::LightSurvey;
use elunar_core::nn::{Model, required};
use elunar_core::{TileJob, TileMemory};

/// Alignment of the lent memory, bytes: an array of `uint64_t` has it everywhere.
pub(crate) const ALIGN_BYTES: usize = 8;
/// Alignment of the parts (a cache line), if the memory has it.
const LINE_BYTES: usize = 64;

/// Byte ranges within the lent memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Layout {
    /// The job of the tile, sealed.
    pub(crate) job: Range<usize>,
    /// Bits of valid heights, one per pixel.
    pub(crate) valid: Range<usize>,
    /// Bits of dark pixels, one per pixel.
    pub(crate) dark: Range<usize>,
    /// Coarse heights of the tile, `f32`.
    pub(crate) coarse: Range<usize>,
    /// Scratch memory of the tile, `f32`; later its heights.
    pub(crate) scratch: Range<usize>,
    /// Sums over a row or column, `f64`.
    pub(crate) lines: Range<usize>,
    /// What tiles showed of the scene's light, sealed.
    pub(crate) survey: Range<usize>,
    /// Arena of the network's tensors.
    pub(crate) arena: Range<usize>,
}

impl Layout {
    /// Returns the layout for a model; `None` if this machine cannot address it.
    pub(crate) fn of(model: &Model<'_>) -> Option<Self> {
        let (tile, rules) = (model.tile(), model.input_rules());
        let mut end = HEAD_BYTES;
        let mut next = |len: usize, bytes: usize| {
            let start = end.checked_next_multiple_of(LINE_BYTES)?;
            end = start.checked_add(len.checked_mul(bytes)?).filter(|end| *end <= isize::MAX as usize)?;
            Some(start..end)
        };
        Some(Self {
            job: next(sealed::block_bytes(TileJob::WORDS), 1)?,
            valid: next(TileMemory::valid_len(tile), 1)?,
            dark: next(TileMemory::valid_len(tile), 1)?,
            coarse: next(tile.pixels(), 4)?,
            scratch: next(TileMemory::scratch_len(&rules, tile), 4)?,
            lines: next(TileMemory::lines_len(tile), 8)?,
            survey: next(sealed::block_bytes(LightSurvey::WORDS), 1)?,
            arena: next(required(model), 1)?,
        })
    }

    /// Number of bytes of all parts.
    pub(crate) fn bytes(&self) -> usize {
        self.arena.end
    }
}
