//! Errors of a model file.

use core::fmt;

/// The reason why a model file is refused. Numbers are indices into the lists of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelError {
    /// The file is not a model file.
    Magic,
    /// A version that this runner does not support.
    Version {
        /// The version found.
        found: u32,
    },
    /// The file's length differs from what its header says.
    Length {
        /// Bytes according to the header.
        expected: u64,
        /// Bytes found.
        found: u64,
    },
    /// The header's checksum does not match.
    HeaderChecksum,
    /// The checksum of a chunk does not match; `u32::MAX` stands for the list of checksums itself.
    ChunkChecksum {
        /// Number of the chunk.
        chunk: u32,
    },
    /// A header field lies outside its legal range.
    Header,
    /// The record of a tensor is not legal.
    Tensor {
        /// Number of the tensor.
        tensor: u32,
    },
    /// The record of an operator is not legal, alone or with its tensors.
    Operator {
        /// Number of the operator.
        operator: u32,
        /// The reason.
        reason: OperatorFault,
    },
    /// The schedule reads rows that do not exist yet or no longer, or does not run every step.
    Schedule {
        /// Number of the entry.
        entry: u32,
    },
    /// The records or the schedule need more work than [`super::MAX_WORK`] allows for a file of this length.
    Work,
}

/// The reason why an operator is not legal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OperatorFault {
    /// Unknown kind.
    Kind,
    /// A parameter outside its range.
    Parameter,
    /// A tensor number beyond the list.
    TensorIndex,
    /// Shapes that do not fit each other.
    Shape,
    /// A tensor of a type that this operator does not accept here.
    Type,
    /// Constants that reach beyond their section, or hold illegal values.
    Constants,
    /// An accumulator that could overflow its integer type.
    Overflow,
    /// A seal that does not match the words of its record.
    Seal,
    /// Constants that are read again and again: more work than [`super::MAX_WORK`] allows for a file of this length.
    Work,
}

impl fmt::Display for OperatorFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Kind => "unknown kind",
            Self::Parameter => "parameter outside its range",
            Self::TensorIndex => "tensor number beyond the list",
            Self::Shape => "shapes do not fit",
            Self::Type => "tensor of the wrong type",
            Self::Constants => "constants out of bounds or illegal",
            Self::Overflow => "accumulator could overflow",
            Self::Seal => "seal broken",
            Self::Work => "validation would take more than 64 units of work per byte of the file",
        })
    }
}

impl fmt::Display for ModelError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Magic => f.write_str("not an ELunarDTM model file"),
            Self::Version { found } => write!(f, "expected version {}, found {found}", super::layout::VERSION),
            Self::Length { expected, found } => write!(f, "expected {expected} bytes, found {found}"),
            Self::HeaderChecksum => f.write_str("header checksum does not match"),
            Self::ChunkChecksum { chunk: u32::MAX } => f.write_str("checksum of the checksum list does not match"),
            Self::ChunkChecksum { chunk } => write!(f, "checksum of chunk {chunk} does not match"),
            Self::Header => f.write_str("header field out of range"),
            Self::Tensor { tensor } => write!(f, "tensor {tensor} is not legal, or lies where another is in use"),
            Self::Operator { operator, reason } => write!(f, "operator {operator}: {reason}"),
            Self::Schedule { entry } => {
                write!(f, "schedule entry {entry}: rows that do not exist at that point, or work left undone")
            }
            Self::Work => {
                write!(
                    f,
                    "validation would take more than {} units of work per byte of the file",
                    super::limits::MAX_WORK
                )
            }
        }
    }
}

impl core::error::Error for ModelError {}
