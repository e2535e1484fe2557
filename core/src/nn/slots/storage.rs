//! Memory that keeps its bytes without power: four regions that are erased sector by sector and read in place.

use core::fmt;

/// One of the two slots for a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slot {
    /// First slot.
    A,
    /// Second slot.
    B,
}

impl Slot {
    /// Returns the other slot.
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
    /// The model in a slot; as long as the longest model that is ever to be loaded.
    Model(Slot),
    /// The record, at least [`super::RECORD_BYTES`] long.
    Record,
    /// The second copy of the record.
    RecordCopy,
}

/// An erasure or a write that the driver could not do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StorageError {
    /// The driver's own error number.
    pub code: u32,
}

impl fmt::Display for StorageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the storage reports {}", self.code)
    }
}

impl core::error::Error for StorageError {}

/// The functions of a driver for NOR flash, MRAM or similar memory.
///
/// Power may fail at any moment. A write that was cut leaves part of its bytes written, and the current byte may have any value. An erasure
/// that was cut leaves any values in the sector. Nothing else may change. The reports of a driver are not trusted: written bytes are read
/// back.
pub trait Storage {
    /// Returns the current bytes of a region; its length never changes and is a multiple of [`Self::sector_bytes`].
    fn bytes(&self, region: Region) -> &[u8];

    /// Returns the number of bytes that are erased at once in a region, at least 1. Memory without erasing returns 1, and its `erase` does
    /// nothing.
    fn sector_bytes(&self, region: Region) -> usize;

    /// Erases the sector that begins at `offset_bytes`, so that it can be written.
    ///
    /// # Errors
    /// The driver's error.
    fn erase(&mut self, region: Region, offset_bytes: usize) -> Result<(), StorageError>;

    /// Writes bytes that were erased before, each once. The driver must follow the rules of its device on alignment and length. They hold
    /// without further work if the chunks of an upload follow them, except for the last chunk.
    ///
    /// # Errors
    /// The driver's error.
    fn write(&mut self, region: Region, offset_bytes: usize, bytes: &[u8]) -> Result<(), StorageError>;
}

impl Region {
    /// All regions.
    pub(super) const ALL: [Self; 4] = [Self::Model(Slot::A), Self::Model(Slot::B), Self::Record, Self::RecordCopy];
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
