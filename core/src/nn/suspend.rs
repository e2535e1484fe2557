//! Suspends a run as plain integers and resumes it.
//!
//! This is for callers that keep only numbers between two calls, such as a C interface whose context radiation may change. Every bit
//! pattern of a [`Suspended`] or a [`super::Verdict`] is readable, and its values are validated before use.
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
use crate::words::Words;

/// The position of a runner; the default is that of a new one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Suspended {
    /// [`Suspended::IDLE`], [`Suspended::LOADING`], [`Suspended::AT_WORK`], [`Suspended::DONE`] or [`Suspended::VERIFYING`].
    pub phase: u32,
    /// [`Suspended::TRUSTING`] and [`Suspended::CHECKED`], or 0.
    pub protection: u32,
    /// Current entry of the schedule, the next chunk of the model to be compared, or the next row to be loaded; else 0. `step` and `unit` are 0 unless a tile is in
    /// progress.
    pub entry: u32,
    /// Step of that entry.
    pub step: u32,
    /// Unit of that step.
    pub unit: u32,
    /// Current chunk of scrubbing.
    pub scrub_chunk: u32,
    /// Number of bytes of that chunk that were read.
    pub scrub_offset: u32,
    /// CRC32C of these bytes.
    pub scrub_crc: u32,
    /// The counters.
    pub telemetry: Telemetry,
}

impl Suspended {
    /// No tile was begun.
    pub const IDLE: u32 = 0;
    /// A tile is in progress.
    pub const AT_WORK: u32 = 1;
    /// A tile is finished and its output can be read.
    pub const DONE: u32 = 2;
    /// All operators of a tile are done; the model is being compared.
    pub const VERIFYING: u32 = 3;
    /// The tile of the self test is being loaded. Three bits differ from the phases of a tile.
    pub const LOADING: u32 = 12;

    /// Protection: memory is not looked at ([`Runner::protect`]).
    pub const TRUSTING: u32 = 1;
    /// Protection: the processor is looked at ([`Runner::check_products`]).
    pub const CHECKED: u32 = 2;

    /// Number of words of a position.
    pub(crate) const WORDS: usize = 18;

    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        let Self { phase, protection, entry, step, unit, scrub_chunk, scrub_offset, scrub_crc, telemetry: t } = self;
        for v in [phase, protection, entry, step, unit, scrub_chunk, scrub_offset, scrub_crc] {
            words.u32(v);
        }
        let Telemetry { tiles, steps, macs, inputs_clamped, saturated, .. } = t;
        [tiles, steps, macs, inputs_clamped, saturated].into_iter().for_each(|v| words.u64(v));
        let Telemetry { scrubbed_bytes, scrub_passes, scrub_faults, self_test_faults, tile_faults, .. } = t;
        for v in [scrubbed_bytes, scrub_passes, scrub_faults, self_test_faults, tile_faults] {
            words.u64(v);
        }
    }
}

impl<'a, 'm> Runner<'a, 'm> {
    /// Returns the position of the runner. The arena holds the rest; it must be unchanged when the run is resumed.
    pub fn suspend(&self) -> Suspended {
        let (phase, entry, step, unit) = match self.state {
            State::Idle => (Suspended::IDLE, 0, 0, 0),
            State::Loading { row } => (Suspended::LOADING, row, 0, 0),
            State::At { entry, step, unit } => (Suspended::AT_WORK, entry, step, unit),
            State::Verifying { chunk } => (Suspended::VERIFYING, chunk as usize, 0, 0),
            State::Done => (Suspended::DONE, 0, 0, 0),
        };
        let (scrub_chunk, scrub_offset, scrub_crc) = self.scrub.position();
        Suspended {
            phase,
            protection: (!self.protected as u32 * Suspended::TRUSTING) | (self.checked as u32 * Suspended::CHECKED),
            entry: entry as u32,
            step: step as u32,
            unit: unit as u32,
            scrub_chunk,
            scrub_offset: scrub_offset as u32,
            scrub_crc,
            telemetry: self.telemetry,
        }
    }

    /// Resumes a suspended runner with the arena that it used.
    ///
    /// # Errors
    /// [`RunError::ArenaTooSmall`]; [`RunError::State`] if the position does not exist in the model's schedule or among its chunks.
    pub fn resume(
        kernel: Kernel,
        model: Model<'a>,
        arena: &'m mut [u8],
        suspended: &Suspended,
    ) -> Result<Self, RunError> {
        let mut runner = Self::with_kernel(kernel, model, arena)?;
        runner.state = state(&model, suspended).ok_or(RunError::State)?;
        let protection = suspended.protection;
        if protection & !(Suspended::TRUSTING | Suspended::CHECKED) != 0 {
            return Err(RunError::State);
        }
        runner.protected = protection & Suspended::TRUSTING == 0;
        runner.checked = protection & Suspended::CHECKED != 0;
        let Suspended { scrub_chunk, scrub_offset, scrub_crc, telemetry, .. } = *suspended;
        runner.scrub = Scrub::at(model.raw(), scrub_chunk, scrub_offset as usize, scrub_crc).ok_or(RunError::State)?;
        runner.telemetry = telemetry;
        Ok(runner)
    }
}

/// Returns the state; `None` if the model does not have this position.
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
        Suspended::LOADING if step == 0 && unit == 0 => {
            (entry < model.tile().rows).then_some(State::Loading { row: entry })
        }
        phase if at.entry != 0 || at.step != 0 || at.unit != 0 || phase > Suspended::DONE => None,
        Suspended::DONE => Some(State::Done),
        _ => Some(State::Idle),
    }
}
