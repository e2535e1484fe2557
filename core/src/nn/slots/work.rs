//! The work on slots without a storage: it names what it wants next, and takes what a driver has done or read.

use super::boot::{Task, Why};
use super::put::{Phase, Put};
use super::upload::Upload;
use super::*;
use crate::nn::Validation;
use crate::nn::file::{CHUNK_BYTES, RawModel, crc32c};
use crate::nn::model::COMPARED;
use crate::words::Words;

/// Lengths of the regions, and of their sectors: slot A, slot B, the record, its copy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlotPlaces {
    /// Bytes of each region.
    pub bytes: [usize; 4],
    /// Bytes that are erased at once in each.
    pub sector_bytes: [usize; 4],
}

impl SlotPlaces {
    fn of(all: [usize; 4], region: Region) -> usize {
        let [a, b, record, copy] = all;
        match region {
            Region::Model(Slot::A) => a,
            Region::Model(Slot::B) => b,
            Region::Record => record,
            Region::RecordCopy => copy,
        }
    }

    pub(super) fn bytes(&self, region: Region) -> usize {
        Self::of(self.bytes, region)
    }

    pub(super) fn sector_bytes(&self, region: Region) -> usize {
        Self::of(self.sector_bytes, region).max(1)
    }
}

/// What the work wants of the storage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Want {
    /// Bytes of a region, perhaps none, as [`Given::Bytes`].
    Read {
        /// The region.
        region: Region,
        /// First byte.
        offset_bytes: usize,
        /// Number of bytes.
        len: usize,
    },
    /// That the sector that begins at this byte be erased, as [`Given::Done`].
    Erase {
        /// The region.
        region: Region,
        /// First byte of the sector.
        offset_bytes: usize,
    },
    /// That a record be written at the start of its region, as [`Given::Done`].
    WriteRecord {
        /// The region.
        region: Region,
        /// The record.
        bytes: [u8; RECORD_BYTES],
    },
    /// That the chunk of [`SlotWork::write`] be written, as [`Given::Done`].
    WriteChunk {
        /// The slot.
        slot: Slot,
        /// First byte.
        offset_bytes: usize,
        /// Number of bytes.
        len: usize,
    },
    /// Nothing: no work was begun.
    Nothing,
}

/// What a driver has read or done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Given<'b> {
    /// The bytes that were asked for.
    Bytes(&'b [u8]),
    /// The result of an erasure or a write; or that bytes cannot be read.
    Done(Result<(), StorageError>),
}

/// The result of work that is finished.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// The model to run.
    Runs(Boot),
    /// Bytes of an upload that are written: the next chunk's offset.
    Written(usize),
    /// Confirmed, or on trial from the next boot.
    Done,
}

/// What a call of [`SlotWork::give`] ends with: `None` while the work goes on.
pub(super) type Step = Option<Result<Answer, SlotError>>;

/// What the work stands at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum What {
    Nothing,
    /// Reading the copy of the record.
    Record,
    /// Repairing the copy.
    Mend,
    /// Storing a record in its first copy, and in the other.
    StoreFirst,
    StoreSecond,
    /// Reading the header of a slot, to know which model is there.
    Head,
    /// Validating a model.
    Check,
    /// Reading the header of the model that is uploaded, before and after.
    UploadHead,
    ChunkHead,
    /// Counting the chunks that are there.
    Count,
    /// Writing a chunk.
    Chunk,
}

impl What {
    const ALL: [Self; 11] = [
        Self::Nothing,
        Self::Record,
        Self::Mend,
        Self::StoreFirst,
        Self::StoreSecond,
        Self::Head,
        Self::Check,
        Self::UploadHead,
        Self::ChunkHead,
        Self::Count,
        Self::Chunk,
    ];
}

/// The work on slots: plain numbers. [`Slots`] does it on a [`Storage`] that is read in place.
///
/// ```
/// # use elunar_core::nn::slots::{Answer, Given, SlotError, SlotPlaces, SlotWork, StorageError, Want};
/// # fn driver(_: Want) -> Result<&'static [u8], StorageError> { Err(StorageError { code: 1 }) }
/// let mut work = SlotWork::new(SlotPlaces { bytes: [6_000_000, 6_000_000, 4096, 4096], sector_bytes: [4096; 4] });
/// work.boot();
/// let answer = loop {
///     let given = match (work.want(), driver(work.want())) {
///         (Want::Read { .. }, Ok(bytes)) => Given::Bytes(bytes),
///         (_, done) => Given::Done(done.map(|_| ())),
///     };
///     // About so many multiply-accumulates. If the same bytes are wanted again, they are not read again.
///     if let Some(answer) = work.give(given, 5_000_000) {
///         break answer;
///     }
/// };
/// assert_eq!(answer, Err(SlotError::NothingRuns));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlotWork {
    pub(super) places: SlotPlaces,
    pub(super) state: State,
    pub(super) upload: Option<Upload>,
    pub(super) task: Task,
    pub(super) what: What,
    /// Whether the copy of the record that is at work is the second one.
    pub(super) second: bool,
    /// What a validation or a stored record is for.
    pub(super) why: Why,
    pub(super) put: Put,
    /// Next chunk that is counted.
    pub(super) chunk: u32,
    pub(super) copies: [Option<SlotRecord>; 2],
    /// The record that is stored.
    pub(super) next: SlotRecord,
    /// The model that is read, and its validation.
    pub(super) entry: SlotEntry,
    pub(super) validation: Validation,
    pub(super) verdict: Verdict,
}

/// The regions of the record.
const COPIES: [Region; 2] = [Region::Record, Region::RecordCopy];

pub(super) fn copy_of(second: bool) -> Region {
    let [one, two] = COPIES;
    if second { two } else { one }
}

impl SlotWork {
    /// Number of words of the work.
    pub const WORDS: usize = 88;

    /// Returns the work as words.
    #[must_use]
    pub fn to_words(mut self) -> [u64; Self::WORDS] {
        let mut words = [0; Self::WORDS];
        self.visit(&mut Words::writing(&mut words));
        words
    }

    /// Returns the work of these words; `None` if they are not those of one.
    #[must_use]
    pub fn from_words(mut words: [u64; Self::WORDS]) -> Option<Self> {
        let (mut work, mut words) =
            (Self::new(SlotPlaces { bytes: [0; 4], sector_bytes: [0; 4] }), Words::reading(&mut words));
        work.visit(&mut words);
        words.is_legal().then_some(work)
    }

    /// Takes the lengths of the regions.
    #[must_use]
    pub fn new(places: SlotPlaces) -> Self {
        let id = ModelId { file_bytes: 0, header_crc: 0 };
        Self {
            places,
            state: State::New,
            upload: None,
            task: Task::Boot,
            what: What::Nothing,
            second: false,
            why: Why::Trial,
            put: Put::NONE,
            chunk: 0,
            copies: [None; 2],
            next: SlotRecord::default(),
            entry: SlotEntry { slot: Slot::A, id },
            validation: Validation::default(),
            verdict: Verdict::default(),
        }
    }

    /// Returns the model that runs.
    ///
    /// # Errors
    /// [`SlotError::NotBooted`], [`SlotError::NothingRuns`].
    pub fn running(&self) -> Result<Boot, SlotError> {
        match self.state {
            State::New => Err(SlotError::NotBooted),
            State::NothingRuns => Err(SlotError::NothingRuns),
            State::Runs(boot) => Ok(boot),
        }
    }

    /// Returns the finished validation of the model that runs, if none was validated since.
    #[must_use]
    pub fn validation(&self) -> Option<Validation> {
        let Ok(Boot { slot, verdict, .. }) = self.running() else { return None };
        let same = self.entry.slot == slot && self.verdict == verdict && self.validation.is_done();
        same.then_some(self.validation)
    }

    /// Returns the record as it was read or stored last, and the number of its copies that are intact and equal.
    #[must_use]
    pub fn record(&self) -> (Option<SlotRecord>, usize) {
        let record = SlotRecord::newest(self.copies);
        (record, self.copies.iter().filter(|copy| copy.is_some() && **copy == record).count())
    }

    /// Number of bytes of an upload that are written; `None` if there is no upload.
    #[must_use]
    pub fn uploaded(&self) -> Option<usize> {
        self.upload.map(|upload| upload.there)
    }

    /// Returns whether work was begun and is not finished.
    #[must_use]
    pub fn is_at_work(&self) -> bool {
        self.what != What::Nothing
    }

    /// Begins a task, with a look at the record.
    pub(super) fn begin(&mut self, task: Task) {
        (self.task, self.copies) = (task, [None; 2]);
        (self.what, self.second) = (What::Record, false);
    }

    /// Returns what is wanted next. It stays the same until it is given.
    #[must_use]
    pub fn want(&self) -> Want {
        let read = |region, len| Want::Read { region, offset_bytes: 0, len };
        let SlotEntry { slot, id } = self.entry;
        match (self.what, self.put.phase) {
            (What::Nothing, _) => Want::Nothing,
            (What::Record, _) => {
                let region = copy_of(self.second);
                // A region that is too short holds no record.
                read(region, if self.places.bytes(region) < RECORD_BYTES { 0 } else { RECORD_BYTES })
            }
            (What::Head | What::UploadHead | What::ChunkHead, _) => read(Region::Model(slot), HEADER_BYTES),
            (What::Check | What::Count, _) => read(Region::Model(slot), id.file_bytes as usize),
            (_, Phase::Erase) => Want::Erase { region: self.put.region, offset_bytes: self.put.sector },
            (What::Chunk, Phase::Write) => {
                Want::WriteChunk { slot, offset_bytes: self.put.offset_bytes, len: self.put.len }
            }
            (_, Phase::Write) => Want::WriteRecord { region: self.put.region, bytes: self.written().encode() },
            (_, Phase::Read) => {
                let Put { region, offset_bytes, len, .. } = self.put;
                Want::Read { region, offset_bytes, len }
            }
        }
    }

    /// Returns the record that is being written.
    fn written(&self) -> SlotRecord {
        if self.what == What::Mend { SlotRecord::newest(self.copies).unwrap_or_default() } else { self.next }
    }

    /// Takes what was read or done, and works on it for about `budget` multiply-accumulates; returns the result when all is done.
    ///
    /// # Errors
    /// Those of the task that was begun.
    pub fn give(&mut self, given: Given<'_>, budget: u64) -> Option<Result<Answer, SlotError>> {
        let step = self.take(given, budget.max(1));
        if step.is_some() {
            self.what = What::Nothing;
        }
        step
    }

    /// Writes or reads the work.
    fn visit(&mut self, words: &mut Words<'_>) {
        let SlotPlaces { bytes, sector_bytes } = &mut self.places;
        bytes.iter_mut().chain(sector_bytes).for_each(|v| words.usize(v));
        let (empty, none) = (ModelId { file_bytes: 0, header_crc: 0 }, Verdict::default());
        let (mut runs, mut nothing) = (self.running().ok(), self.state == State::NothingRuns);
        words.bool(&mut nothing);
        words.option(&mut runs, Boot { slot: Slot::A, standing: Standing::Trial, verdict: none }, Boot::visit);
        self.state = match (runs, nothing) {
            (Some(boot), _) => State::Runs(boot),
            (None, true) => State::NothingRuns,
            (None, false) => State::New,
        };
        words.option(&mut self.upload, Upload { id: empty, slot: Slot::A, there: 0 }, Upload::visit);
        self.task.visit(words);
        words.choice(&mut self.what, &What::ALL);
        words.bool(&mut self.second);
        words.choice(&mut self.why, &Why::ALL);
        self.put.visit(words);
        words.u32(&mut self.chunk);
        self.copies.iter_mut().for_each(|copy| words.option(copy, SlotRecord::default(), SlotRecord::visit));
        self.next.visit(words);
        self.entry.visit(words);
        self.validation.visit(words);
        self.verdict.visit(words);
    }

    fn take(&mut self, given: Given<'_>, budget: u64) -> Step {
        let bytes = match given {
            Given::Bytes(bytes) => bytes,
            Given::Done(_) => &[],
        };
        match self.what {
            What::Nothing => Some(Err(SlotError::NotBooted)),
            What::Record => {
                self.keep(self.second, SlotRecord::decode(bytes));
                if self.second {
                    return self.decide();
                }
                self.second = true;
                None
            }
            What::Mend | What::StoreFirst | What::StoreSecond => {
                let record = self.written();
                let done = self.put.go_on(&self.places, &given, |there| SlotRecord::decode(there) == Some(record))?;
                if done.is_ok() {
                    self.keep(self.second, Some(record));
                }
                match self.what {
                    What::Mend if self.second => self.boot_mended(),
                    What::Mend => self.mend(&[true]),
                    What::StoreFirst => match done {
                        Ok(()) => self.store_second(),
                        Err(error) => self.stored(Err(error)),
                    },
                    // If the second write fails, the next boot repairs the copy.
                    _ => self.stored(Ok(())),
                }
            }
            What::Head => {
                self.entry.id = ModelId::of(bytes);
                self.check(self.entry, Why::Salvage)
            }
            What::Check => self.validate(&given, budget),
            What::UploadHead => self.found_head(bytes),
            What::Count => self.count(bytes, budget),
            What::Chunk => {
                let Task::Write { crc, .. } = self.task else { return Some(Err(SlotError::NoUpload)) };
                let done = self.put.go_on(&self.places, &given, |there| crc32c(there) == crc)?;
                done.map_or_else(|error| Some(Err(error)), |()| self.wrote())
            }
            What::ChunkHead => self.wrote_head(bytes),
        }
    }

    fn keep(&mut self, second: bool, record: Option<SlotRecord>) {
        let [one, two] = &mut self.copies;
        *(if second { two } else { one }) = record;
    }

    /// Begins to validate a model.
    pub(super) fn check(&mut self, entry: SlotEntry, why: Why) -> Step {
        (self.entry, self.why, self.validation, self.what) = (entry, why, Validation::default(), What::Check);
        // A file that the slot cannot hold is not there.
        if entry.id.file_bytes as usize > self.places.bytes(Region::Model(entry.slot)) {
            self.entry.id.file_bytes = 0;
        }
        None
    }

    fn validate(&mut self, given: &Given<'_>, budget: u64) -> Step {
        let done = match given {
            Given::Done(Err(error)) => Err(SlotError::Storage(*error)),
            Given::Done(Ok(())) => return None,
            Given::Bytes(bytes) => self.entry.id.same(ModelId::of(bytes)).and_then(|()| {
                let model = self.validation.advance(bytes, budget)?;
                Ok(model.map(|model| model.verdict()))
            }),
        };
        match done {
            Ok(None) => None,
            Ok(Some(verdict)) => {
                self.verdict = verdict;
                self.checked(Ok(()))
            }
            Err(error) => self.checked(Err(error)),
        }
    }

    /// Counts the whole chunks of an upload.
    fn count(&mut self, bytes: &[u8], budget: u64) -> Step {
        let Ok(raw) = RawModel::new(bytes) else { return self.found(0) };
        if self.chunk == 0 && !raw.head_holds() {
            return self.found(0);
        }
        let mut cost = 0;
        while self.chunk < raw.chunks() {
            if cost >= budget {
                return None;
            }
            if crc32c(raw.chunk(self.chunk)) != raw.chunk_crc(self.chunk) {
                let before = (self.chunk as usize).saturating_mul(CHUNK_BYTES);
                return self.found(raw.body_offset().saturating_add(before));
            }
            (self.chunk, cost) = (self.chunk.saturating_add(1), cost + COMPARED * CHUNK_BYTES as u64);
        }
        self.found(bytes.len())
    }
}
