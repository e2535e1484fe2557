//! The memory that a job is lent.

use crate::error::LengthError;
use crate::nn::InputRules;
use crate::norm::Anchor;
use crate::photoclinometry::Photoclinometry;
use crate::tile::Shape;

/// The memory for a tile; each block is at least as long as its function says. It is unchanged between the calls for a tile.
#[derive(Debug)]
pub struct TileMemory<'m> {
    /// Coarse heights, filled, metres: one for every pixel.
    pub coarse_m: &'m mut [f32],
    /// Bits of valid heights ([`Self::valid_len`]).
    pub valid: &'m mut [u8],
    /// Scratch memory ([`Self::scratch_len`]); at last it holds the heights.
    pub scratch: &'m mut [f32],
    /// Sums over a row or column ([`Self::lines_len`]).
    pub lines: &'m mut [f64],
}

impl TileMemory<'_> {
    /// Number of bytes with a bit for every pixel.
    #[must_use]
    pub const fn valid_len(tile: Shape) -> usize {
        tile.pixels().div_ceil(8)
    }

    /// Number of values of scratch memory for a network with these rules: those of its guide, if it has one, and at least two maps.
    #[must_use]
    pub fn scratch_len(rules: &InputRules, tile: Shape) -> usize {
        let guide = if rules.illumination.is_guided() { Photoclinometry::new(tile).scratch_len() } else { 0 };
        guide.max(tile.pixels().saturating_mul(2))
    }

    /// Number of sums.
    #[must_use]
    pub const fn lines_len(tile: Shape) -> usize {
        Anchor::sums_len(tile.rows, tile.cols)
    }

    /// Returns an error if a block is too short.
    pub(super) fn check(&self, rules: &InputRules, tile: Shape) -> Result<(), LengthError> {
        for (expected, found) in [
            (tile.pixels(), self.coarse_m.len()),
            (Self::valid_len(tile), self.valid.len()),
            (Self::scratch_len(rules, tile), self.scratch.len()),
            (Self::lines_len(tile), self.lines.len()),
        ] {
            if found < expected {
                return Err(LengthError { expected, found });
            }
        }
        Ok(())
    }
}
