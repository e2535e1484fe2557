//! The division of a strip into tiles.

use crate::tile::{Shape, Tiling};

/// The extent of a strip as far as it is known, and its division into tiles.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cut {
    /// Rows and columns; `usize::MAX` rows while the end is not known.
    pub(super) scene: Shape,
    pub(super) tiling: Tiling,
}
