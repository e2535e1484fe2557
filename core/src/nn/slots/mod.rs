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
//! Slots do not run models. A model is borrowed from the storage as long as a [`Runner`] uses it. For an upload in the meantime, suspend
//! the runner between two calls ([`Runner::suspend`]), or let it read the storage through another mapping.
//!
//! `onboard/docs/model-update.md` describes the layout, the sequences and the effect of a cut at each point.

mod boot;
mod directory;
mod error;
mod passed;
mod record;
mod storage;
mod upload;

pub use error::SlotError;
pub use passed::SelfTestPassed;
pub use record::{RECORD_BYTES, SlotEntry, SlotRecord, Trial};
pub use storage::{Region, Slot, Storage, StorageError};

#[cfg(doc)]
use super::Runner;
use super::Verdict;
use super::file::{HEADER_BYTES, RawModel, word};
use super::model::Model;
use upload::Upload;

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
    state: State,
    upload: Option<Upload>,
}

impl<S: Storage> Slots<S> {
    /// Takes the storage; reads nothing.
    pub fn new(storage: S) -> Self {
        Self { storage, state: State::New, upload: None }
    }

    /// Returns the storage.
    pub fn storage(&self) -> &S {
        &self.storage
    }

    /// Returns the first bytes of a slot; an empty slice if the slot is shorter.
    fn file(&self, slot: Slot, file_bytes: u32) -> &[u8] {
        self.storage.bytes(Region::Model(slot)).get(..file_bytes as usize).unwrap_or_default()
    }

    /// Validates that a slot holds this model, and that the runner accepts it.
    fn validate(&self, SlotEntry { slot, id }: SlotEntry) -> Result<Model<'_>, SlotError> {
        let file = self.file(slot, id.file_bytes);
        id.same(ModelId::of(file))?;
        Ok(Model::new(file)?)
    }
}
