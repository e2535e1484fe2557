//! A model opened again without being validated anew.

use super::Model;
use crate::nn::file::{ModelError, RawModel, word};
#[cfg(doc)]
use crate::nn::runner::Runner;

/// What validating a model file found, and what binds it to that file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Verdict {
    /// Checksum of the header, which holds that of the list of checksums, which holds those of all other bytes.
    pub header_crc: u32,
    /// Bytes of the file.
    pub file_bytes: u32,
    /// First byte of the arena behind the tensors.
    pub scratch_offset: u32,
    /// Bytes of scratch memory.
    pub scratch_bytes: u32,
    /// Checksums of rows in the arena.
    pub sum_count: u32,
    /// Multiply-accumulates of a tile.
    pub macs: u64,
}

impl<'a> Model<'a> {
    /// What [`Self::new`] found, for [`Self::reopen`].
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

    /// The model of a file that was validated before. Reads its header, not its body: bytes that have changed there since are found by
    /// [`Runner::scrub`], and kernels bound their accesses themselves.
    ///
    /// # Errors
    /// As [`Self::new`], of the header; [`ModelError::HeaderChecksum`] if it is not the one that was validated.
    pub fn reopen(bytes: &'a [u8], verdict: &Verdict) -> Result<Self, ModelError> {
        let mut model = Self::open(RawModel::new(bytes)?)?;
        model.scratch_offset = verdict.scratch_offset as usize;
        model.scratch_bytes = verdict.scratch_bytes as usize;
        model.sum_count = verdict.sum_count as usize;
        model.macs = verdict.macs;
        // Room for what `required` adds, on machines of 32 bits, too.
        let parts = [verdict.scratch_offset, verdict.scratch_bytes, verdict.sum_count].map(u64::from);
        let sane = parts[0] + parts[1] + 4 * parts[2] < 1 << 31;
        if sane && model.verdict() == *verdict { Ok(model) } else { Err(ModelError::HeaderChecksum) }
    }
}
