//! Memory that keeps its bytes without power, as slots see it: four regions that are erased sector by sector and read in place.

use core::fmt;

/// One of the two places for a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slot {
    /// The first.
    A,
    /// The second.
    B,
}

impl Slot {
    /// The other one.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}

/// Part of the storage. Regions share no sector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Region {
    /// A model: as long as the longest model that is ever to be loaded.
    Model(Slot),
    /// The record, at least [`super::RECORD_BYTES`] long.
    Record,
    /// The record once more.
    RecordCopy,
}

/// The driver could not erase or write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StorageError {
    /// The driver's own number, handed through.
    pub code: u32,
}

impl fmt::Display for StorageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the storage reports {}", self.code)
    }
}

impl core::error::Error for StorageError {}

/// What a driver of NOR flash, MRAM or the like offers.
///
/// Power may go at any moment. Of a write that was cut a part has landed, and the byte at work may hold anything; of an erasure that was cut
/// the sector may hold anything. Nothing else may change. What a driver reports is not believed: what was written is read again.
pub trait Storage {
    /// The bytes of a region as they are now; always of one length, a multiple of [`Self::sector_bytes`].
    fn bytes(&self, region: Region) -> &[u8];

    /// What is erased at once in a region, at least 1. Memory that needs no erasing says 1, and erases nothing.
    fn sector_bytes(&self, region: Region) -> usize;

    /// Erases the sector that begins at `offset_bytes`, so that it can be written.
    ///
    /// # Errors
    /// The driver's.
    fn erase(&mut self, region: Region, offset_bytes: usize) -> Result<(), StorageError>;

    /// Writes bytes that were erased before, each once. Rules of the device on alignment and length are the driver's to keep; they are kept
    /// of themselves if chunks of an upload keep them, but for the last one.
    ///
    /// # Errors
    /// The driver's.
    fn write(&mut self, region: Region, offset_bytes: usize, bytes: &[u8]) -> Result<(), StorageError>;
}

impl<S: Storage + ?Sized> Storage for &mut S {
    fn bytes(&self, region: Region) -> &[u8] {
        (**self).bytes(region)
    }

    fn sector_bytes(&self, region: Region) -> usize {
        (**self).sector_bytes(region)
    }

    fn erase(&mut self, region: Region, offset_bytes: usize) -> Result<(), StorageError> {
        (**self).erase(region, offset_bytes)
    }

    fn write(&mut self, region: Region, offset_bytes: usize, bytes: &[u8]) -> Result<(), StorageError> {
        (**self).write(region, offset_bytes, bytes)
    }
}
