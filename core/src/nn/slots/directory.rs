//! The record in its two copies, and all writing to the storage.

use super::*;
use crate::part::part;

/// The record and its copy.
const COPIES: [Region; 2] = [Region::Record, Region::RecordCopy];

impl<S: Storage> Slots<S> {
    /// Returns the record; `None` if neither copy is intact.
    pub fn record(&self) -> Option<SlotRecord> {
        let [first, second] = COPIES.map(|copy| SlotRecord::decode(self.storage.bytes(copy)));
        match (first, second) {
            (Some(first), Some(second)) => Some(if second.sequence > first.sequence { second } else { first }),
            (first, second) => first.or(second),
        }
    }

    /// Number of copies of the record that are intact and equal, for housekeeping: 2, unless the storage is worn or damaged.
    pub fn record_copies(&self) -> usize {
        let record = self.record();
        let whole = |copy: &&Region| record.is_some() && SlotRecord::decode(self.storage.bytes(**copy)) == record;
        COPIES.iter().filter(whole).count()
    }

    /// Writes the next record: over the older copy, then over the other. It is valid as soon as the first copy is intact. If the second
    /// write fails, the next boot repairs the copy.
    pub(super) fn store(&mut self, record: SlotRecord) -> Result<(), SlotError> {
        let held = self.record();
        let sequence = held.map_or(0, |held| held.sequence).saturating_add(1);
        let bytes = SlotRecord { sequence, ..record }.encode();
        let [first, second] = match SlotRecord::decode(self.storage.bytes(COPIES[0])) {
            newest if newest.is_some() && newest == held => [COPIES[1], COPIES[0]],
            _ => COPIES,
        };
        self.put(first, 0, &bytes)?;
        let _ = self.put(second, 0, &bytes);
        Ok(())
    }

    /// Writes the copy of the record again that is not intact, or older. A failure is ignored, because the other copy is valid.
    pub(super) fn mend(&mut self) {
        let Some(record) = self.record() else { return };
        for copy in COPIES {
            if SlotRecord::decode(self.storage.bytes(copy)) != Some(record) {
                let _ = self.put(copy, 0, &record.encode());
            }
        }
    }

    /// Erases the sectors that begin within the written range, writes the bytes, and reads them back.
    pub(super) fn put(&mut self, region: Region, offset_bytes: usize, bytes: &[u8]) -> Result<(), SlotError> {
        let sector = self.storage.sector_bytes(region).max(1);
        let end = offset_bytes.saturating_add(bytes.len());
        let mut start = offset_bytes.checked_next_multiple_of(sector).unwrap_or(end);
        while start < end {
            self.storage.erase(region, start)?;
            start = start.saturating_add(sector);
        }
        self.storage.write(region, offset_bytes, bytes)?;
        let there = part(self.storage.bytes(region), offset_bytes, bytes.len()) == bytes;
        if there { Ok(()) } else { Err(SlotError::NotWritten { offset_bytes }) }
    }
}
