//! Upload of a model, chunk by chunk, into the free slot.

use super::*;
use crate::nn::file::{CHUNK_BYTES, crc32c};

/// An upload in progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Upload {
    id: ModelId,
    slot: Slot,
    /// Bytes written so far.
    there: usize,
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
        self.upload = None;
        let slot = self.free_slot()?;
        let slot_bytes = self.storage.bytes(Region::Model(slot)).len();
        if !(HEADER_BYTES..=slot_bytes).contains(&(id.file_bytes as usize)) {
            return Err(SlotError::FileBytes { slot: slot_bytes, found: id.file_bytes });
        }
        let whole = whole_bytes(self.file(slot, id.file_bytes), id);
        let sector = self.storage.sector_bytes(Region::Model(slot)).max(1);
        let there = if whole == id.file_bytes as usize { whole } else { whole - whole % sector };
        self.upload = Some(Upload { id, slot, there });
        Ok(there)
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
        let upload = self.upload.ok_or(SlotError::NoUpload)?;
        let Upload { id, slot, there } = upload;
        if offset_bytes != there {
            return Err(SlotError::Offset { expected: there, found: offset_bytes });
        }
        let (expected, found) = (id.file_bytes as usize, there.saturating_add(bytes.len()));
        if found > expected {
            return Err(SlotError::Length { expected, found });
        }
        self.upload = None;
        if self.free_slot()? != slot {
            return Err(SlotError::NoUpload);
        }
        self.put(Region::Model(slot), offset_bytes, bytes)?;
        if there < HEADER_BYTES && found >= HEADER_BYTES {
            let file = self.file(slot, id.file_bytes);
            RawModel::new(file)?;
            id.same(ModelId::of(file))?;
        }
        self.upload = Some(Upload { there: found, ..upload });
        Ok(found)
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
        let Upload { id, slot, there } = self.upload.ok_or(SlotError::NoUpload)?;
        if !(1..=MAX_TRIAL_BOOTS).contains(&boots) {
            return Err(SlotError::TrialBoots { found: boots });
        }
        if there != id.file_bytes as usize {
            return Err(SlotError::Length { expected: id.file_bytes as usize, found: there });
        }
        let entry = SlotEntry { slot, id };
        self.validate(entry)?;
        let trial = Some(Trial { entry, boots_left: boots });
        self.store(SlotRecord { trial, ..self.record().unwrap_or_default() })?;
        self.upload = None;
        Ok(())
    }

    /// Returns the slot that holds neither the running nor the confirmed model.
    fn free_slot(&self) -> Result<Slot, SlotError> {
        let record = self.record();
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
}

/// Returns how many bytes of a model are intact at the start of its slot, by their checksums.
fn whole_bytes(file: &[u8], id: ModelId) -> usize {
    let Ok(raw) = RawModel::new(file) else { return 0 };
    if ModelId::of(file) != id || !raw.head_holds() {
        return 0;
    }
    let broken = (0..raw.chunks()).find(|&chunk| crc32c(raw.chunk(chunk)) != raw.chunk_crc(chunk));
    broken.map_or(file.len(), |chunk| raw.body_offset() + CHUNK_BYTES * chunk as usize)
}
