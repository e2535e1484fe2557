//! Errors of a job.

use super::TilePart;
use crate::error::LengthError;
use crate::norm::NormError;
use core::fmt;

/// The reason why a tile cannot be made. `F` is the network's fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum JobError<F> {
    /// The network reports a fault.
    Network(F),
    /// A map of the tile, or lent memory, has another length.
    Length(LengthError),
    /// The network's rules for its input are not legal.
    Rules(NormError),
    /// The network gave a height that no ground has: it is broken, or overflows.
    Height {
        /// The height, metres.
        found: f32,
        /// Lowest and highest legal height of the tile.
        low: f32,
        /// See `low`.
        high: f32,
    },
    /// Memory of the tile has changed between two calls: begin it again.
    Changed {
        /// What has changed.
        part: TilePart,
    },
    /// The heights, made twice from the network's output, differ: the processor erred, or memory changed. The tile must begin again.
    Unequal,
    /// A call out of order.
    State,
}

impl<F: fmt::Display> fmt::Display for JobError<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Network(fault) => fault.fmt(f),
            Self::Length(error) => error.fmt(f),
            Self::Rules(error) => error.fmt(f),
            Self::Height { found, low, high } => write!(f, "heights of {low} to {high} m expected, {found} found"),
            Self::Changed { part } => write!(f, "the tile's memory as it was left expected, {part:?} changed"),
            Self::Unequal => f.write_str("heights made twice differ: begin the tile again"),
            Self::State => f.write_str("the tile is not prepared"),
        }
    }
}

impl<F: fmt::Debug + fmt::Display> core::error::Error for JobError<F> {}

/// Returns whether a tile has no information for a network: no contrast, no relief, no pixels. Then its coarse heights are kept.
pub(super) fn nothing_to_see(error: &NormError) -> bool {
    matches!(error, NormError::ConstantImage | NormError::Relief { .. } | NormError::TooFewValid { .. })
}
