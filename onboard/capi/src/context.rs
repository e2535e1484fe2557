//! A context for the duration of a call: opened, validated and repaired at its start, written back at its end.

use crate::record::{ContextRecord, EMPTY, PREPARING, SELF_TEST, SURVEY, TILE};
use crate::sealed::{self, Head};
use crate::status::*;
use crate::types::eld_status_t;
use elunar_core::TileMemory;
use elunar_core::nn::{Model, Suspended};

/// The result of a piece of work. Both variants are statuses; an error ends the work.
pub(crate) type Outcome = Result<eld_status_t, eld_status_t>;

/// The parts of the lent memory behind the context (see [`crate::layout`]).
pub(crate) struct Lent<'m> {
    pub(crate) job: &'m mut [u8],
    pub(crate) survey: &'m mut [u8],
    pub(crate) tile: TileMemory<'m>,
    pub(crate) dark: &'m mut [u8],
    pub(crate) arena: &'m mut [u8],
}

/// An open context.
pub(crate) struct Context<'h> {
    head: &'h mut Head,
    pub(crate) record: ContextRecord,
}

impl<'h> Context<'h> {
    /// Writes a new context.
    pub(crate) fn make(head: &'h mut Head, record: ContextRecord) {
        sealed::write(head, &record);
    }

    /// Reads the context at address `home`.
    ///
    /// # Errors
    /// The status with which the call ends.
    pub(crate) fn open(head: &'h mut Head, home: usize) -> Result<Self, eld_status_t> {
        let (record, damaged) = sealed::read(head).ok_or(ELD_FAULT_CONTEXT_LOST)?;
        if record.home != home as u64 {
            return Err(ELD_FAULT_CONTEXT_MOVED);
        }
        let mut context = Self { head, record };
        context.record.calls = context.record.calls.wrapping_add(1);
        context.repaired(damaged);
        if context.record.busy != 0 { Err(context.close(Err(ELD_FAULT_INTERRUPTED))) } else { Ok(context) }
    }

    /// Returns the model; an error if it is not the one that was validated.
    pub(crate) fn model<'m>(&self, bytes: &'m [u8]) -> Result<Model<'m>, eld_status_t> {
        Model::reopen(bytes, &self.record.verdict).map_err(|_| ELD_FAULT_MODEL_CHANGED)
    }

    /// Counts a copy of words that was damaged, and is written again at the end of the work.
    pub(crate) fn repaired(&mut self, damaged: bool) {
        let record = &mut self.record;
        record.repairs = record.repairs.wrapping_add(u64::from(damaged));
        record.repairs_untold = record.repairs_untold.saturating_add(u32::from(damaged));
    }

    /// Marks the arena as changing in the lent memory, so that the next call notices a call that did not return.
    pub(crate) fn start(&mut self) {
        self.record.busy = 1;
        sealed::write(self.head, &self.record);
    }

    /// Ends the call: updates the counters, writes both copies, and returns the status.
    pub(crate) fn close(mut self, outcome: Outcome) -> eld_status_t {
        let status = match outcome {
            Ok(status) | Err(status) => status,
        };
        let record = &mut self.record;
        record.busy = 0;
        if severity(status) == FAULT {
            record.faults = record.faults.wrapping_add(1);
            record.last_fault = status;
        }
        if status == ELD_FAULT_LIGHT {
            record.lights_added = 0;
        }
        if matches!(status, ELD_FAULT_RUN | ELD_FAULT_INTERRUPTED | ELD_FAULT_VALIDITY | ELD_FAULT_DATA_CHANGED) {
            record.lose_tile();
        }
        // A repair is reported once, by the first call whose status is ELD_OK otherwise.
        let tells = status == ELD_OK && record.repairs_untold > 0;
        if tells {
            record.repairs_untold = 0;
        }
        sealed::write(self.head, record);
        if tells { ELD_NOTICE_REPAIRED } else { status }
    }

    /// Returns whether a tile is in progress.
    pub(crate) fn at_work(&self) -> bool {
        let phase = self.record.suspended.phase;
        match self.record.tile {
            PREPARING | SURVEY => true,
            TILE => self.record.made == 0,
            tile => tile != EMPTY && [Suspended::LOADING, Suspended::AT_WORK, Suspended::VERIFYING].contains(&phase),
        }
    }

    /// Returns whether the tile of kind `whose` is finished.
    ///
    /// # Errors
    /// The status for a tile that is not finished, or is of the other kind.
    pub(crate) fn finished(&self, whose: u32) -> Result<(), eld_status_t> {
        let ContextRecord { tile, made, suspended, .. } = self.record;
        match tile {
            EMPTY | SURVEY => Err(ELD_REFUSED_NO_TILE),
            PREPARING if whose == TILE => Err(ELD_REFUSED_NOT_DONE),
            _ if tile != whose => Err(ELD_REFUSED_OTHER_TILE),
            TILE if made == 0 => Err(ELD_REFUSED_NOT_DONE),
            SELF_TEST if suspended.phase != Suspended::DONE => Err(ELD_REFUSED_NOT_DONE),
            _ => Ok(()),
        }
    }
}
