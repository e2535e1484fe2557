//! Upload of a model, chunk by chunk, into the free slot.

use super::boot::Task;
use super::put::Put;
use super::work::{Answer, Step, What};
use super::*;
use crate::nn::file::{RawModel, crc32c};

/// An upload in progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Upload {
    pub(super) id: ModelId,
    pub(super) slot: Slot,
    /// Bytes written so far.
    pub(super) there: usize,
}

impl Upload {
    pub(super) fn visit(&mut self, words: &mut Words<'_>) {
        self.id.visit(words);
        words.choice(&mut self.slot, &[Slot::A, Slot::B]);
        words.usize(&mut self.there);
    }
}

impl SlotWork {
    /// Begins the upload of a model; see [`Slots::begin_upload`].
    ///
    /// # Errors
    /// [`SlotError::NotBooted`].
    pub fn begin_upload(&mut self, id: ModelId) -> Result<(), SlotError> {
        self.upload = None;
        if self.state == State::New {
            return Err(SlotError::NotBooted);
        }
        self.begin(Task::Upload(id));
        Ok(())
    }

    /// Begins to write a chunk of the file; see [`Slots::write`]. The same bytes are written when [`Want::WriteChunk`] says so.
    ///
    /// # Errors
    /// [`SlotError::NoUpload`], [`SlotError::Offset`], [`SlotError::Length`].
    pub fn write(&mut self, offset_bytes: usize, bytes: &[u8]) -> Result<(), SlotError> {
        let Upload { id, slot, there } = self.upload.ok_or(SlotError::NoUpload)?;
        if offset_bytes != there {
            return Err(SlotError::Offset { expected: there, found: offset_bytes });
        }
        let (expected, found) = (id.file_bytes as usize, there.saturating_add(bytes.len()));
        if found > expected {
            return Err(SlotError::Length { expected, found });
        }
        // Given up, unless it succeeds.
        (self.upload, self.entry) = (None, SlotEntry { slot, id });
        self.put = Put::new(&self.places, Region::Model(slot), offset_bytes, bytes.len());
        self.begin(Task::Write { crc: crc32c(bytes) });
        Ok(())
    }

    /// Begins to put the upload on trial; see [`Slots::start_trial`].
    ///
    /// # Errors
    /// [`SlotError::NoUpload`], [`SlotError::TrialBoots`], [`SlotError::Length`].
    pub fn start_trial(&mut self, boots: u32) -> Result<(), SlotError> {
        let Upload { id, slot, there } = self.upload.ok_or(SlotError::NoUpload)?;
        if !(1..=MAX_TRIAL_BOOTS).contains(&boots) {
            return Err(SlotError::TrialBoots { found: boots });
        }
        if there != id.file_bytes as usize {
            return Err(SlotError::Length { expected: id.file_bytes as usize, found: there });
        }
        self.entry = SlotEntry { slot, id };
        self.begin(Task::Trial { boots });
        Ok(())
    }

    /// Returns the slot that holds neither the running nor the confirmed model.
    fn free_slot(&self) -> Result<Slot, SlotError> {
        let record = self.record().0;
        if record.is_some_and(|record| record.trial.is_some()) {
            return Err(SlotError::Unconfirmed);
        }
        match self.state {
            State::New => Err(SlotError::NotBooted),
            State::Runs(Boot { slot, standing: Standing::Confirmed, .. }) => Ok(slot.other()),
            State::Runs(_) => Err(SlotError::Unconfirmed),
            // Neither slot runs. The confirmed model is kept, because a later read of it may succeed.
            State::NothingRuns => {
                Ok(record.and_then(|record| record.confirmed).map_or(Slot::A, |entry| entry.slot.other()))
            }
        }
    }

    /// Looks how much of an upload is there.
    pub(super) fn upload_to(&mut self, id: ModelId) -> Step {
        let slot = match self.free_slot() {
            Ok(slot) => slot,
            Err(error) => return Some(Err(error)),
        };
        let slot_bytes = self.places.bytes(Region::Model(slot));
        if !(HEADER_BYTES..=slot_bytes).contains(&(id.file_bytes as usize)) {
            return Some(Err(SlotError::FileBytes { slot: slot_bytes, found: id.file_bytes }));
        }
        (self.entry, self.what) = (SlotEntry { slot, id }, What::UploadHead);
        None
    }

    /// Goes on when the header of the free slot has been read.
    pub(super) fn found_head(&mut self, bytes: &[u8]) -> Step {
        let SlotEntry { id, .. } = self.entry;
        if RawModel::of_file(bytes, u64::from(id.file_bytes)).is_err() || ModelId::of(bytes) != id {
            return self.found(0);
        }
        (self.chunk, self.what) = (0, What::Count);
        None
    }

    /// Begins the upload behind so many bytes that are intact, by their checksums.
    pub(super) fn found(&mut self, whole: usize) -> Step {
        let SlotEntry { slot, id } = self.entry;
        let sector = self.places.sector_bytes(Region::Model(slot));
        let there = if whole == id.file_bytes as usize { whole } else { whole - whole % sector };
        self.upload = Some(Upload { id, slot, there });
        Some(Ok(Answer::Written(there)))
    }

    /// Writes the chunk, if its slot is still the free one.
    pub(super) fn write_to(&mut self) -> Step {
        match self.free_slot() {
            Ok(slot) if slot == self.entry.slot => {
                self.what = What::Chunk;
                None
            }
            Ok(_) => Some(Err(SlotError::NoUpload)),
            Err(error) => Some(Err(error)),
        }
    }

    /// Goes on when a chunk was written.
    pub(super) fn wrote(&mut self) -> Step {
        let Put { offset_bytes, len, .. } = self.put;
        if offset_bytes < HEADER_BYTES && offset_bytes.saturating_add(len) >= HEADER_BYTES {
            self.what = What::ChunkHead;
            return None;
        }
        self.count_chunk()
    }

    /// Goes on when the header of the upload is there.
    pub(super) fn wrote_head(&mut self, bytes: &[u8]) -> Step {
        let id = self.entry.id;
        if let Err(error) = RawModel::of_file(bytes, u64::from(id.file_bytes)) {
            return Some(Err(error.into()));
        }
        match id.same(ModelId::of(bytes)) {
            Ok(()) => self.count_chunk(),
            Err(error) => Some(Err(error)),
        }
    }

    fn count_chunk(&mut self) -> Step {
        let (SlotEntry { slot, id }, Put { offset_bytes, len, .. }) = (self.entry, self.put);
        let there = offset_bytes.saturating_add(len);
        self.upload = Some(Upload { id, slot, there });
        Some(Ok(Answer::Written(there)))
    }
}

impl<S: Storage> Slots<S> {
    /// Begins the upload of a model, or continues it after a reset or an error. Returns how many of its bytes are written already, which is
    /// the next chunk's offset. Writes nothing, and takes time proportional to the bytes written.
    ///
    /// This number comes from the checksums of chunks in the model file, rounded down to the start of a sector, because the rest of a
    /// written sector must be erased. If the whole model is still in the slot from before, all its bytes count as written.
    ///
    /// # Errors
    /// [`SlotError::NotBooted`]; [`SlotError::Unconfirmed`] while a model is on trial; [`SlotError::FileBytes`].
    pub fn begin_upload(&mut self, id: ModelId) -> Result<usize, SlotError> {
        self.work.begin_upload(id)?;
        self.written(&[])
    }

    /// Writes the chunk of the file that begins at `offset_bytes`, and returns how many bytes are written now. Erases the sectors that the
    /// chunk enters; with chunks no longer than a sector, this is at most one. If the device requires an alignment, the lengths of chunks
    /// should be multiples of it.
    ///
    /// # Errors
    /// [`SlotError::NoUpload`]; [`SlotError::Offset`] and [`SlotError::Length`], after which nothing has changed. The upload is given up
    /// and must be begun again after [`SlotError::Storage`] and [`SlotError::NotWritten`]. The same holds, once the header is complete, if
    /// it belongs to another model ([`SlotError::OtherModel`]) or to no model that this runner accepts ([`SlotError::Model`]).
    pub fn write(&mut self, offset_bytes: usize, bytes: &[u8]) -> Result<usize, SlotError> {
        self.work.write(offset_bytes, bytes)?;
        self.written(bytes)
    }

    /// Validates every byte of the upload and puts it on trial: the next `boots` boots run it, unless it is confirmed or rejected before.
    /// Takes time proportional to the file.
    ///
    /// One boot is the safe choice. More boots tolerate resets that have other reasons than the model.
    ///
    /// # Errors
    /// [`SlotError::NoUpload`], [`SlotError::TrialBoots`]; [`SlotError::Length`] if bytes are missing; [`SlotError::Model`] or
    /// [`SlotError::OtherModel`] if the model is refused; [`SlotError::Storage`], [`SlotError::NotWritten`]. There is no trial then.
    pub fn start_trial(&mut self, boots: u32) -> Result<(), SlotError> {
        self.work.start_trial(boots)?;
        self.drive(&[]).map(|_| ())
    }

    /// Does the work, and returns how many bytes are written.
    fn written(&mut self, chunk: &[u8]) -> Result<usize, SlotError> {
        self.drive(chunk)?;
        self.work.uploaded().ok_or(SlotError::NoUpload)
    }
}
