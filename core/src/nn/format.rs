//! The model file: magic, version, header, checksums, sections; little-endian reads. Judges integrity, not meaning.
//!
//! ```text
//! byte 0    header, 32 little-endian u32 words (below); its last word is the CRC32C of the first 31
//!      128  one CRC32C per chunk of the body; word 30 of the header is the CRC32C of this list
//!      ...  body, cut into chunks of CHUNK_BYTES (the last may be shorter): text, tensors, operators, schedule, constants
//! ```
//! Every byte of the file is under exactly one checksum, so that any single flipped byte is refused.

use super::crc::{Crc32c, crc32c};
use super::error::ModelError;

/// First eight bytes; as in PNG, transfers that change line ends or strip bit 7 destroy it.
pub const MAGIC: [u8; 8] = *b"\x89ELD\r\n\x1a\n";
/// Version of the format.
pub const VERSION: u32 = 3;
/// Bytes of the header.
pub const HEADER_BYTES: usize = 128;
/// Bytes under one checksum.
pub const CHUNK_BYTES: usize = 16 * 1024;
/// "No such tensor or constant" in the file.
pub const NONE: u32 = u32::MAX;

/// Header words by number.
pub mod word {
    /// Format version.
    pub const VERSION: usize = 2;
    /// Bytes of the whole file.
    pub const FILE_BYTES: usize = 3;
    /// Bytes per chunk.
    pub const CHUNK_BYTES: usize = 4;
    /// Number of chunks.
    pub const CHUNKS: usize = 5;
    /// Descriptive JSON text: offset from the start of the file; the next word is its length in bytes.
    pub const TEXT: usize = 6;
    /// Tensor records: offset, then their number.
    pub const TENSORS: usize = 8;
    /// Operator records: offset, then their number.
    pub const OPERATORS: usize = 10;
    /// Constants: offset, then bytes.
    pub const CONSTANTS: usize = 12;
    /// Tile rows, then columns.
    pub const TILE: usize = 14;
    /// Upper end of the normalised elevation range, f32.
    pub const NR: usize = 16;
    /// Share by which the coarse relief is widened, f32.
    pub const RANGE_MARGIN: usize = 17;
    /// Whose range normalised the truth: 0 its own, 1 the coarse tile's, 2 none (heights are counted in pixels).
    pub const TARGET_RANGE: usize = 18;
    /// Tensor that takes the image.
    pub const IMAGE: usize = 19;
    /// Tensor that takes the coarse DTM as codes, or NONE.
    pub const COARSE: usize = 20;
    /// Tensor that holds the result.
    pub const OUTPUT: usize = 22;
    /// Seed of the self-test tile.
    pub const SELF_TEST_SEED: usize = 23;
    /// CRC32C of the self test's output.
    pub const SELF_TEST_CRC: usize = 24;
    /// Which light the network knows: 0 any, 1 the Sun in the north-west quadrant of the grid, 2 as 1 and the image as the four maps of a guide.
    pub const ILLUMINATION: usize = 25;
    /// Schedule entries: offset, then their number.
    pub const SCHEDULE: usize = 26;
    /// CRC32C of the checksum list.
    pub const LIST_CRC: usize = 30;
    /// CRC32C of the header's first 31 words.
    pub const HEADER_CRC: usize = 31;
}

/// The little-endian u32 at `offset`; 0 beyond the end, which callers have excluded.
#[inline(always)]
pub fn u32_at(bytes: &[u8], offset: usize) -> u32 {
    bytes.get(offset..).and_then(|rest| rest.first_chunk()).map_or(0, |&word| u32::from_le_bytes(word))
}

/// The little-endian i32 at `offset`, as [`u32_at`].
#[inline(always)]
pub fn i32_at(bytes: &[u8], offset: usize) -> i32 {
    u32_at(bytes, offset) as i32
}

/// The little-endian i64 at `offset`, as [`u32_at`].
#[inline(always)]
pub fn i64_at(bytes: &[u8], offset: usize) -> i64 {
    bytes.get(offset..).and_then(|rest| rest.first_chunk()).map_or(0, |&word| i64::from_le_bytes(word))
}

/// Bytes that carry a valid header; the chunks are not judged until [`RawModel::verify`].
#[derive(Debug, Clone, Copy)]
pub struct RawModel<'a> {
    bytes: &'a [u8],
}

impl<'a> RawModel<'a> {
    /// Judges magic, version, length and the header's checksum.
    ///
    /// # Errors
    /// The first of them that fails.
    pub fn new(bytes: &'a [u8]) -> Result<Self, ModelError> {
        let found = bytes.len() as u64;
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
        if crc32c(&bytes[..4 * word::HEADER_CRC]) != raw.word(word::HEADER_CRC) {
            return Err(ModelError::HeaderChecksum);
        }
        if raw.word(word::FILE_BYTES) as u64 != found {
            return Err(ModelError::Length { expected: raw.word(word::FILE_BYTES) as u64, found });
        }
        let chunks = raw.word(word::CHUNKS) as u64;
        let body = found.checked_sub(HEADER_BYTES as u64 + 4 * chunks).ok_or(ModelError::Header)?;
        if raw.word(word::CHUNK_BYTES) as usize != CHUNK_BYTES || chunks != body.div_ceil(CHUNK_BYTES as u64) {
            return Err(ModelError::Header);
        }
        Ok(raw)
    }

    /// Header word `index`.
    pub fn word(&self, index: usize) -> u32 {
        u32_at(self.bytes, 4 * index)
    }

    /// Number of chunks.
    pub fn chunks(&self) -> u32 {
        self.word(word::CHUNKS)
    }

    /// First byte of the body.
    pub fn body_offset(&self) -> usize {
        HEADER_BYTES + 4 * self.chunks() as usize
    }

    /// The bytes of chunk `index`.
    pub fn chunk(&self, index: u32) -> &'a [u8] {
        let body = self.bytes.get(self.body_offset()..).unwrap_or(&[]);
        body.chunks(CHUNK_BYTES).nth(index as usize).unwrap_or(&[])
    }

    /// The stored checksum of chunk `index`.
    pub fn chunk_crc(&self, index: u32) -> u32 {
        u32_at(self.bytes, HEADER_BYTES + 4 * index as usize)
    }

    /// The whole file.
    pub fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Judges every checksum.
    ///
    /// # Errors
    /// [`ModelError::ChunkChecksum`] for the first that does not match.
    pub fn verify(&self) -> Result<(), ModelError> {
        if crc32c(&self.bytes[HEADER_BYTES..self.body_offset()]) != self.word(word::LIST_CRC) {
            return Err(ModelError::ChunkChecksum { chunk: u32::MAX });
        }
        match (0..self.chunks()).find(|&chunk| crc32c(self.chunk(chunk)) != self.chunk_crc(chunk)) {
            Some(chunk) => Err(ModelError::ChunkChecksum { chunk }),
            None => Ok(()),
        }
    }

    /// A section of the body, by the header word of its offset and its length in bytes.
    ///
    /// # Errors
    /// [`ModelError::Header`] if it leaves the body.
    pub fn section(&self, offset_word: usize, len_bytes: u64) -> Result<&'a [u8], ModelError> {
        let start = self.word(offset_word) as u64;
        let end = start + len_bytes;
        if start < self.body_offset() as u64 || end > self.bytes.len() as u64 {
            return Err(ModelError::Header);
        }
        Ok(&self.bytes[start as usize..end as usize])
    }
}

/// Where an incremental check of the chunks stands.
#[derive(Debug, Clone, Copy, Default)]
pub struct Scrub {
    chunk: u32,
    offset: usize,
    crc: Crc32c,
}

impl Scrub {
    /// The chunk it has reached, bytes read of it, and their checksum.
    pub(super) fn position(&self) -> (u32, usize, u32) {
        (self.chunk, self.offset, self.crc.value())
    }

    /// A check that stands there, if the file has such a place.
    pub(super) fn at(raw: &RawModel<'_>, chunk: u32, offset: usize, crc: u32) -> Option<Self> {
        let exists = chunk < raw.chunks().max(1) && offset <= raw.chunk(chunk).len();
        exists.then(|| Self { chunk, offset, crc: Crc32c::after(crc) })
    }

    /// Checks up to `max_bytes` further bytes. Returns how many were read, and whether this completed a pass.
    ///
    /// # Errors
    /// The chunk whose checksum does not match; the next call goes on behind it.
    pub fn advance(&mut self, raw: &RawModel<'_>, max_bytes: usize) -> Result<(usize, bool), u32> {
        let mut done = 0;
        while done < max_bytes {
            let chunk = raw.chunk(self.chunk);
            let take = (max_bytes - done).min(chunk.len() - self.offset);
            self.crc.update(&chunk[self.offset..self.offset + take]);
            (self.offset, done) = (self.offset + take, done + take);
            if self.offset < chunk.len() {
                break;
            }
            let (index, good) = (self.chunk, self.crc.value() == raw.chunk_crc(self.chunk));
            let last = index + 1 >= raw.chunks();
            *self = Self { chunk: if last { 0 } else { index + 1 }, ..Self::default() };
            if !good {
                return Err(index);
            }
            if last {
                return Ok((done, true));
            }
        }
        Ok((done, false))
    }
}
