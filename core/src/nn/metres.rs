//! A tile in physical units through the runner: brightness and metres in, metres out, without a buffer in between.

use super::error::RunError;
use super::lighting::LightSource;
use super::maps::{TileError, TileInput, TileMaps, TileScale};
use super::runner::Runner;
use crate::mask;

/// A tile that has begun.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Begun {
    /// The way back, for [`Runner::heights`].
    pub scale: TileScale,
    /// Where its light comes from; [`LightSource::Assumed`] should reach whoever uses the heights.
    pub light: LightSource,
}

impl Runner<'_, '_> {
    /// Values of scratch memory that [`Self::begin_metres`] wants; 0 for models that are not given the light. It may be reused as soon as
    /// that returns.
    #[must_use]
    pub fn scratch_len(&self) -> usize {
        self.model().scratch_len()
    }

    /// Normalises a tile as the model was trained ([`TileMaps`]), pixel by pixel on the way into the arena, mirrored if the model wants its Sun
    /// in the north-west, and stands ready for the first step. Pixels that do not count are fed as 0.
    ///
    /// # Errors
    /// [`TileError`]; then nothing has begun.
    pub fn begin_metres(&mut self, tile: &TileInput<'_>, scratch: &mut [f32]) -> Result<Begun, TileError> {
        self.validate_header().map_err(TileError::Run)?;
        let (rules, shape) = (self.model().input_rules(), self.model().tile());
        let maps = TileMaps::new(&rules, shape, tile, scratch)?;
        // The question which kind it is stands outside of the loops over pixels.
        let loaded = match &maps {
            TileMaps::Guided(guided) => self.load(|i, out| guided.image(i, out), |i, out| guided.coarse(i, out)),
            TileMaps::Ranged(ranged) => self.load(|i, out| ranged.image(i, out), |i, out| ranged.coarse(i, out)),
        };
        loaded.map(|()| Begun { scale: maps.scale(), light: maps.light() }).map_err(TileError::Run)
    }

    /// The finished tile in metres above the sphere (Eq. 8), row-major; `scale` is that of [`Begun`].
    ///
    /// # Errors
    /// [`RunError::State`] before the tile is done, [`RunError::TileSize`].
    pub fn heights(&self, scale: &TileScale, out_m: &mut [f32]) -> Result<(), RunError> {
        self.output(out_m)?;
        scale.recover(self.model().tile(), out_m);
        Ok(())
    }
}

/// Which heights of a tile mean something: those of pixels where image and coarse DTM both count. Slices of one length; should
/// they differ, the rest of `out` is false.
pub fn validity(image: &[f32], coarse_m: &[f32], valid: Option<&[bool]>, out: &mut [bool]) {
    let len = image.len().min(coarse_m.len()).min(valid.map_or(usize::MAX, <[bool]>::len));
    for (i, out) in out.iter_mut().enumerate() {
        *out = i < len && mask::counts(image, valid, i) && mask::counts(coarse_m, valid, i);
    }
}
