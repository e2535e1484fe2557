//! The context in the lent memory: a record kept twice, each copy under a checksum.
//!
//! ```text
//! byte 0                        8                            8 + 8 WORDS             COPY_BYTES
//!      | MAGIC                  | words, little-endian       | CRC32C | its inverse  | second copy, the same ...
//! ```
//! Every bit is under a checksum. A copy whose checksum does not match is replaced by the other. If both match and differ, a write was cut
//! short; the first copy is valid, because it is written first.

use crate::record::{ContextRecord, WORDS};
use elunar_core::nn::file::crc32c;

/// "ELDCTX" and the version of the record.
const MAGIC: u64 = u64::from_le_bytes(*b"ELDCTX\x00\x01");
/// Number of bytes of one copy.
pub(crate) const COPY_BYTES: usize = 8 * (WORDS + 2);
/// Number of bytes of both copies.
pub(crate) const HEAD_BYTES: usize = 2 * COPY_BYTES;

type Copy = [u8; COPY_BYTES];
/// Both copies.
pub(crate) type Head = [u8; HEAD_BYTES];

fn encode(record: &ContextRecord) -> Copy {
    let mut copy = [0; COPY_BYTES];
    let slots = copy.as_chunks_mut::<8>().0;
    for (slot, word) in slots.iter_mut().zip([MAGIC].into_iter().chain(record.words())) {
        *slot = word.to_le_bytes();
    }
    let crc = crc_of(&copy);
    if let Some(seal) = copy.last_chunk_mut() {
        *seal = sealed(crc).to_le_bytes();
    }
    copy
}

/// Returns the checksum of a copy without its seal.
fn crc_of(copy: &Copy) -> u32 {
    copy.first_chunk::<{ COPY_BYTES - 8 }>().map_or(0, |body| crc32c(body))
}

fn sealed(crc: u32) -> u64 {
    crc as u64 | (!crc as u64) << 32
}

fn decode(copy: &Copy) -> Option<ContextRecord> {
    let mut words = [0; WORDS];
    let (magic, body) = copy.as_chunks::<8>().0.split_first()?;
    for (word, &bytes) in words.iter_mut().zip(body) {
        *word = u64::from_le_bytes(bytes);
    }
    let seal = u64::from_le_bytes(*copy.last_chunk()?);
    let whole = u64::from_le_bytes(*magic) == MAGIC && seal == sealed(crc_of(copy));
    whole.then(|| ContextRecord::of(&words))
}

/// Writes both copies.
pub(crate) fn write(head: &mut Head, record: &ContextRecord) {
    let copy = encode(record);
    for slot in head.as_chunks_mut().0 {
        *slot = copy;
    }
}

/// Reads the record; `true` if a copy was damaged. The caller writes both copies at the end of every call. `None` if both are damaged.
pub(crate) fn read(head: &Head) -> Option<(ContextRecord, bool)> {
    let [first, second] = head.as_chunks::<COPY_BYTES>().0 else { return None };
    match (decode(first), decode(second)) {
        (Some(record), second) => Some((record, second.is_none())),
        (None, Some(record)) => Some((record, true)),
        (None, None) => None,
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    fn head() -> (ContextRecord, Head) {
        let mut head = [0; HEAD_BYTES];
        let record = ContextRecord { home: 0x1234_5678_9abc, calls: 77, ..ContextRecord::default() };
        write(&mut head, &record);
        (record, head)
    }

    #[test]
    fn every_flipped_bit_is_found_and_the_record_survives() {
        let (record, clean) = head();
        assert_eq!(read(&clean), Some((record, false)));
        for bit in 0..8 * HEAD_BYTES {
            let mut head = clean;
            head[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(read(&head), Some((record, true)), "bit {bit}");
        }
    }

    #[test]
    fn bits_flipped_in_both_copies_are_found() {
        let (_, clean) = head();
        for bit in 0..8 * COPY_BYTES {
            let mut head = clean;
            head[bit / 8] ^= 1 << (bit % 8);
            // The same bit in the other copy, as a fault of a bus line would change it.
            head[COPY_BYTES + bit / 8] ^= 1 << (bit % 8);
            assert_eq!(read(&head), None, "bit {bit}");
        }
        assert_eq!(read(&[0; HEAD_BYTES]), None);
        assert_eq!(read(&[0xff; HEAD_BYTES]), None);
    }

    #[test]
    fn the_first_copy_holds_if_a_write_was_cut_short() {
        let (record, mut old) = head();
        let next = ContextRecord { calls: 78, ..record };
        old[..COPY_BYTES].copy_from_slice(&encode(&next));
        assert_eq!(read(&old), Some((next, false)));
        // Cut within the first copy: the second is still valid.
        old[..COPY_BYTES / 2].fill(0);
        assert_eq!(read(&old), Some((record, true)));
    }
}
