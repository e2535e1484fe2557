//! The data kept without power: which model is confirmed, and which one is on trial.
//!
//! ```text
//! word 0       1 2         3 4 5                       6 7 8                  9           10         11-13  14      15
//!      MAGIC | sequence | confirmed: slot, bytes, CRC | trial: as confirmed | boots left | rollbacks | 0    | CRC32C | its inverse
//! ```
//! Sixteen little-endian u32. A slot is 0 or 1, or `NONE`; with `NONE`, bytes and CRC are 0.

use super::{ModelId, Slot};
use crate::nn::file::{NONE, crc32c, u32_at};
use crate::part::part;
use crate::words::Words;

/// Bytes of a record.
pub const RECORD_BYTES: usize = 4 * WORDS;
const WORDS: usize = 16;
/// Number of words under the checksum.
const SEALED_WORDS: usize = 14;
/// "ELS" and the version of the record.
const MAGIC: u32 = u32::from_le_bytes(*b"ELS\x01");

/// A model in a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlotEntry {
    /// The slot of the model.
    pub slot: Slot,
    /// The identity of the model.
    pub id: ModelId,
}

/// A model that has yet to pass its self test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Trial {
    /// The model.
    pub entry: SlotEntry,
    /// Boots that may still run it.
    pub boots_left: u32,
}

/// The data kept without power.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SlotRecord {
    /// Number that grows by one with every change.
    pub sequence: u64,
    /// The model that passed its self test last; `None` before the first one.
    pub confirmed: Option<SlotEntry>,
    /// The model on trial, in the other slot.
    pub trial: Option<Trial>,
    /// Number of trials that ended without confirmation, since the first record.
    pub rollbacks: u32,
}

impl SlotEntry {
    pub(super) fn visit(&mut self, words: &mut Words<'_>) {
        words.choice(&mut self.slot, &[Slot::A, Slot::B]);
        self.id.visit(words);
    }
}

impl SlotRecord {
    pub(super) fn visit(&mut self, words: &mut Words<'_>) {
        let none = SlotEntry { slot: Slot::A, id: ModelId { file_bytes: 0, header_crc: 0 } };
        words.u64(&mut self.sequence);
        words.option(&mut self.confirmed, none, SlotEntry::visit);
        words.option(&mut self.trial, Trial { entry: none, boots_left: 0 }, |trial, words| {
            trial.entry.visit(words);
            words.u32(&mut trial.boots_left);
        });
        words.u32(&mut self.rollbacks);
    }

    /// Returns the newest record of both copies.
    pub(super) fn newest([first, second]: [Option<Self>; 2]) -> Option<Self> {
        match (first, second) {
            (Some(first), Some(second)) => Some(if second.sequence > first.sequence { second } else { first }),
            (first, second) => first.or(second),
        }
    }

    /// Returns the bytes of the record.
    pub(super) fn encode(&self) -> [u8; RECORD_BYTES] {
        let entry = |entry: Option<SlotEntry>| match entry {
            None => [NONE, 0, 0],
            Some(SlotEntry { slot, id }) => [slot as u32, id.file_bytes, id.header_crc],
        };
        let (confirmed, trial) = (entry(self.confirmed), entry(self.trial.map(|trial| trial.entry)));
        let boots_left = self.trial.map_or(0, |trial| trial.boots_left);
        let head = [MAGIC, self.sequence as u32, (self.sequence >> 32) as u32];
        let words = head.into_iter().chain(confirmed).chain(trial).chain([boots_left, self.rollbacks]);
        let mut bytes = [0; RECORD_BYTES];
        for (to, word) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(words) {
            *to = word.to_le_bytes();
        }
        let crc = crc32c(part(&bytes, 0, 4 * SEALED_WORDS));
        for (to, word) in bytes.as_chunks_mut::<4>().0.iter_mut().skip(SEALED_WORDS).zip([crc, !crc]) {
            *to = word.to_le_bytes();
        }
        bytes
    }

    /// Reads the record at the start of a region; `None` if it is not intact, or has values that no record has.
    pub(super) fn decode(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; RECORD_BYTES] = bytes.first_chunk()?;
        let word = |index: usize| u32_at(bytes, 4 * index);
        let entry = |at: usize| {
            let slot = match word(at) {
                0 => Some(Slot::A),
                1 => Some(Slot::B),
                _ => None,
            };
            slot.map(|slot| SlotEntry { slot, id: ModelId { file_bytes: word(at + 1), header_crc: word(at + 2) } })
        };
        let record = Self {
            sequence: u64::from(word(1)) | u64::from(word(2)) << 32,
            confirmed: entry(3),
            trial: entry(6).map(|entry| Trial { entry, boots_left: word(9) }),
            rollbacks: word(10),
        };
        // All words are compared, so that magic, checksum, inverse and spare words are validated, too.
        (record.encode() == *bytes).then_some(record)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_read_as_it_was_written() {
        let entry = |slot, file_bytes| SlotEntry { slot, id: ModelId { file_bytes, header_crc: !file_bytes } };
        // No mission counts that far, but a number that was cut would make the newer record the older one.
        for sequence in [0, u64::from(u32::MAX), 0x1234_5678_9abc_def0] {
            let trial = Some(Trial { entry: entry(Slot::B, 77_000), boots_left: 3 });
            let whole = SlotRecord { sequence, confirmed: Some(entry(Slot::A, 5_000)), trial, rollbacks: 9 };
            for record in [whole, SlotRecord { trial: None, ..whole }, SlotRecord { confirmed: None, ..whole }] {
                assert_eq!(SlotRecord::decode(&record.encode()), Some(record));
            }
        }
    }
}
