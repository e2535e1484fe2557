//! Writes the checksums of a whole file.

use super::bytes::u32_at;
use super::entry::{ENTRY_BYTES, Entry};
use super::layout::{CHUNK_BYTES, CHUNK_RECORD_BYTES, HEADER_BYTES, word};
use super::operator::OPERATOR_BYTES;
use super::seal::seal_record;
use super::tensor::TENSOR_BYTES;
use crate::nn::crc::crc32c;
use crate::nn::sum::sum;
use crate::part::{copy, part, part_mut};

/// Writes every checksum of a file whose header and body are complete otherwise, with the seals of records. Bytes that are shorter than
/// their header says stay unchanged.
pub fn seal_file(bytes: &mut [u8]) {
    let word = |bytes: &[u8], index: usize| u32_at(bytes, 4 * index) as usize;
    let put = |bytes: &mut [u8], at: usize, value: u32| {
        copy(part_mut(bytes, at, 4), &value.to_le_bytes());
    };
    for (index, size) in [(word::TENSORS, TENSOR_BYTES), (word::OPERATORS, OPERATOR_BYTES)] {
        let (start, count) = (word(bytes, index), word(bytes, index + 1));
        part_mut(bytes, start, count.saturating_mul(size)).chunks_mut(size).for_each(seal_record);
    }
    let (start, count) = (word(bytes, word::SCHEDULE), word(bytes, word::SCHEDULE + 1));
    part_mut(bytes, start, count.saturating_mul(ENTRY_BYTES)).as_chunks_mut().0.iter_mut().for_each(Entry::seal_record);
    let list_bytes = CHUNK_RECORD_BYTES * word(bytes, word::CHUNKS);
    let Some((head, body)) = bytes.split_at_mut_checked(HEADER_BYTES.saturating_add(list_bytes)) else { return };
    for (index, chunk) in body.chunks(CHUNK_BYTES).enumerate() {
        put(head, HEADER_BYTES + CHUNK_RECORD_BYTES * index, crc32c(chunk));
        put(head, HEADER_BYTES + CHUNK_RECORD_BYTES * index + 4, sum(chunk));
    }
    let list = crc32c(part(head, HEADER_BYTES, list_bytes));
    put(head, 4 * word::LIST_CRC, list);
    let header = crc32c(part(head, 0, 4 * word::HEADER_CRC));
    put(head, 4 * word::HEADER_CRC, header);
}
