//! Two slots for a model, so that a new one can be loaded in flight. The new model is written beside the one that runs, validated, tried,
//! and only then confirmed. After a loss of power at any moment there is a model that runs.
//!
//! ```text
//!             begin_upload, write ...            start_trial              boot
//! confirmed A ------------------> B being written ---------> B to be tried ---> B on trial -- confirm --> confirmed B
//!      ^                                                                          |
//!      +------------- reject, or a reset too many: rolled back -------------------+
//! ```
//!
//! One [`SlotRecord`] is kept without power. It is stored twice, each copy under a checksum and in a sector of its own. A change writes the
//! older copy first and then the other, so that at any moment at least one copy is intact; the newer intact one is valid. The progress of
//! an upload needs no record, because a model file contains checksums of its chunks. No call writes to a byte of the confirmed model.
//!
//! [`SlotWork`] decides, [`Slots`] does it on a storage that is read in place. Slots do not run models. A model is borrowed from the storage as long as a [`Runner`] uses it. For an upload in the meantime, suspend
//! the runner between two calls ([`Runner::suspend`]), or let it read the storage through another mapping.
//!
//! `onboard/docs/model-update.md` describes the layout, the sequences and the effect of a cut at each point.

mod boot;
mod error;
mod passed;
mod put;
mod record;
mod storage;
mod upload;
mod work;

pub use error::SlotError;
pub use passed::SelfTestPassed;
pub use record::{RECORD_BYTES, SlotEntry, SlotRecord, Trial};
pub use storage::{Region, Slot, Storage, StorageError};
pub use work::{Answer, Given, SlotPlaces, SlotWork, Want};

#[cfg(doc)]
use super::Runner;
use super::Verdict;
use super::file::{HEADER_BYTES, word};
use super::model::Model;
use crate::part::part;
use crate::words::Words;

/// Largest number of boots of a trial.
pub const MAX_TRIAL_BOOTS: u32 = 16;

/// Identity of a model file: its length and the checksum of its header. The header contains the checksum of the list of checksums, and the
/// list those of all other bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ModelId {
    /// Length of the file, bytes.
    pub file_bytes: u32,
    /// Last word of the header ([`word::HEADER_CRC`]).
    pub header_crc: u32,
}

impl ModelId {
    /// Reads the identity of a file from its first [`HEADER_BYTES`] bytes; validates nothing.
    #[must_use]
    pub fn of(file: &[u8]) -> Self {
        let word = |index: usize| super::file::u32_at(file, 4 * index);
        Self { file_bytes: word(word::FILE_BYTES), header_crc: word(word::HEADER_CRC) }
    }

    pub(super) fn visit(&mut self, words: &mut Words<'_>) {
        words.u32(&mut self.file_bytes);
        words.u32(&mut self.header_crc);
    }

    /// Returns an error if `found` is another model.
    fn same(self, found: Self) -> Result<(), SlotError> {
        let (expected, found) = (self.header_crc, found.header_crc);
        if expected == found { Ok(()) } else { Err(SlotError::OtherModel { expected, found }) }
    }
}

/// The status of the model that runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standing {
    /// It has passed its self test, and the record says so.
    Confirmed,
    /// It is on trial: run its self test, then confirm it; reject it if the test fails. A reset counts as a failure when no boots are left.
    Trial,
    /// It was found without a valid record: before the first confirmation, or because records or the confirmed model were damaged. It is to
    /// be treated as on trial, but a reset leads to this status again.
    Salvaged,
}

/// A model to run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Boot {
    /// The slot of the model.
    pub slot: Slot,
    /// The status of the model.
    pub standing: Standing,
    /// The result of its validation.
    pub verdict: Verdict,
}

impl Boot {
    /// Returns the identity of the model.
    #[must_use]
    pub fn id(&self) -> ModelId {
        ModelId { file_bytes: self.verdict.file_bytes, header_crc: self.verdict.header_crc }
    }

    fn visit(&mut self, words: &mut Words<'_>) {
        words.choice(&mut self.slot, &[Slot::A, Slot::B]);
        words.choice(&mut self.standing, &[Standing::Confirmed, Standing::Trial, Standing::Salvaged]);
        self.verdict.visit(words);
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    New,
    Runs(Boot),
    NothingRuns,
}

/// Two model slots in a [`Storage`].
///
/// ```
/// # use elunar_core::nn::slots::{ModelId, SelfTestPassed, SlotError, Slots, Standing, Storage};
/// # use elunar_core::nn::{Progress, RunError, Runner};
/// /// After every reset: a model that is confirmed, or has just passed its self test.
/// fn start(slots: &mut Slots<impl Storage>, arena: &mut [u8]) -> Result<(), SlotError> {
///     let mut boot = slots.boot()?;
///     while boot.standing != Standing::Confirmed {
///         let test = |arena| {
///             let mut runner = Runner::new(slots.model().map_err(|_| RunError::State)?, arena)?;
///             runner.begin_self_test()?;
///             while runner.step(5_000_000)? == Progress::Running {} // kick the watchdog
///             SelfTestPassed::of(&mut runner)
///         };
///         match test(&mut *arena) {
///             Ok(passed) => return slots.confirm(passed),
///             Err(_) => boot = slots.reject()?,
///         }
///     }
///     Ok(())
/// }
///
/// /// Between two tiles, as chunks come from the ground; after a reset, again from the start: it goes on where it was.
/// fn update(slots: &mut Slots<impl Storage>, file: &[u8]) -> Result<(), SlotError> {
///     let mut there = slots.begin_upload(ModelId::of(file))?;
///     while there < file.len() {
///         let end = (there + 1024).min(file.len());
///         there = slots.write(there, &file[there..end])?;
///     }
///     slots.start_trial(1) // from the next boot
/// }
/// ```
#[derive(Debug)]
pub struct Slots<S> {
    storage: S,
    work: SlotWork,
}

impl<S: Storage> Slots<S> {
    /// Takes the storage; reads nothing.
    pub fn new(storage: S) -> Self {
        let bytes = Region::ALL.map(|region| storage.bytes(region).len());
        let sector_bytes = Region::ALL.map(|region| storage.sector_bytes(region));
        Self { storage, work: SlotWork::new(SlotPlaces { bytes, sector_bytes }) }
    }

    /// Returns the storage.
    pub fn storage(&self) -> &S {
        &self.storage
    }

    /// Returns the copies of the record.
    fn copies(&self) -> [Option<SlotRecord>; 2] {
        [Region::Record, Region::RecordCopy].map(|copy| SlotRecord::decode(self.storage.bytes(copy)))
    }

    /// Returns the record; `None` if neither copy is intact.
    pub fn record(&self) -> Option<SlotRecord> {
        SlotRecord::newest(self.copies())
    }

    /// Number of copies of the record that are intact and equal, for housekeeping: 2, unless the storage is worn or damaged.
    pub fn record_copies(&self) -> usize {
        let record = self.record();
        self.copies().iter().filter(|copy| copy.is_some() && **copy == record).count()
    }

    /// Does the work that was begun; `chunk` is what is written.
    fn drive(&mut self, chunk: &[u8]) -> Result<Answer, SlotError> {
        loop {
            let given = match self.work.want() {
                Want::Read { region, offset_bytes, len } => {
                    Given::Bytes(part(self.storage.bytes(region), offset_bytes, len))
                }
                Want::Erase { region, offset_bytes } => Given::Done(self.storage.erase(region, offset_bytes)),
                Want::WriteRecord { region, bytes } => Given::Done(self.storage.write(region, 0, &bytes)),
                Want::WriteChunk { slot, offset_bytes, .. } => {
                    Given::Done(self.storage.write(Region::Model(slot), offset_bytes, chunk))
                }
                Want::Nothing => return Err(SlotError::NotBooted),
            };
            if let Some(answer) = self.work.give(given, u64::MAX) {
                return answer;
            }
        }
    }
}
