//! Bytes with the layout of a model file. Only integrity is validated here, not meaning.

use super::bytes::u32_at;
use super::error::ModelError;
use super::layout::{CHUNK_BYTES, CHUNK_RECORD_BYTES, HEADER_BYTES, MAGIC, VERSION, word};
use crate::nn::crc::crc32c;
use crate::nn::sum::sum;
use crate::part::{head, part};

/// Bytes with a valid header; the chunks are validated with the model ([`crate::nn::Validation`]).
#[derive(Debug, Clone, Copy)]
pub struct RawModel<'a> {
    bytes: &'a [u8],
}

impl<'a> RawModel<'a> {
    /// Validates magic, version, length and the header's checksum.
    ///
    /// # Errors
    /// The first check that fails.
    pub fn new(bytes: &'a [u8]) -> Result<Self, ModelError> {
        Self::of_file(bytes, bytes.len() as u64)
    }

    /// As [`Self::new`], with the first bytes, at least the header, of a file of `found` bytes.
    pub(crate) fn of_file(bytes: &'a [u8], found: u64) -> Result<Self, ModelError> {
        if bytes.get(..MAGIC.len()) != Some(&MAGIC[..]) {
            return Err(ModelError::Magic);
        }
        if bytes.len() < HEADER_BYTES {
            return Err(ModelError::Length { expected: HEADER_BYTES as u64, found });
        }
        let raw = Self { bytes };
        if raw.word(word::VERSION) != VERSION {
            return Err(ModelError::Version { found: raw.word(word::VERSION) });
        }
        if !raw.header_holds() {
            return Err(ModelError::HeaderChecksum);
        }
        if raw.word(word::FILE_BYTES) as u64 != found {
            return Err(ModelError::Length { expected: raw.word(word::FILE_BYTES) as u64, found });
        }
        let chunks = raw.word(word::CHUNKS) as u64;
        let body =
            found.checked_sub(HEADER_BYTES as u64 + CHUNK_RECORD_BYTES as u64 * chunks).ok_or(ModelError::Header)?;
        if raw.word(word::CHUNK_BYTES) as usize != CHUNK_BYTES || chunks != body.div_ceil(CHUNK_BYTES as u64) {
            return Err(ModelError::Header);
        }
        Ok(raw)
    }

    /// Returns header word `index`.
    pub fn word(&self, index: usize) -> u32 {
        u32_at(self.bytes, 4 * index)
    }

    /// Returns the number of chunks.
    pub fn chunks(&self) -> u32 {
        self.word(word::CHUNKS)
    }

    /// Returns the offset of the body.
    pub fn body_offset(&self) -> usize {
        HEADER_BYTES + CHUNK_RECORD_BYTES * self.chunks() as usize
    }

    /// Returns the bytes of chunk `index`.
    pub fn chunk(&self, index: u32) -> &'a [u8] {
        let start = self.body_offset().saturating_add((index as usize).saturating_mul(CHUNK_BYTES));
        let rest = self.bytes.get(start..).unwrap_or_default();
        head(rest, rest.len().min(CHUNK_BYTES))
    }

    /// Returns the stored CRC of chunk `index`.
    pub fn chunk_crc(&self, index: u32) -> u32 {
        u32_at(self.bytes, HEADER_BYTES + CHUNK_RECORD_BYTES * index as usize)
    }

    /// Returns whether the quick checksum of chunk `index` matches; `sum` is a kernel's function for it.
    pub(crate) fn chunk_holds(&self, index: u32, sum: fn(&[u8]) -> u32) -> bool {
        sum(self.chunk(index)) == u32_at(self.bytes, HEADER_BYTES + CHUNK_RECORD_BYTES * index as usize + 4)
    }

    /// Returns whether both checksums of chunk `index` match.
    pub(crate) fn chunk_is_whole(&self, index: u32) -> bool {
        crc32c(self.chunk(index)) == self.chunk_crc(index) && self.chunk_holds(index, sum)
    }

    pub(crate) fn header_holds(&self) -> bool {
        crc32c(part(self.bytes, 0, 4 * word::HEADER_CRC)) == self.word(word::HEADER_CRC)
    }

    /// Returns whether the checksums of the header and of the list of checksums match.
    pub(crate) fn head_holds(&self) -> bool {
        let list = part(self.bytes, HEADER_BYTES, CHUNK_RECORD_BYTES * self.chunks() as usize);
        self.header_holds() && crc32c(list) == self.word(word::LIST_CRC)
    }

    /// Returns the whole file.
    pub fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Returns a section of the body, from the header word of its offset and its length in bytes.
    ///
    /// # Errors
    /// [`ModelError::Header`] if the section leaves the body.
    pub fn section(&self, offset_word: usize, len_bytes: u64) -> Result<&'a [u8], ModelError> {
        let start = self.word(offset_word) as u64;
        let end = start + len_bytes;
        if start < self.body_offset() as u64 || end > self.bytes.len() as u64 {
            return Err(ModelError::Header);
        }
        Ok(part(self.bytes, start as usize, len_bytes as usize))
    }
}
