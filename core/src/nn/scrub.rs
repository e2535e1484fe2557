//! Compares a model with its checksums chunk by chunk, a few bytes at a time, in spare time.

use super::crc::Crc32c;
use super::file::RawModel;
use crate::part::part;

/// The position of an incremental check of the chunks.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Scrub {
    chunk: u32,
    offset: usize,
    crc: Crc32c,
}

impl Scrub {
    /// Returns the current chunk, the number of its bytes read, and their checksum.
    pub(super) fn position(&self) -> (u32, usize, u32) {
        (self.chunk, self.offset, self.crc.value())
    }

    /// Makes a check at this position; `None` if the file does not have it.
    pub(super) fn at(raw: &RawModel<'_>, chunk: u32, offset: usize, crc: u32) -> Option<Self> {
        let exists = chunk < raw.chunks().max(1) && offset <= raw.chunk(chunk).len();
        exists.then(|| Self { chunk, offset, crc: Crc32c::after(crc) })
    }

    /// Checks up to `max_bytes` further bytes. Returns how many were read, and whether a pass is complete.
    ///
    /// # Errors
    /// The chunk whose checksum does not match; the next call continues behind it.
    pub(super) fn advance(&mut self, raw: &RawModel<'_>, max_bytes: usize) -> Result<(usize, bool), u32> {
        let mut done = 0;
        while done < max_bytes {
            let chunk = raw.chunk(self.chunk);
            let take = (max_bytes - done).min(chunk.len().saturating_sub(self.offset));
            self.crc.update(part(chunk, self.offset, take));
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
