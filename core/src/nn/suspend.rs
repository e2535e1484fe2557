//! A run put aside as plain integers and taken up again.
//!
//! For callers that keep nothing of ours between two calls but numbers, as a C interface does whose context may be hit by radiation:
//! every bit pattern of a [`Suspended`] or a [`super::Verdict`] can be read, and what is made of them is validated first.
//!
//! ```text
//! Model::new -> verdict()              validated once: time proportional to the file
//! Model::reopen(bytes, verdict)        header checksum, length and sections only
//! Runner::resume(.., suspended) -> step ... -> suspend()
//! ```

use super::dispatch::Kernel;
use super::error::RunError;
use super::model::Model;
use super::runner::{Runner, State, Telemetry};
use super::scrub::Scrub;

/// Where a runner stands; the default is a new one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Suspended {
    /// [`Suspended::IDLE`], [`Suspended::AT_WORK`], [`Suspended::DONE`] or [`Suspended::VERIFYING`].
    pub phase: u32,
    /// 1 for a runner that trusts its memory, 0 for any other.
    pub trusting: u32,
    /// Entry of the schedule at work, or the chunk of the model to be compared next; else 0, as the next two unless at work.
    pub entry: u32,
    /// Step of that entry.
    pub step: u32,
    /// Unit of that step.
    pub unit: u32,
    /// Chunk that scrubbing has reached.
    pub scrub_chunk: u32,
    /// Bytes of that chunk that are read.
    pub scrub_offset: u32,
    /// CRC32C of those.
    pub scrub_crc: u32,
    /// The counters.
    pub telemetry: Telemetry,
}

impl Suspended {
    /// No tile was begun.
    pub const IDLE: u32 = 0;
    /// A tile is at work.
    pub const AT_WORK: u32 = 1;
    /// A tile is finished and its output there.
    pub const DONE: u32 = 2;
    /// All of a tile is computed; the model is being compared.
    pub const VERIFYING: u32 = 3;
}

impl<'a, 'm> Runner<'a, 'm> {
    /// Where the runner stands. The arena keeps the rest; it must be as it is now when the run is resumed.
    pub fn suspend(&self) -> Suspended {
        let (phase, entry, step, unit) = match self.state {
            State::Idle => (Suspended::IDLE, 0, 0, 0),
            State::At { entry, step, unit } => (Suspended::AT_WORK, entry, step, unit),
            State::Verifying { chunk } => (Suspended::VERIFYING, chunk as usize, 0, 0),
            State::Done => (Suspended::DONE, 0, 0, 0),
        };
        let (scrub_chunk, scrub_offset, scrub_crc) = self.scrub.position();
        Suspended {
            phase,
            trusting: !self.protected as u32,
            entry: entry as u32,
            step: step as u32,
            unit: unit as u32,
            scrub_chunk,
            scrub_offset: scrub_offset as u32,
            scrub_crc,
            telemetry: self.telemetry,
        }
    }

    /// The runner that was suspended, in the arena it left.
    ///
    /// # Errors
    /// [`RunError::ArenaTooSmall`]; [`RunError::State`] if the model has no such place in its schedule or among its chunks.
    pub fn resume(
        kernel: Kernel,
        model: Model<'a>,
        arena: &'m mut [u8],
        suspended: &Suspended,
    ) -> Result<Self, RunError> {
        let mut runner = Self::with_kernel(kernel, model, arena)?;
        runner.state = state(&model, suspended).ok_or(RunError::State)?;
        runner.protected = match suspended.trusting {
            0 => true,
            1 => false,
            _ => return Err(RunError::State),
        };
        let Suspended { scrub_chunk, scrub_offset, scrub_crc, telemetry, .. } = *suspended;
        runner.scrub = Scrub::at(model.raw(), scrub_chunk, scrub_offset as usize, scrub_crc).ok_or(RunError::State)?;
        runner.telemetry = telemetry;
        Ok(runner)
    }
}

/// The state, if the model has such a place.
fn state(model: &Model<'_>, at: &Suspended) -> Option<State> {
    let (entry, step, unit) = (at.entry as usize, at.step as usize, at.unit as usize);
    match at.phase {
        Suspended::AT_WORK => {
            let now = model.entry(entry)?;
            let operator = model.operator(now.operator)?;
            (step < now.count && unit < model.units(&operator)).then_some(State::At { entry, step, unit })
        }
        Suspended::VERIFYING if step == 0 && unit == 0 => {
            (at.entry < model.raw().chunks()).then_some(State::Verifying { chunk: at.entry })
        }
        phase if at.entry != 0 || at.step != 0 || at.unit != 0 || phase > Suspended::DONE => None,
        Suspended::DONE => Some(State::Done),
        _ => Some(State::Idle),
    }
}
