//! Words in the lent memory that are kept twice, each copy under a checksum: the context's record, the tile's job, and the light of the scene.
//!
//! ```text
//! byte 0                        8                            8 + 8 words             copy's end
//!      | magic                  | words, little-endian       | CRC32C | its inverse  | second copy, the same ...
//! ```
//! Every bit is under a checksum. A copy whose checksum does not match is replaced by the other. If both match and differ, a write was cut
//! short; the first copy is valid, because it is written first.

use crate::record::{ContextRecord, WORDS};
use elunar_core::TileJob;
use elunar_core::job::LightSurvey;
use elunar_core::nn::file::crc32c;

/// "ELDCTX" and the version of the record.
const CONTEXT: u64 = u64::from_le_bytes(*b"ELDCTX\x00\x03");
/// "ELDJOB" and the version of the job.
const JOB: u64 = u64::from_le_bytes(*b"ELDJOB\x00\x02");

/// Number of bytes of one copy of so many words.
pub(crate) const fn copy_bytes(words: usize) -> usize {
    8 * (words + 2)
}

/// Number of bytes of both copies.
pub(crate) const fn block_bytes(words: usize) -> usize {
    2 * copy_bytes(words)
}

/// Words that are kept twice under a magic.
pub(crate) struct Sealed<const WORDS: usize> {
    pub(crate) magic: u64,
}

impl<const WORDS: usize> Sealed<WORDS> {
    /// Writes both copies.
    pub(crate) fn write(&self, block: &mut [u8], words: &[u64; WORDS]) {
        write_words(block, self.magic, words);
    }

    /// Reads the words; `true` if a copy was damaged. `None` if both are.
    pub(crate) fn read(&self, block: &[u8]) -> Option<([u64; WORDS], bool)> {
        let mut words = [0; WORDS];
        let damaged = read_words(block, self.magic, &mut words)?;
        Some((words, damaged))
    }
}

/// Number of bytes of both copies of a context.
pub(crate) const HEAD_BYTES: usize = block_bytes(WORDS);

/// Both copies of a context.
pub(crate) type Head = [u8; HEAD_BYTES];

fn sealed(crc: u32) -> u64 {
    crc as u64 | (!crc as u64) << 32
}

/// Returns a copy's bytes without its seal, and the seal.
fn parts(copy: &[u8]) -> Option<(&[u8], u64)> {
    let (body, seal) = copy.split_last_chunk::<8>()?;
    Some((body, u64::from_le_bytes(*seal)))
}

/// Writes a copy.
pub(crate) fn encode(copy: &mut [u8], magic: u64, words: &[u64]) {
    for (slot, word) in copy.as_chunks_mut::<8>().0.iter_mut().zip([magic].iter().chain(words)) {
        *slot = word.to_le_bytes();
    }
    let crc = parts(copy).map_or(0, |(body, _)| crc32c(body));
    if let Some(seal) = copy.last_chunk_mut() {
        *seal = sealed(crc).to_le_bytes();
    }
}

/// Reads a copy; returns whether it is whole. Otherwise the words are not changed.
pub(crate) fn decode(copy: &[u8], magic: u64, words: &mut [u64]) -> bool {
    let Some((body, seal)) = parts(copy) else { return false };
    let Some((first, rest)) = body.as_chunks::<8>().0.split_first() else { return false };
    let whole = u64::from_le_bytes(*first) == magic && seal == sealed(crc32c(body));
    if whole {
        words.iter_mut().zip(rest).for_each(|(word, bytes)| *word = u64::from_le_bytes(*bytes));
    }
    whole
}

/// Writes both copies of words.
pub(crate) fn write_words(block: &mut [u8], magic: u64, words: &[u64]) {
    for copy in block.chunks_exact_mut(copy_bytes(words.len())).take(2) {
        encode(copy, magic, words);
    }
}

/// Reads words; returns whether a copy was damaged, `None` if both are.
pub(crate) fn read_words(block: &[u8], magic: u64, words: &mut [u64]) -> Option<bool> {
    let len = copy_bytes(words.len());
    let (first, second) = block.get(..2 * len)?.split_at_checked(len)?;
    if decode(first, magic, words) {
        // The words of the second copy are not used.
        let seal = parts(second).is_some_and(|(body, seal)| seal == sealed(crc32c(body)));
        return Some(!(seal && second.first_chunk() == Some(&magic.to_le_bytes())));
    }
    decode(second, magic, words).then_some(true)
}

/// Writes both copies of a context.
pub(crate) fn write(head: &mut Head, record: &ContextRecord) {
    write_words(head, CONTEXT, &record.words());
}

/// Reads a context; `true` if a copy was damaged. The caller writes both copies at the end of every call. `None` if both are damaged.
pub(crate) fn read(head: &Head) -> Option<(ContextRecord, bool)> {
    let mut words = [0; WORDS];
    let damaged = read_words(head, CONTEXT, &mut words)?;
    Some((ContextRecord::of(&words), damaged))
}

/// Writes both copies of a job.
pub(crate) fn write_job(block: &mut [u8], job: &TileJob) {
    write_words(block, JOB, &job.to_words());
}

/// Reads the words of a job, as [`read`].
pub(crate) fn read_job(block: &[u8]) -> Option<([u64; TileJob::WORDS], bool)> {
    let mut words = [0; TileJob::WORDS];
    let damaged = read_words(block, JOB, &mut words)?;
    Some((words, damaged))
}

/// "ELDLIT" and the version of the survey.
const LIGHT: u64 = u64::from_le_bytes(*b"ELDLIT\x00\x01");

/// Writes both copies of what tiles show of the light.
pub(crate) fn write_survey(block: &mut [u8], survey: &LightSurvey) {
    write_words(block, LIGHT, &survey.to_words());
}

/// Reads what tiles show of the light, as [`read`].
pub(crate) fn read_survey(block: &[u8]) -> Option<(LightSurvey, bool)> {
    let mut words = [0; LightSurvey::WORDS];
    let damaged = read_words(block, LIGHT, &mut words)?;
    Some((LightSurvey::from_words(words)?, damaged))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    const COPY: usize = copy_bytes(WORDS);

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
        for bit in 0..8 * COPY {
            let mut head = clean;
            head[bit / 8] ^= 1 << (bit % 8);
            // The same bit in the other copy, as a fault of a bus line would change it.
            head[COPY + bit / 8] ^= 1 << (bit % 8);
            assert_eq!(read(&head), None, "bit {bit}");
        }
        assert_eq!(read(&[0; HEAD_BYTES]), None);
        assert_eq!(read(&[0xff; HEAD_BYTES]), None);
    }

    #[test]
    fn the_first_copy_holds_if_a_write_was_cut_short() {
        let (record, mut old) = head();
        let next = ContextRecord { calls: 78, ..record };
        let mut first = [0; HEAD_BYTES];
        write(&mut first, &next);
        old[..COPY].copy_from_slice(&first[..COPY]);
        assert_eq!(read(&old), Some((next, false)));
        // Cut within the first copy: the second is still valid.
        old[..COPY / 2].fill(0);
        assert_eq!(read(&old), Some((record, true)));
    }
}
