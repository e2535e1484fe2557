//! Checksums of a tile's memory between two calls: what flips in between is found before it is used.

use super::{JobError, Pass, TileJob, TileMemory};
use crate::nn::{Progress, sum_bytes, sum_floats};
use crate::words::Words;

/// A part of the memory of a tile ([`TileMemory`]). Sums over lines are not kept between two calls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TilePart {
    /// Coarse heights.
    Coarse,
    /// Bits of valid heights.
    Valid,
    /// Scratch memory, at last with the heights.
    Scratch,
}

/// Checksums of the parts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Seals {
    coarse: u32,
    valid: u32,
    scratch: u32,
}

impl Seals {
    /// Writes or reads them.
    pub(super) fn visit(&mut self, words: &mut Words<'_>) {
        let Self { coarse, valid, scratch } = self;
        [coarse, valid, scratch].into_iter().for_each(|seal| words.u32(seal));
    }
}

impl TileJob {
    /// Compares the memory with what it was at the end of the last call for this tile. [`Self::prepare`] and [`Self::run`] do so before they use
    /// it; a caller does that reads heights or validity in a later call.
    ///
    /// # Errors
    /// [`JobError::Changed`].
    pub fn check<F>(&self, memory: &TileMemory<'_>) -> Result<(), JobError<F>> {
        let Seals { coarse, valid, scratch } = self.seals;
        let part = if self.is_begun() && sum_floats(memory.coarse_m) != coarse {
            TilePart::Coarse
        } else if self.is_begun() && sum_bytes(memory.valid) != valid {
            TilePart::Valid
        } else if self.keeps_scratch() && sum_floats(memory.scratch) != scratch {
            TilePart::Scratch
        } else {
            return Ok(());
        };
        Err(JobError::Changed { part })
    }

    /// Does `work` between a comparison and new checksums. It gets their cost; the first unit is done whatever the budget.
    pub(super) fn guarded<F>(
        &mut self,
        memory: &mut TileMemory<'_>,
        budget: u64,
        work: impl FnOnce(&mut Self, &mut TileMemory<'_>, u64) -> Result<Progress, JobError<F>>,
    ) -> Result<Progress, JobError<F>> {
        self.check(memory)?;
        let (since, spent) = (self.pass, self.guard_cost(memory).min(budget.saturating_sub(1)));
        let worked = work(self, memory, spent);
        // Also after an error: the tile may be given up.
        self.seal(since, memory);
        worked
    }

    /// Notes the checksums of what the next call will use. `since` is the pass at which this call began.
    fn seal(&mut self, since: Pass, memory: &TileMemory<'_>) {
        if since < Pass::Measure {
            (self.seals.coarse, self.seals.valid) = (sum_floats(memory.coarse_m), sum_bytes(memory.valid));
        }
        if self.keeps_scratch() {
            self.seals.scratch = sum_floats(memory.scratch);
        }
    }

    /// Cost of a comparison and of new checksums, in the unit of the budget: four bytes count as a multiply-accumulate.
    fn guard_cost(&self, memory: &TileMemory<'_>) -> u64 {
        let scratch = if self.keeps_scratch() { 2 * memory.scratch.len() } else { 0 };
        (2 * memory.coarse_m.len() + memory.valid.len() / 2 + scratch) as u64
    }

    fn is_begun(&self) -> bool {
        (self.pass, self.unit) != (Pass::Take, 0)
    }

    /// Returns whether the next call uses what the scratch memory holds.
    fn keeps_scratch(&self) -> bool {
        self.is_begun() && !matches!(self.pass, Pass::Network | Pass::Output | Pass::Keep)
    }
}
