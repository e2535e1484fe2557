//! A tile in physical units through the runner: brightness and metres in, metres out, without a buffer in between.

use super::error::RunError;
use super::input::{Illumination, TruthRange};
use super::runner::Runner;
use crate::error::NormError;
use crate::mask;
use crate::norm::{ElevationScale, Light, LightFit, Turn};
use crate::part::{item, part};
use crate::photoclinometry::{Guide, GuideInput, Photoclinometry};
use crate::terrain::PixelSize;
use core::fmt;

/// Why a tile in physical units cannot begin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TileError {
    /// The runner refuses it.
    Run(RunError),
    /// It cannot be normalised: no relief, no contrast, too few valid pixels.
    Norm(NormError),
    /// The model wants the light; none was given, and the tile does not show any.
    Light,
}

impl fmt::Display for TileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Run(e) => e.fmt(f),
            Self::Norm(e) => e.fmt(f),
            Self::Light => {
                f.write_str("expected the light, or an image that answers to the coarse DTM's slopes; found neither")
            }
        }
    }
}

impl core::error::Error for TileError {}

impl From<NormError> for TileError {
    fn from(e: NormError) -> Self {
        Self::Norm(e)
    }
}

/// A tile in physical units; maps are row-major rows * cols of the model's tile.
#[derive(Debug, Clone, Copy)]
pub struct TileInput<'t> {
    /// Relative brightness.
    pub image: &'t [f32],
    /// Coarse DTM on the image's grid, metres above the sphere.
    pub coarse_m: &'t [f32],
    /// Which pixels count beside those that are real (see [`mask`]); `None`: all.
    pub valid: Option<&'t [bool]>,
    /// Ground size of a pixel, metres.
    pub pixel_m: f32,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub coarse_px: f32,
    /// How brightness answers to slope ([`Light::from_sun`], or [`LightFit`] over a larger scene); `None` fits it to the tile, which is
    /// less certain. Models that know any light do not ask for it.
    pub light: Option<Light>,
}

/// The way from a network's output back to the ground: what [`Runner::heights`] needs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TileScale {
    /// From normalised elevation to metres.
    pub elevation: ElevationScale,
    /// How the tile was mirrored.
    pub turn: Turn,
}

impl Runner<'_, '_> {
    /// Values of scratch memory that [`Self::begin_metres`] wants; 0 for models that are not given the light. It may be reused as soon as
    /// that returns.
    #[must_use]
    pub fn scratch_len(&self) -> usize {
        self.model().scratch_len()
    }

    /// Normalises a tile as the model was trained, pixel by pixel on the way into the arena, mirrored if the model wants its Sun in the
    /// north-west, and stands ready for the first step. Pixels that do not count are fed as 0.
    ///
    /// # Errors
    /// [`TileError`]; then nothing has begun.
    pub fn begin_metres(&mut self, tile: &TileInput<'_>, scratch: &mut [f32]) -> Result<TileScale, TileError> {
        self.judge_header().map_err(TileError::Run)?;
        let shape = self.model().tile();
        let expected = shape.0 * shape.1;
        let lengths = [tile.image.len(), tile.coarse_m.len(), tile.valid.map_or(expected, <[bool]>::len)];
        if let Some(&found) = lengths.iter().find(|&&len| len != expected) {
            return Err(TileError::Run(RunError::TileSize { expected, found }));
        }
        let elevation = self.elevation_scale(tile)?;
        let light = match self.model().illumination() {
            Illumination::Any => None,
            _ => Some(tile.light.or_else(|| self.fitted_light(tile)).ok_or(TileError::Light)?),
        };
        let turn = light.map_or_else(Turn::default, |light| Turn::from_azimuth_deg(light.azimuth_deg()));
        match light {
            Some(light) if self.model().illumination() == Illumination::Given => {
                self.begin_guided(tile, &elevation, light, turn, scratch)?;
            }
            _ => self.begin_ranged(tile, &elevation, turn)?,
        }
        Ok(TileScale { elevation, turn })
    }

    fn begin_guided(
        &mut self,
        tile: &TileInput<'_>,
        elevation: &ElevationScale,
        light: Light,
        turn: Turn,
        scratch: &mut [f32],
    ) -> Result<(), TileError> {
        let (shape, maps) = (self.model().tile(), self.model().image_maps());
        let plan = Photoclinometry::new(shape);
        let TileInput { image, coarse_m, valid, coarse_px, .. } = *tile;
        let input = GuideInput { image, coarse_m, valid, turn, coarse_px };
        let guide = Guide::new(&plan, input, elevation, light.mirrored(turn), scratch)?;
        self.load(|i| item(&guide.image(i / maps.max(1)), i % maps.max(1)), |i| guide.coarse(i)).map_err(TileError::Run)
    }

    fn begin_ranged(&mut self, tile: &TileInput<'_>, elevation: &ElevationScale, turn: Turn) -> Result<(), TileError> {
        let TileInput { image, coarse_m, valid, .. } = *tile;
        let shape = self.model().tile();
        let (min, max) = mask::extent(image, valid).map_err(|found| NormError::TooFewValid { found })?;
        let span = max - min;
        if !(span.is_finite() && span > 0.0) {
            return Err(NormError::ConstantImage.into());
        }
        let brightness = |i: usize| {
            let pixel = turn.source(i, shape);
            if mask::counts(image, valid, pixel) { (item(image, pixel) - min) / span } else { 0.0 }
        };
        let height = |i: usize| {
            let (mut z, pixel) = ([0.0], turn.source(i, shape));
            // One sample in, one out: the lengths agree.
            let _ = elevation.normalise(part(coarse_m, pixel, 1), &mut z);
            z[0]
        };
        self.load(brightness, height).map_err(TileError::Run)
    }

    fn elevation_scale(&self, tile: &TileInput<'_>) -> Result<ElevationScale, NormError> {
        let (nr, margin) = (self.model().nr(), self.model().range_margin());
        match self.model().truth_range() {
            TruthRange::Pixel => ElevationScale::from_pixel(tile.coarse_m, tile.valid, tile.pixel_m, nr),
            _ => ElevationScale::from_heights(tile.coarse_m, tile.valid, nr)?.with_margin(margin),
        }
    }

    fn fitted_light(&self, tile: &TileInput<'_>) -> Option<Light> {
        let mut fit = LightFit::default();
        let pixel = PixelSize::square(f64::from(tile.pixel_m));
        fit.add(tile.image, tile.coarse_m, self.model().tile().1, pixel, LightFit::cell_px(tile.coarse_px));
        fit.light()
    }

    /// The finished tile in metres above the sphere (Eq. 8), row-major; `scale` is what [`Self::begin_metres`] returned.
    ///
    /// # Errors
    /// [`RunError::State`] before the tile is done, [`RunError::TileSize`].
    pub fn heights(&self, scale: &TileScale, out_m: &mut [f32]) -> Result<(), RunError> {
        self.output(out_m)?;
        let shape = self.model().tile();
        for i in 0..out_m.len() {
            let from = scale.turn.source(i, shape);
            // Mirroring exchanges pixels in pairs.
            if from > i && from < out_m.len() {
                out_m.swap(i, from);
            }
        }
        for z in out_m {
            let mut metres = [0.0];
            let _ = scale.elevation.recover(&[*z], &mut metres);
            *z = metres[0];
        }
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
