//! Errors of slots.

use super::StorageError;
use crate::nn::ModelError;
use core::fmt;

/// The reason why a call was refused or failed. In every case the confirmed model is unchanged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SlotError {
    /// No slot holds a model that this runner accepts. A model can be uploaded and put on trial.
    NothingRuns,
    /// [`super::Slots::boot`] must be called first.
    NotBooted,
    /// An upload while the model that runs is not confirmed, or one on trial is neither confirmed nor rejected.
    Unconfirmed,
    /// A confirmed model cannot be rejected; put another one on trial instead.
    Confirmed,
    /// No upload was begun, or it was given up after an error.
    NoUpload,
    /// An upload longer than a slot, or shorter than a header.
    FileBytes {
        /// Bytes of a slot.
        slot: usize,
        /// Bytes announced.
        found: u32,
    },
    /// A chunk that does not follow the previous one.
    Offset {
        /// Bytes written so far: the next chunk's offset.
        expected: usize,
        /// The chunk's offset.
        found: usize,
    },
    /// More bytes than announced, or a trial before all bytes are written.
    Length {
        /// Bytes announced.
        expected: usize,
        /// Bytes written, or with this chunk.
        found: usize,
    },
    /// A model other than the one announced, confirmed or put on trial, by the checksum of its header.
    OtherModel {
        /// The checksum announced.
        expected: u32,
        /// The checksum found.
        found: u32,
    },
    /// The model was validated and refused.
    Model(ModelError),
    /// A number of boots of a trial that is not in 1 to [`super::MAX_TRIAL_BOOTS`].
    TrialBoots {
        /// Boots requested.
        found: u32,
    },
    /// The storage reports an error.
    Storage(StorageError),
    /// The storage reports success, but the written bytes cannot be read back.
    NotWritten {
        /// Offset of the write in its region.
        offset_bytes: usize,
    },
}

impl From<StorageError> for SlotError {
    fn from(e: StorageError) -> Self {
        Self::Storage(e)
    }
}

impl From<ModelError> for SlotError {
    fn from(e: ModelError) -> Self {
        Self::Model(e)
    }
}

impl fmt::Display for SlotError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NothingRuns => f.write_str("no slot holds a model that runs"),
            Self::NotBooted => f.write_str("expected a boot first"),
            Self::Unconfirmed => f.write_str("expected the model to be confirmed first"),
            Self::Confirmed => f.write_str("a confirmed model is not rejected: put another one on trial"),
            Self::NoUpload => f.write_str("no upload was begun"),
            Self::FileBytes { slot, found } => {
                write!(f, "expected a model of {} to {slot} bytes, found {found}", super::HEADER_BYTES)
            }
            Self::Offset { expected, found } => {
                write!(f, "expected the chunk at byte {expected}, found that at {found}")
            }
            Self::Length { expected, found } => write!(f, "expected {expected} bytes of model, found {found}"),
            Self::OtherModel { expected, found } => {
                write!(f, "expected the model whose header has checksum {expected:08x}, found {found:08x}")
            }
            Self::Model(e) => e.fmt(f),
            Self::TrialBoots { found } => {
                write!(f, "expected a trial of 1 to {} boots, found {found}", super::MAX_TRIAL_BOOTS)
            }
            Self::Storage(e) => e.fmt(f),
            Self::NotWritten { offset_bytes } => write!(f, "what was written at byte {offset_bytes} is not there"),
        }
    }
}

impl core::error::Error for SlotError {}
