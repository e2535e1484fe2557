//! A tile as a network sees it, and the way back: what ground and flight must do alike.

use super::error::RunError;
use super::input::{Illumination, TruthRange};
use crate::error::same_length;
use crate::mask;
use crate::norm::NormError;
use crate::norm::{ElevationScale, Light, LightFit, Turn};
use crate::part::item;
use crate::photoclinometry::{Guide, GuideInput, MAPS, Photoclinometry};
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

impl TileError {
    /// Whether there is nothing in the tile for a network to work with: no contrast, no relief, no pixels. Then the coarse heights may stand.
    #[must_use]
    pub fn nothing_to_see(&self) -> bool {
        use NormError::{ConstantImage, Relief, TooFewValid};
        matches!(self, Self::Norm(ConstantImage | Relief { .. } | TooFewValid { .. }))
    }
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

/// How a model wants its tiles normalised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InputRules {
    /// Upper end of the normalised elevation range, NR (Eq. 1).
    pub nr: f32,
    /// Share of the coarse relief by which the range is widened below and above; 0 is the paper's Eq. 2.
    pub range_margin: f32,
    /// Whose range normalised the truth in training.
    pub truth_range: TruthRange,
    /// Which light the network knows.
    pub illumination: Illumination,
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

/// The way from a network's output back to the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TileScale {
    /// From normalised elevation to metres.
    pub elevation: ElevationScale,
    /// How the tile was mirrored.
    pub turn: Turn,
}

impl TileScale {
    /// Brings a network's output for a tile of (rows, columns), row-major, back: not mirrored, in metres (Eq. 8).
    pub fn recover(&self, shape: (usize, usize), heights: &mut [f32]) {
        for i in 0..heights.len() {
            let from = self.turn.source(i, shape);
            // Mirroring exchanges pixels in pairs.
            if from > i && from < heights.len() {
                heights.swap(i, from);
            }
        }
        for z in heights {
            *z = self.elevation.recovered_m(*z);
        }
    }
}

/// A tile as a network sees it, pixel by pixel: mirrored if the network wants its Sun in the north-west, image in [0, 1] and coarse DTM in
/// [0, NR] (Eq. 2 and Sec. III-A2, by the tile's own ranges), or a guide's maps.
#[derive(Debug)]
pub enum TileMaps<'t, 's> {
    /// Four maps for the image, and the coarse DTM in pixels.
    Guided(GuidedMaps<'t, 's>),
    /// Brightness and heights by their ranges.
    Ranged(RangedMaps<'t>),
}

/// What [`Illumination::Given`] asks for.
#[derive(Debug)]
pub struct GuidedMaps<'t, 's> {
    guide: Guide<'t, 's>,
    scale: TileScale,
}

/// What all other networks ask for.
#[derive(Debug)]
pub struct RangedMaps<'t> {
    tile: TileInput<'t>,
    shape: (usize, usize),
    /// Lowest brightness, and highest minus lowest.
    range: (f32, f32),
    scale: TileScale,
}

impl<'t, 's> TileMaps<'t, 's> {
    /// Makes the maps of a tile of (rows, columns) for a model that has these rules. `scratch` is as long as [`super::Model::scratch_len`] says,
    /// and lent for as long as the maps are used.
    ///
    /// # Errors
    /// [`TileError`].
    pub fn new(
        rules: &InputRules,
        shape: (usize, usize),
        tile: &TileInput<'t>,
        scratch: &'s mut [f32],
    ) -> Result<Self, TileError> {
        let expected = shape.0.saturating_mul(shape.1);
        let lengths = [tile.image.len(), tile.coarse_m.len(), tile.valid.map_or(expected, <[bool]>::len)];
        if let Some(&found) = lengths.iter().find(|&&len| len != expected) {
            return Err(TileError::Run(RunError::TileSize { expected, found }));
        }
        let elevation = elevation_scale(rules, tile)?;
        let light = match rules.illumination {
            Illumination::Any => None,
            _ => Some(tile.light.or_else(|| fitted_light(shape, tile)).ok_or(TileError::Light)?),
        };
        let turn = light.map_or_else(Turn::default, |light| Turn::from_azimuth_deg(light.azimuth_deg()));
        let scale = TileScale { elevation, turn };
        let TileInput { image, coarse_m, valid, coarse_px, .. } = *tile;
        if let Some(light) = light.filter(|_| rules.illumination == Illumination::Given) {
            let plan = Photoclinometry::new(shape);
            let input = GuideInput { image, coarse_m, valid, turn, coarse_px };
            let guide = Guide::new(&plan, input, &elevation, light.mirrored(turn), scratch)?;
            return Ok(Self::Guided(GuidedMaps { guide, scale }));
        }
        let (min, max) = mask::extent(image, valid).map_err(|found| NormError::TooFewValid { found })?;
        let span = max - min;
        if !(span.is_finite() && span > 0.0) {
            return Err(NormError::ConstantImage.into());
        }
        Ok(Self::Ranged(RangedMaps { tile: *tile, shape, range: (min, span), scale }))
    }

    /// The way back.
    #[must_use]
    pub fn scale(&self) -> TileScale {
        match self {
            Self::Guided(maps) => maps.scale,
            Self::Ranged(maps) => maps.scale,
        }
    }

    /// Writes all of it down: the image's maps side by side in every pixel, and the coarse DTM.
    ///
    /// # Errors
    /// [`NormError::Length`] if a buffer has another length.
    pub fn fill(&self, image: &mut [f32], coarse: &mut [f32]) -> Result<(), NormError> {
        match self {
            Self::Guided(maps) => maps.guide.fill(image, coarse),
            Self::Ranged(maps) => {
                same_length(maps.tile.image.len(), image.len())?;
                same_length(maps.tile.image.len(), coarse.len())?;
                let cols = maps.shape.1.max(1);
                for (row, (image, coarse)) in image.chunks_mut(cols).zip(coarse.chunks_mut(cols)).enumerate() {
                    maps.image(row * cols, image);
                    maps.coarse(row * cols, coarse);
                }
                Ok(())
            }
        }
    }
}

impl GuidedMaps<'_, '_> {
    /// Samples of the image from `first` on within a row, the maps side by side in every pixel; both counts of samples are multiples of
    /// [`MAPS`].
    #[inline]
    pub(super) fn image(&self, first: usize, out: &mut [f32]) {
        self.guide.image(first / MAPS, out.as_chunks_mut::<MAPS>().0);
    }

    #[inline]
    pub(super) fn coarse(&self, first: usize, out: &mut [f32]) {
        self.guide.coarse(first, out);
    }
}

impl RangedMaps<'_> {
    #[inline]
    pub(super) fn image(&self, first: usize, out: &mut [f32]) {
        let (TileInput { image, valid, .. }, (min, span)) = (self.tile, self.range);
        for (v, pixel) in out.iter_mut().zip(self.scale.turn.sources(first, self.shape)) {
            *v = if mask::counts(image, valid, pixel) { (item(image, pixel) - min) / span } else { 0.0 };
        }
    }

    #[inline]
    pub(super) fn coarse(&self, first: usize, out: &mut [f32]) {
        for (z, pixel) in out.iter_mut().zip(self.scale.turn.sources(first, self.shape)) {
            *z = self.scale.elevation.normalised(item(self.tile.coarse_m, pixel));
        }
    }
}

fn elevation_scale(rules: &InputRules, tile: &TileInput<'_>) -> Result<ElevationScale, NormError> {
    match rules.truth_range {
        TruthRange::Pixel => ElevationScale::from_pixel(tile.coarse_m, tile.valid, tile.pixel_m, rules.nr),
        _ => ElevationScale::from_heights(tile.coarse_m, tile.valid, rules.nr)?.with_margin(rules.range_margin),
    }
}

fn fitted_light(shape: (usize, usize), tile: &TileInput<'_>) -> Option<Light> {
    let mut fit = LightFit::default();
    let pixel = PixelSize::square(f64::from(tile.pixel_m));
    fit.add(tile.image, tile.coarse_m, shape.1, pixel, LightFit::cell_px(tile.coarse_px));
    fit.light()
}
