//! The way from a network's output back to heights on the ground.

use crate::error::same_length;
use crate::nn::{InputRules, TruthRange};
use crate::norm::{ElevationScale, Mirror, NormError};
use crate::part::item;
use crate::tile::Shape;

/// The way from a network's output back to heights on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TileScale {
    /// Scale from normalised elevation to metres.
    pub elevation: ElevationScale,
    /// The mirroring of the tile.
    pub mirror: Mirror,
}

impl TileScale {
    /// Writes the heights of a tile of this shape, metres, row-major, in the form of the network's output: mirrored and normalised. The
    /// inverse of [`Self::recover`].
    ///
    /// # Errors
    /// [`NormError::Length`] if a buffer has another length.
    pub fn normalise(&self, shape: Shape, heights_m: &[f32], out: &mut [f32]) -> Result<(), NormError> {
        same_length(shape.pixels(), heights_m.len())?;
        same_length(heights_m.len(), out.len())?;
        let cols = shape.cols.max(1);
        for (row, out) in out.chunks_mut(cols).enumerate() {
            self.row(heights_m, row * cols, shape, out);
        }
        Ok(())
    }

    /// Normalises pixels of one row, from the row-major index `first` of the mirrored tile on.
    #[inline]
    pub(super) fn row(&self, heights_m: &[f32], first: usize, shape: Shape, out: &mut [f32]) {
        for (z, pixel) in out.iter_mut().zip(self.mirror.sources(first, shape)) {
            *z = self.elevation.normalised(item(heights_m, pixel));
        }
    }

    /// Recovers heights from a network's output for a tile of this shape, row-major: not mirrored, in metres (Eq. 8).
    pub fn recover(&self, shape: Shape, heights: &mut [f32]) {
        for i in 0..heights.len() {
            let from = self.mirror.source(i, shape);
            // Mirroring swaps pixels in pairs.
            if from > i && from < heights.len() {
                heights.swap(i, from);
            }
        }
        for z in heights {
            *z = self.elevation.recovered_m(*z);
        }
    }
}

impl InputRules {
    /// Returns the scale that normalises a tile's truth in training: `scale`, which normalised its coarse heights, or one from the truth's
    /// own range.
    ///
    /// # Errors
    /// Those of [`ElevationScale::from_heights`].
    pub fn truth_scale(&self, scale: &TileScale, truth_m: &[f32]) -> Result<TileScale, NormError> {
        Ok(match self.truth_range {
            TruthRange::Own => TileScale { elevation: ElevationScale::from_heights(truth_m, None, self.nr)?, ..*scale },
            TruthRange::Reference | TruthRange::Pixel => *scale,
        })
    }
}
