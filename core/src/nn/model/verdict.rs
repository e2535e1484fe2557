//! Opens a validated model again without a second validation.

use super::Model;
use crate::nn::file::{ModelError, RawModel, word};
#[cfg(doc)]
use crate::nn::runner::Runner;
use crate::words::Words;

/// The result of validating a model file, and the checksum that binds it to that file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Verdict {
    /// Checksum of the header. The header contains the checksum of the list of checksums, and the list those of all other bytes.
    pub header_crc: u32,
    /// Length of the file, bytes.
    pub file_bytes: u32,
    /// Offset in the arena of the first byte behind the tensors.
    pub scratch_offset: u32,
    /// Bytes of scratch memory.
    pub scratch_bytes: u32,
    /// Number of checksums of rows in the arena.
    pub sum_count: u32,
    /// Number of multiply-accumulates of a tile.
    pub macs: u64,
}

impl Verdict {
    pub(in crate::nn) fn visit(&mut self, words: &mut Words<'_>) {
        let Self { header_crc, file_bytes, scratch_offset, scratch_bytes, sum_count, macs } = self;
        [header_crc, file_bytes, scratch_offset, scratch_bytes, sum_count].into_iter().for_each(|v| words.u32(v));
        words.u64(macs);
    }
}

impl<'a> Model<'a> {
    /// Returns the result of [`Self::new`], for [`Self::reopen`].
    pub fn verdict(&self) -> Verdict {
        Verdict {
            header_crc: self.raw.word(word::HEADER_CRC),
            file_bytes: self.raw.bytes().len() as u32,
            scratch_offset: self.scratch_offset as u32,
            scratch_bytes: self.scratch_bytes as u32,
            sum_count: self.sum_count as u32,
            macs: self.macs,
        }
    }

    /// Opens the model of a file that was validated before. Only the header is read: [`Runner::scrub`] finds bytes of the body that have
    /// changed since, and kernels check the bounds of their accesses.
    ///
    /// # Errors
    /// As [`Self::new`] for the header; [`ModelError::HeaderChecksum`] if it is not the header that was validated.
    pub fn reopen(bytes: &'a [u8], verdict: &Verdict) -> Result<Self, ModelError> {
        let mut model = Self::open(RawModel::new(bytes)?)?;
        model.scratch_offset = verdict.scratch_offset as usize;
        model.scratch_bytes = verdict.scratch_bytes as usize;
        model.sum_count = verdict.sum_count as usize;
        model.macs = verdict.macs;
        // Leaves space for the additions of `required`, also on machines of 32 bits.
        let parts = [verdict.scratch_offset, verdict.scratch_bytes, verdict.sum_count].map(u64::from);
        let sane = parts[0] + parts[1] + 4 * parts[2] < 1 << 31;
        if sane && model.verdict() == *verdict { Ok(model) } else { Err(ModelError::HeaderChecksum) }
    }
}
