//! Seals of records: the last word is the quick checksum of the others.

use crate::nn::sum::seal;
use crate::part::head;

/// Returns the seal of a record: its last word, from the others.
fn seal_of(record: &[u8]) -> u32 {
    let words = record.as_chunks::<4>().0;
    seal(head(words, words.len().saturating_sub(1)).iter().map(|word| u32::from_le_bytes(*word)))
}

/// Returns whether a record's last word is its seal.
pub fn sealed(record: &[u8]) -> bool {
    record.last_chunk().is_some_and(|&word| u32::from_le_bytes(word) == seal_of(record))
}

/// Writes the seal of a record.
pub fn seal_record(record: &mut [u8]) {
    let seal = seal_of(record);
    if let Some(last) = record.last_chunk_mut() {
        *last = seal.to_le_bytes();
    }
}
