//! Errors of a run.

use crate::words::Words;
use core::fmt;

/// The reason why a run cannot start or continue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunError {
    /// The lent arena is smaller than [`super::required`] says.
    ArenaTooSmall {
        /// Bytes needed.
        required: usize,
        /// Bytes lent.
        found: usize,
    },
    /// An input or output slice whose length is not rows * cols samples.
    TileSize {
        /// Samples needed.
        expected: usize,
        /// Samples found.
        found: usize,
    },
    /// An input sample is NaN or infinite.
    NotFinite {
        /// Its row-major position.
        index: usize,
    },
    /// A call of `step` without a tile, or of `output` before the last step.
    State,
    /// The self test's output differs from the one stored in the model.
    SelfTest {
        /// Stored checksum.
        expected: u32,
        /// Checksum of what was computed.
        found: u32,
    },
    /// A chunk of the model changed after the model was loaded; `u32::MAX` stands for the header or the list of checksums.
    ModelChanged {
        /// Number of the chunk.
        chunk: u32,
    },
    /// The records of an entry of the schedule changed after the model was loaded. The tile is lost. Nothing was written outside its place.
    ProgramChanged {
        /// Number of the entry.
        entry: u32,
    },
    /// A row of a map changed after it was written. The tile is lost and must begin again.
    DataChanged {
        /// Number of the tensor.
        tensor: u32,
        /// Number of the row.
        row: u32,
    },
    /// Sums of products differ from their checksums: the processor erred, or memory changed while it read. The tile is lost and must begin
    /// again.
    Miscomputed {
        /// Number of the entry of the schedule.
        entry: u32,
    },
}

impl RunError {
    /// Writes or reads it, as a number and two values.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        let (mut kind, mut first, mut second) = match *self {
            Self::ArenaTooSmall { required, found } => (0, required, found),
            Self::TileSize { expected, found } => (1, expected, found),
            Self::NotFinite { index } => (2, index, 0),
            Self::State => (3, 0, 0),
            Self::SelfTest { expected, found } => (4, expected as usize, found as usize),
            Self::ModelChanged { chunk } => (5, chunk as usize, 0),
            Self::ProgramChanged { entry } => (6, entry as usize, 0),
            Self::DataChanged { tensor, row } => (7, tensor as usize, row as usize),
            Self::Miscomputed { entry } => (8, entry as usize, 0),
        };
        words.u32(&mut kind);
        words.usize(&mut first);
        words.usize(&mut second);
        *self = match kind {
            0 => Self::ArenaTooSmall { required: first, found: second },
            1 => Self::TileSize { expected: first, found: second },
            2 => Self::NotFinite { index: first },
            4 => Self::SelfTest { expected: first as u32, found: second as u32 },
            5 => Self::ModelChanged { chunk: first as u32 },
            6 => Self::ProgramChanged { entry: first as u32 },
            7 => Self::DataChanged { tensor: first as u32, row: second as u32 },
            8 => Self::Miscomputed { entry: first as u32 },
            _ => Self::State,
        };
    }
}

impl fmt::Display for RunError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::ArenaTooSmall { required, found } => write!(f, "arena: {required} bytes needed, {found} lent"),
            Self::TileSize { expected, found } => write!(f, "tile: expected {expected} samples, found {found}"),
            Self::NotFinite { index } => write!(f, "input sample {index} is not finite"),
            Self::State => f.write_str("no tile is at this point of its run"),
            Self::SelfTest { expected, found } => {
                write!(f, "self test: expected output checksum {expected:08x}, found {found:08x}")
            }
            Self::ModelChanged { chunk: u32::MAX } => {
                f.write_str("the model's header or its checksums changed in memory")
            }
            Self::ModelChanged { chunk } => write!(f, "chunk {chunk} of the model changed in memory"),
            Self::ProgramChanged { entry } => {
                write!(f, "entry {entry} of the model's schedule, or its records, changed in memory")
            }
            Self::DataChanged { tensor, row } => {
                write!(f, "row {row} of tensor {tensor} changed in memory: begin the tile again")
            }
            Self::Miscomputed { entry } => {
                write!(f, "entry {entry} of the model's schedule was computed wrongly: begin the tile again")
            }
        }
    }
}

impl core::error::Error for RunError {}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip that is paused keeps its last fault as words.
    #[test]
    fn every_error_is_read_as_what_wrote_it() {
        for error in [
            RunError::ArenaTooSmall { required: 5, found: 4 },
            RunError::TileSize { expected: 9, found: 8 },
            RunError::NotFinite { index: 7 },
            RunError::State,
            RunError::SelfTest { expected: u32::MAX, found: 1 },
            RunError::ModelChanged { chunk: u32::MAX },
            RunError::ProgramChanged { entry: 3 },
            RunError::DataChanged { tensor: 2, row: 6 },
            RunError::Miscomputed { entry: 4 },
        ] {
            let (mut words, mut written, mut read) = ([0; 3], error, RunError::State);
            written.visit(&mut Words::writing(&mut words));
            read.visit(&mut Words::reading(&mut words));
            assert_eq!((written, read), (error, error));
        }
    }
}
