//! Errors of a strip. A refused call changes nothing.

use crate::error::LengthError;
use crate::tile::TilingError;
use core::fmt;

/// The reason why a strip, or a line of it, is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StripError {
    /// A strip without columns, or one whose bytes of memory overflow `usize`.
    Columns {
        /// Columns requested.
        found: usize,
    },
    /// An overlap that does not fit the model's tile.
    Tile(TilingError),
    /// Fewer lines kept than a row of tiles needs: the lines of a tile, and one that shows whether the strip continues.
    Ring {
        /// Lines needed.
        expected: usize,
        /// Lines requested.
        found: usize,
    },
    /// A ground size of a pixel, or a width of a coarse pixel, that is not finite and positive.
    Pixel,
    /// The model needs a light, and the light of the settings was not decided for it ([`crate::nn::Lighting::decide`]).
    Light,
    /// A runner whose model is not the one of the plan.
    Model,
    /// A block of lent memory is shorter than planned.
    Memory(LengthError),
    /// A line or a row of another length.
    Line(LengthError),
    /// No space for another line (or row of posts): step, or take lines, first.
    Full,
    /// The end was announced already.
    Ended,
    /// A grid of posts without columns, or whose rows do not advance along the strip.
    Posts,
    /// A line before the rows of posts that it needs.
    PostsFirst,
    /// Posts for a strip whose coarse DTM comes with its lines.
    NoPosts,
}

impl fmt::Display for StripError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Columns { found } => write!(f, "strip: expected columns that memory can hold, found {found}"),
            Self::Tile(e) => e.fmt(f),
            Self::Ring { expected, found } => {
                write!(f, "strip: expected at least {expected} lines to be kept, found {found}")
            }
            Self::Pixel => f.write_str("strip: expected pixel sizes that are finite and positive, found others"),
            Self::Light => f.write_str("strip: expected a light decided for this model, found none"),
            Self::Model => f.write_str("strip: expected the model it was planned for, found another"),
            Self::Memory(LengthError { expected, found }) => {
                write!(f, "strip: expected a block of at least {expected} values, found {found}")
            }
            Self::Line(LengthError { expected, found }) => {
                write!(f, "strip: expected a line of {expected} samples, found {found}")
            }
            Self::Full => f.write_str("strip: expected room for a line, found none: step or take lines first"),
            Self::Ended => f.write_str("strip: expected no line after the end, found one"),
            Self::PostsFirst => f.write_str("strip: expected another row of posts before this line, found none"),
            Self::NoPosts => f.write_str("strip: expected coarse heights with every line, found posts"),
            Self::Posts => f.write_str("posts: expected columns and a grid that runs along the strip, found none"),
        }
    }
}

impl core::error::Error for StripError {}

impl From<TilingError> for StripError {
    fn from(e: TilingError) -> Self {
        Self::Tile(e)
    }
}

/// Returns the first `expected` values of a lent block.
pub(super) fn lent<T>(block: &mut [T], expected: usize) -> Result<&mut [T], StripError> {
    let found = block.len();
    block.get_mut(..expected).ok_or(StripError::Memory(LengthError { expected, found }))
}

/// Validates that a line has `expected` samples.
pub(super) fn whole_line(expected: usize, found: usize) -> Result<(), StripError> {
    crate::error::same_length(expected, found).map_err(StripError::Line)
}
