//! Model slots: the core's work on them between two calls, as words that are kept twice, and what it wants of the caller.

pub mod types;

use crate::check;
use crate::context::Outcome;
use crate::info::model_status;
use crate::sealed::{Sealed, block_bytes};
use crate::status::*;
use crate::types::{eld_check_t, eld_status_t};
use elunar_core::nn::slots::{
    Answer, Given, ModelId, RECORD_BYTES, Region, Slot, SlotError, SlotPlaces, SlotWork, Standing, StorageError, Want,
};
use types::*;

/// Number of words before those of the work.
const OWN: usize = 7;
const WORDS: usize = OWN + SlotWork::WORDS;
/// "ELDSLT" and the version of the words.
const SEALED: Sealed<WORDS> = Sealed { magic: u64::from_le_bytes(*b"ELDSLT\x00\x01") };
/// Bytes of both copies of the words.
pub(crate) const STATE_BYTES: usize = block_bytes(WORDS);
/// The words, and a record that is to be written.
const _: () = assert!(STATE_BYTES + RECORD_BYTES == ELD_SLOTS_BYTES as usize);

/// The state of the slots.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SlotsRecord {
    /// Address of the lent memory.
    home: u64,
    /// Address of the chunk that is written.
    pub(crate) chunk: u64,
    repairs_untold: u32,
    last_fault: u32,
    calls: u64,
    faults: u64,
    repairs: u64,
    /// 1 if the caller was told what is wanted.
    told: u64,
    pub(crate) work: SlotWork,
}

impl SlotsRecord {
    /// Writes a new state.
    pub(crate) fn make(block: &mut [u8], home: usize, places: SlotPlaces) {
        let new = Self {
            home: home as u64,
            chunk: 0,
            repairs_untold: 0,
            last_fault: 0,
            calls: 0,
            faults: 0,
            repairs: 0,
            told: 0,
            work: SlotWork::new(places),
        };
        new.write(block);
    }

    fn write(&self, block: &mut [u8]) {
        let faults = u64::from(self.repairs_untold) | u64::from(self.last_fault) << 32;
        let own = [self.home, self.chunk, faults, self.calls, self.faults, self.repairs, self.told];
        let mut words = [0; WORDS];
        words.iter_mut().zip(own.into_iter().chain(self.work.to_words())).for_each(|(to, word)| *to = word);
        SEALED.write(block, &words);
    }

    /// Reads the state at address `home`.
    ///
    /// # Errors
    /// The status with which the call ends.
    pub(crate) fn open(block: &[u8], home: usize) -> Result<Self, eld_status_t> {
        let (words, damaged) = SEALED.read(block).ok_or(ELD_FAULT_CONTEXT_LOST)?;
        let (Some(own), Some(work)) = (words.first_chunk::<OWN>(), words.last_chunk()) else {
            return Err(ELD_FAULT_CONTEXT_LOST);
        };
        let [at, chunk, faults_word, calls, faults, repairs, told] = *own;
        let work = SlotWork::from_words(*work).ok_or(ELD_FAULT_CONTEXT_LOST)?;
        if at != home as u64 {
            return Err(ELD_FAULT_CONTEXT_MOVED);
        }
        Ok(Self {
            home: at,
            chunk,
            repairs_untold: (faults_word as u32).saturating_add(u32::from(damaged)),
            last_fault: (faults_word >> 32) as u32,
            calls: calls.wrapping_add(1),
            faults,
            repairs: repairs.wrapping_add(u64::from(damaged)),
            told,
            work,
        })
    }

    /// Ends a call: updates the counters, writes both copies, and returns the status.
    pub(crate) fn close(mut self, block: &mut [u8], outcome: Outcome) -> eld_status_t {
        let status = match outcome {
            Ok(status) | Err(status) => status,
        };
        if severity(status) == FAULT {
            self.faults = self.faults.wrapping_add(1);
            self.last_fault = status;
        }
        let tells = status == ELD_OK && self.repairs_untold > 0;
        if tells {
            self.repairs_untold = 0;
        }
        self.write(block);
        if tells { ELD_NOTICE_REPAIRED } else { status }
    }

    /// Begins work, unless other work is not finished.
    pub(crate) fn begin(&mut self, begin: impl FnOnce(&mut SlotWork) -> Result<(), SlotError>) -> Outcome {
        if self.work.is_at_work() {
            return Err(ELD_REFUSED_SLOTS_BUSY);
        }
        begin(&mut self.work).map_err(|error| slot_status(error, &[]))?;
        self.told = 0;
        Ok(ELD_RUNNING)
    }

    /// Gives up what is at work, and begins a boot.
    pub(crate) fn boot(&mut self) -> Outcome {
        self.work.boot();
        self.told = 0;
        Ok(ELD_RUNNING)
    }

    /// Returns how many bytes the caller was asked for; `None` if for none.
    pub(crate) fn asked(&self) -> Option<usize> {
        match self.work.want() {
            Want::Read { len, .. } if self.told != 0 => Some(len),
            _ => None,
        }
    }

    /// Goes on with what the caller has read or done; returns what is wanted next, and whether these are the bytes of this call.
    pub(crate) fn step(
        &mut self,
        bytes: &[u8],
        storage_error: u32,
        budget_macs: u64,
    ) -> Result<(Want, bool), eld_status_t> {
        if !self.work.is_at_work() {
            return Err(ELD_REFUSED_SLOTS_IDLE);
        }
        let before = self.work.want();
        let mut given = match (storage_error, self.asked()) {
            (0, Some(_)) => Given::Bytes(bytes),
            (0, None) => Given::Done(Ok(())),
            (code, _) => Given::Done(Err(StorageError { code })),
        };
        let mut has_given = self.told != 0;
        loop {
            if has_given && let Some(answer) = self.work.give(given, budget_macs) {
                self.told = 0;
                return Err(answer.map_or_else(|error| slot_status(error, bytes), answer_status));
            }
            let want = self.work.want();
            if !matches!(want, Want::Read { len: 0, .. }) {
                self.told = 1;
                return Ok((want, has_given && want == before));
            }
            // No bytes are there without the caller.
            (given, has_given) = (Given::Bytes(&[]), true);
        }
    }

    /// Returns what is known.
    pub(crate) fn state(&self, struct_bytes: u32) -> eld_slots_state_t {
        let (running, (record, copies)) = (self.work.running(), self.work.record());
        let standing = match running {
            Err(SlotError::NothingRuns) => ELD_STANDING_NOTHING,
            Err(_) => ELD_STANDING_UNKNOWN,
            Ok(boot) => match boot.standing {
                Standing::Confirmed => ELD_STANDING_CONFIRMED,
                Standing::Trial => ELD_STANDING_TRIAL,
                Standing::Salvaged => ELD_STANDING_SALVAGED,
            },
        };
        let id = running.map_or(ModelId { file_bytes: 0, header_crc: 0 }, |boot| boot.id());
        let mut kept = eld_check_t::default();
        if let (false, Some(validation)) = (self.work.is_at_work(), self.work.validation()) {
            kept = check::of(&validation, id);
        }
        eld_slots_state_t {
            struct_bytes,
            standing,
            slot: running.map_or(ELD_REGION_SLOT_A, |boot| region_number(Region::Model(boot.slot))),
            file_bytes: id.file_bytes,
            header_crc: id.header_crc,
            boots_left: record.and_then(|record| record.trial).map_or(0, |trial| trial.boots_left),
            rollbacks: record.map_or(0, |record| record.rollbacks),
            record_copies: copies as u32,
            uploading: self.work.uploaded().is_some().into(),
            last_fault: self.last_fault,
            uploaded_bytes: self.work.uploaded().unwrap_or(0) as u64,
            calls: self.calls,
            faults: self.faults,
            context_repairs: self.repairs,
            check: kept,
        }
    }
}

/// Returns the lengths of the regions.
///
/// # Errors
/// [`ELD_REFUSED_SLOTS_STORAGE`].
pub(crate) fn places(c: &eld_slots_storage_t) -> Result<SlotPlaces, eld_status_t> {
    let eld_slots_storage_t { slot_sector_bytes, record_bytes, record_sector_bytes, slot_bytes, .. } = *c;
    let slot = usize::try_from(slot_bytes).ok().filter(|bytes| *bytes <= isize::MAX as usize);
    let slot = slot.ok_or(ELD_REFUSED_SLOTS_STORAGE)?;
    let [slot_sector, record, sector] = [slot_sector_bytes, record_bytes, record_sector_bytes].map(|v| v as usize);
    if slot_sector == 0 || sector == 0 || record < RECORD_BYTES || slot == 0 || !slot.is_multiple_of(slot_sector) {
        return Err(ELD_REFUSED_SLOTS_STORAGE);
    }
    Ok(SlotPlaces { bytes: [slot, slot, record, record], sector_bytes: [slot_sector, slot_sector, sector, sector] })
}

/// Returns the number of a region.
pub(crate) fn region_number(region: Region) -> u32 {
    match region {
        Region::Model(Slot::A) => ELD_REGION_SLOT_A,
        Region::Model(Slot::B) => ELD_REGION_SLOT_B,
        Region::Record => ELD_REGION_RECORD,
        Region::RecordCopy => ELD_REGION_RECORD_COPY,
    }
}

fn answer_status(answer: Answer) -> eld_status_t {
    match answer {
        Answer::Runs(boot) => match boot.standing {
            Standing::Confirmed => ELD_OK,
            Standing::Trial => ELD_NOTICE_SLOTS_TRIAL,
            Standing::Salvaged => ELD_NOTICE_SLOTS_SALVAGED,
        },
        Answer::Written(_) | Answer::Done => ELD_OK,
    }
}

/// Returns the status of an error; `bytes` are those that were read.
fn slot_status(error: SlotError, bytes: &[u8]) -> eld_status_t {
    match error {
        SlotError::NothingRuns => ELD_REFUSED_SLOTS_NOTHING_RUNS,
        SlotError::NotBooted => ELD_REFUSED_SLOTS_NOT_BOOTED,
        SlotError::Unconfirmed => ELD_REFUSED_SLOTS_UNCONFIRMED,
        SlotError::Confirmed => ELD_REFUSED_SLOTS_CONFIRMED,
        SlotError::NoUpload => ELD_REFUSED_SLOTS_NO_UPLOAD,
        SlotError::FileBytes { .. } | SlotError::Length { .. } => ELD_REFUSED_SLOTS_LENGTH,
        SlotError::Offset { .. } => ELD_REFUSED_SLOTS_OFFSET,
        SlotError::OtherModel { .. } => ELD_REFUSED_SLOTS_OTHER_MODEL,
        SlotError::Model(error) => model_status(error, bytes),
        SlotError::TrialBoots { .. } => ELD_REFUSED_SLOTS_BOOTS,
        SlotError::Storage(_) => ELD_FAULT_SLOTS_STORAGE,
        SlotError::NotWritten { .. } => ELD_FAULT_SLOTS_NOT_WRITTEN,
    }
}
