//! The state of a strip between two calls, as words that are kept twice ([`crate::sealed`]).

use crate::context::Outcome;
use crate::sealed::{block_bytes, read_words, write_words};
use crate::status::*;
use crate::types::eld_status_t;
use elunar_core::nn::{Model, Verdict};
use elunar_core::strip::{StripPaused, StripSettings};

/// "ELDSTR" and the version of the record.
const STRIP: u64 = u64::from_le_bytes(*b"ELDSTR\x00\x01");
/// Number of words before those of settings and strip.
const OWN: usize = 12;
/// Number of words of a record.
const WORDS: usize = OWN + StripSettings::WORDS + StripPaused::WORDS;
/// Number of bytes of both copies.
pub(crate) const STRIP_HEAD_BYTES: usize = block_bytes(WORDS);
/// Both copies.
pub(crate) type StripHead = [u8; STRIP_HEAD_BYTES];

/// The state of a strip.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StripRecord {
    /// Address and length of the lent memory, bytes.
    pub(crate) home: u64,
    pub(crate) home_bytes: u64,
    /// Address of the model; the verdict has its length.
    pub(crate) model: u64,
    pub(crate) verdict: Verdict,
    /// 1 while a call changes the memory.
    pub(crate) busy: u32,
    /// Repairs that no status has reported yet.
    pub(crate) repairs_untold: u32,
    pub(crate) last_fault: u32,
    /// Counters: see [`super::types::eld_strip_telemetry_t`].
    pub(crate) calls: u64,
    pub(crate) faults: u64,
    pub(crate) repairs: u64,
    pub(crate) settings: [u64; StripSettings::WORDS],
    pub(crate) paused: [u64; StripPaused::WORDS],
}

/// Returns two numbers as a word.
fn pair(low: u32, high: u32) -> u64 {
    u64::from(low) | u64::from(high) << 32
}

impl StripRecord {
    fn words(&self) -> [u64; WORDS] {
        let v = &self.verdict;
        let own = [
            self.home,
            self.home_bytes,
            self.model,
            pair(v.header_crc, v.file_bytes),
            pair(v.scratch_offset, v.scratch_bytes),
            v.macs,
            pair(v.sum_count, self.busy),
            pair(self.repairs_untold, self.last_fault),
            self.calls,
            self.faults,
            self.repairs,
            0,
        ];
        let mut words = [0; WORDS];
        let all = own.iter().chain(&self.settings).chain(&self.paused);
        words.iter_mut().zip(all).for_each(|(word, value)| *word = *value);
        words
    }

    fn of(words: &[u64; WORDS]) -> Self {
        let word = |index: usize| words.get(index).copied().unwrap_or_default();
        let (low, high) = (|index: usize| word(index) as u32, |index: usize| (word(index) >> 32) as u32);
        let verdict = Verdict {
            header_crc: low(3),
            file_bytes: high(3),
            scratch_offset: low(4),
            scratch_bytes: high(4),
            macs: word(5),
            sum_count: low(6),
        };
        Self {
            home: word(0),
            home_bytes: word(1),
            model: word(2),
            verdict,
            busy: high(6),
            repairs_untold: low(7),
            last_fault: high(7),
            calls: word(8),
            faults: word(9),
            repairs: word(10),
            settings: core::array::from_fn(|i| word(OWN + i)),
            paused: core::array::from_fn(|i| word(OWN + StripSettings::WORDS + i)),
        }
    }

    /// Writes both copies.
    pub(crate) fn write(&self, head: &mut StripHead) {
        write_words(head, STRIP, &self.words());
    }

    /// Reads the record of a strip at address `home`.
    ///
    /// # Errors
    /// The status with which the call ends.
    pub(crate) fn open(head: &mut StripHead, home: usize) -> Result<Self, eld_status_t> {
        let mut words = [0; WORDS];
        let damaged = read_words(head, STRIP, &mut words).ok_or(ELD_FAULT_CONTEXT_LOST)?;
        let mut record = Self::of(&words);
        if record.home != home as u64 {
            return Err(ELD_FAULT_CONTEXT_MOVED);
        }
        record.calls = record.calls.wrapping_add(1);
        record.repairs = record.repairs.wrapping_add(u64::from(damaged));
        record.repairs_untold = record.repairs_untold.saturating_add(u32::from(damaged));
        if record.busy != 0 { Err(record.close(head, Err(ELD_FAULT_INTERRUPTED))) } else { Ok(record) }
    }

    /// Ends a call: updates the counters, writes both copies, and returns the status.
    pub(crate) fn close(mut self, head: &mut StripHead, outcome: Outcome) -> eld_status_t {
        let status = match outcome {
            Ok(status) | Err(status) => status,
        };
        self.busy = 0;
        if severity(status) == FAULT {
            self.faults = self.faults.wrapping_add(1);
            self.last_fault = status;
        }
        let tells = status == ELD_OK && self.repairs_untold > 0;
        if tells {
            self.repairs_untold = 0;
        }
        self.write(head);
        if tells { ELD_NOTICE_REPAIRED } else { status }
    }

    /// Returns the model; an error if it is not the one that was validated.
    pub(crate) fn open_model<'m>(&self, bytes: &'m [u8]) -> Result<Model<'m>, eld_status_t> {
        Model::reopen(bytes, &self.verdict).map_err(|_| ELD_FAULT_MODEL_CHANGED)
    }
}
