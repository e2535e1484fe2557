//! Runs a tile in physical units: brightness and metres in, metres out, without a buffer in between.

use super::error::RunError;
use super::lighting::LightSource;
use super::maps::{TileError, TileInput, TileMaps, TileScale};
use super::runner::Runner;
use crate::mask;
use crate::photoclinometry::ExpectedErrors;

/// The properties of a tile that has begun.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Begun {
    /// The scale back to metres, for [`Runner::heights`].
    pub scale: TileScale,
    /// The origin of the light. [`LightSource::Assumed`] should be reported to the user of the heights.
    pub light: LightSource,
    /// The errors that heights and slopes are expected to have; `None` unless the model's maps are weighed.
    pub expected: Option<ExpectedErrors>,
}

impl Runner<'_, '_> {
    /// Number of values of scratch memory that [`Self::begin_metres`] needs; 0 for models without a given light. The memory can be reused
    /// after that call.
    #[must_use]
    pub fn scratch_len(&self) -> usize {
        self.model().scratch_len()
    }

    /// Begins a tile: normalises it as in the model's training ([`TileMaps`]), pixel by pixel on the way into the arena, mirrored if the
    /// model needs its Sun in the north-west. Invalid pixels are 0.
    ///
    /// # Errors
    /// [`TileError`]; then nothing has begun.
    pub fn begin_metres(&mut self, tile: &TileInput<'_>, scratch: &mut [f32]) -> Result<Begun, TileError> {
        self.validate_header().map_err(TileError::Run)?;
        let (rules, shape) = (self.model().input_rules(), self.model().tile());
        let maps = TileMaps::new(&rules, shape, tile, scratch)?;
        // The kind of maps is decided outside of the loops over pixels.
        let loaded = match &maps {
            TileMaps::Guided(guided) => self.load(|i, out| guided.image(i, out), |i, out| guided.coarse(i, out)),
            TileMaps::Ranged(ranged) => self.load(|i, out| ranged.image(i, out), |i, out| ranged.coarse(i, out)),
        };
        loaded
            .map(|()| Begun { scale: maps.scale(), light: maps.light(), expected: maps.expected() })
            .map_err(TileError::Run)
    }

    /// Writes the heights of the finished tile in metres above the sphere (Eq. 8), row-major; `scale` is that of [`Begun`]. They are the
    /// network's: what a strip does next, [`Anchor`](crate::norm::Anchor) and [`Lighting::settle`](super::Lighting::settle), needs the coarse DTM.
    ///
    /// # Errors
    /// [`RunError::State`] before the tile is done, [`RunError::TileSize`].
    pub fn heights(&self, scale: &TileScale, out_m: &mut [f32]) -> Result<(), RunError> {
        self.output(out_m)?;
        scale.recover(self.model().tile(), out_m);
        Ok(())
    }
}

/// Writes which heights of a tile are valid: those of pixels where image and coarse DTM are both valid. If the slices differ in length, the
/// rest of `out` is false.
pub fn validity(image: &[f32], coarse_m: &[f32], valid: Option<&[bool]>, out: &mut [bool]) {
    let len = image.len().min(coarse_m.len()).min(valid.map_or(usize::MAX, <[bool]>::len));
    for (i, out) in out.iter_mut().enumerate() {
        *out = i < len && mask::counts(image, valid, i) && mask::counts(coarse_m, valid, i);
    }
}
