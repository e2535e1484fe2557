//! The maps of a tile for a network, and the way back to metres. Ground and flight share this code.

use super::error::RunError;
use super::input::{Illumination, TruthRange};
use super::lighting::{KnownSun, LightSource, Lighting, TileLight};
use crate::error::same_length;
use crate::mask;
use crate::norm::intensity::IntensityRange;
use crate::norm::{ElevationScale, FineWaves, LightFit, Mirror, NormError};
use crate::part::item;
use crate::photoclinometry::{Contrast, ExpectedErrors, Guide, GuideInput, MAPS, Photoclinometry, SLOPED_MAPS, Weight};
use crate::tile::Shape;
use core::fmt;

/// The reason why a tile in physical units cannot begin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TileError {
    /// The runner refuses the tile.
    Run(RunError),
    /// The tile cannot be normalised: no relief, no contrast, too few valid pixels.
    Norm(NormError),
}

impl TileError {
    /// Returns whether the tile has no information for a network: no contrast, no relief, no pixels. Then the coarse heights can be kept.
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
        }
    }
}

impl core::error::Error for TileError {}

impl From<NormError> for TileError {
    fn from(e: NormError) -> Self {
        Self::Norm(e)
    }
}

/// The normalisation that a model was trained with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InputRules {
    /// Upper end of the normalised elevation range, NR (Eq. 1).
    pub nr: f32,
    /// Share of the coarse relief by which the range is widened below and above; 0 is the paper's Eq. 2.
    pub range_margin: f32,
    /// The range that normalised the truth in training.
    pub truth_range: TruthRange,
    /// The light that the network knows.
    pub illumination: Illumination,
}

impl InputRules {
    /// Number of values of scratch memory that [`TileMaps::new`] needs for tiles of this shape.
    #[must_use]
    pub fn scratch_len(&self, tile: Shape) -> usize {
        if self.illumination.is_guided() { Photoclinometry::new(tile).scratch_len() } else { 0 }
    }

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

    fn elevation_scale(&self, tile: &TileInput<'_>) -> Result<ElevationScale, NormError> {
        match self.truth_range {
            TruthRange::Pixel => ElevationScale::from_pixel(tile.coarse_m, tile.valid, tile.pixel_m, self.nr),
            TruthRange::Own | TruthRange::Reference => {
                ElevationScale::from_heights(tile.coarse_m, tile.valid, self.nr)?.with_margin(self.range_margin)
            }
        }
    }
}

/// A tile in physical units; maps are row-major rows * cols of the model's tile.
#[derive(Debug, Clone, Copy)]
pub struct TileInput<'t> {
    /// Relative brightness.
    pub image: &'t [f32],
    /// Coarse DTM on the image's grid, metres above the sphere.
    pub coarse_m: &'t [f32],
    /// Mask of pixels; a pixel must also be real (see [`mask`]) to be valid. `None`: no mask.
    pub valid: Option<&'t [bool]>,
    /// Ground size of a pixel, metres.
    pub pixel_m: f32,
    /// Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
    pub coarse_px: f32,
    /// The light, which relates brightness to slope. Models that know any light do not use it.
    pub light: TileLight,
}

impl TileInput<'_> {
    /// Returns the light of the tile for a network.
    fn lighting(&self, illumination: Illumination, shape: Shape, scratch: &mut [f32]) -> Lighting {
        let sun = match self.light {
            TileLight::Scene(lighting) if lighting.source != LightSource::NotAsked => return lighting,
            // Decided for a network that does not ask: no angle is known.
            TileLight::Scene(_) => KnownSun::default(),
            TileLight::Own(sun) => sun,
        };
        let fit = if Lighting::wants_fit(illumination, sun) {
            let pixel_m = f64::from(self.pixel_m);
            let fit = LightFit::of_tile(self.image, self.coarse_m, self.valid, shape.cols, pixel_m, self.coarse_px);
            let contrast = match illumination.is_guided() {
                true => Contrast::of_image(self.image, self.valid, shape, self.coarse_px, scratch).ok(),
                false => None,
            };
            fit.with_axis(contrast.and_then(|contrast| contrast.axis()))
        } else {
            LightFit::default()
        };
        Lighting::decide(illumination, sun, &fit)
    }
}

/// The way from a network's output back to heights on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TileScale {
    /// Scale from normalised elevation to metres.
    pub elevation: ElevationScale,
    /// The mirroring of the tile.
    pub mirror: Mirror,
    /// What is kept of the short waves; all, unless the network's maps are weighed. [`Self::recover`] leaves it to the caller.
    pub fine: FineWaves,
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
    fn row(&self, heights_m: &[f32], first: usize, shape: Shape, out: &mut [f32]) {
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

/// The maps of a tile for a network, computed pixel by pixel: mirrored if the network needs its Sun in the north-west, with the image in
/// [0, 1] and the coarse DTM in [0, NR] (Eq. 2 and Sec. III-A2, by the tile's own ranges), or the maps of a guide.
#[derive(Debug)]
pub enum TileMaps<'t, 's> {
    /// Four or eight maps for the image, and the coarse DTM in pixels.
    Guided(GuidedMaps<'t, 's>),
    /// Brightness and heights, each normalised by its range.
    Ranged(RangedMaps<'t>),
}

/// The maps for [`Illumination::Given`], [`Illumination::Weighed`] and [`Illumination::Sloped`].
#[derive(Debug)]
pub struct GuidedMaps<'t, 's> {
    guide: Guide<'t, 's>,
    scale: TileScale,
    source: LightSource,
    expected: Option<ExpectedErrors>,
    sloped: bool,
}

/// The maps for all other networks.
#[derive(Debug)]
pub struct RangedMaps<'t> {
    tile: TileInput<'t>,
    shape: Shape,
    range: IntensityRange,
    scale: TileScale,
    source: LightSource,
}

impl<'t, 's> TileMaps<'t, 's> {
    /// Makes the maps of a tile of this shape for a model with these rules. `scratch` has the length [`super::Model::scratch_len`], and is
    /// borrowed as long as the maps are used.
    ///
    /// # Errors
    /// [`TileError`].
    pub fn new(
        rules: &InputRules,
        shape: Shape,
        tile: &TileInput<'t>,
        scratch: &'s mut [f32],
    ) -> Result<Self, TileError> {
        let expected = shape.pixels();
        let lengths = [tile.image.len(), tile.coarse_m.len(), tile.valid.map_or(expected, <[bool]>::len)];
        if let Some(&found) = lengths.iter().find(|&&len| len != expected) {
            return Err(TileError::Run(RunError::TileSize { expected, found }));
        }
        let elevation = rules.elevation_scale(tile)?;
        let lighting = match rules.illumination {
            Illumination::Any => Lighting::NOT_ASKED,
            illumination => tile.lighting(illumination, shape, scratch),
        };
        let (mirror, source) = (lighting.mirror(), lighting.source);
        let scale = TileScale { elevation, mirror, fine: FineWaves::WHOLE };
        let TileInput { image, coarse_m, valid, coarse_px, .. } = *tile;
        let weight = match rules.illumination {
            Illumination::Any | Illumination::Northwest => None,
            Illumination::Given => Some(Weight::Plain),
            Illumination::Weighed | Illumination::Sloped => {
                Some(Weight::Trust { trust: lighting.trust, long_share: lighting.long_share })
            }
        };
        if let Some(weight) = weight {
            let plan = Photoclinometry::new(shape);
            let input = GuideInput { image, coarse_m, valid, mirror, coarse_px, weight };
            let guide = Guide::new(&plan, input, &elevation, lighting.light.mirrored(mirror), scratch)?;
            let expected = rules.illumination.is_weighed().then(|| {
                let light = lighting.estimate();
                ExpectedErrors::of_share(guide.share(), &light, tile.pixel_m, coarse_px, guide.dark_below())
            });
            let fine = if expected.is_some() { FineWaves::of_share(guide.share()) } else { scale.fine };
            let scale = TileScale { fine, ..scale };
            let sloped = rules.illumination == Illumination::Sloped;
            return Ok(Self::Guided(GuidedMaps { guide, scale, source, expected, sloped }));
        }
        let range = IntensityRange::of(image, valid)?;
        Ok(Self::Ranged(RangedMaps { tile: *tile, shape, range, scale, source }))
    }

    /// Returns the way back.
    #[must_use]
    pub fn scale(&self) -> TileScale {
        match self {
            Self::Guided(maps) => maps.scale,
            Self::Ranged(maps) => maps.scale,
        }
    }

    /// Returns the origin of the light.
    #[must_use]
    pub fn light(&self) -> LightSource {
        match self {
            Self::Guided(maps) => maps.source,
            Self::Ranged(maps) => maps.source,
        }
    }

    /// Returns the errors that the tile's heights and slopes are expected to have; `None` unless the network's maps are weighed.
    #[must_use]
    pub fn expected(&self) -> Option<ExpectedErrors> {
        match self {
            Self::Guided(maps) => maps.expected,
            Self::Ranged(_) => None,
        }
    }

    /// Writes all maps: those of the image side by side in every pixel, and the coarse DTM.
    ///
    /// # Errors
    /// [`NormError::Length`] if a buffer has another length.
    pub fn fill(&self, image: &mut [f32], coarse: &mut [f32]) -> Result<(), NormError> {
        match self {
            Self::Guided(maps) if maps.sloped => maps.guide.fill_sloped(image, coarse),
            Self::Guided(maps) => maps.guide.fill(image, coarse),
            Self::Ranged(maps) => {
                same_length(maps.tile.image.len(), image.len())?;
                same_length(maps.tile.image.len(), coarse.len())?;
                let cols = maps.shape.cols.max(1);
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
    /// Writes samples of the image from `first` on within a row, the maps side by side in every pixel. `first` and the length of `out` are
    /// multiples of the number of maps.
    #[inline]
    pub(super) fn image(&self, first: usize, out: &mut [f32]) {
        if self.sloped {
            self.guide.sloped_image(first / SLOPED_MAPS, out.as_chunks_mut::<SLOPED_MAPS>().0);
        } else {
            self.guide.image(first / MAPS, out.as_chunks_mut::<MAPS>().0);
        }
    }

    #[inline]
    pub(super) fn coarse(&self, first: usize, out: &mut [f32]) {
        self.guide.coarse(first, out);
    }
}

impl RangedMaps<'_> {
    #[inline]
    pub(super) fn image(&self, first: usize, out: &mut [f32]) {
        let (TileInput { image, valid, .. }, range) = (self.tile, self.range);
        for (v, pixel) in out.iter_mut().zip(self.scale.mirror.sources(first, self.shape)) {
            *v = if mask::counts(image, valid, pixel) { range.normalised(item(image, pixel)) } else { 0.0 };
        }
    }

    #[inline]
    pub(super) fn coarse(&self, first: usize, out: &mut [f32]) {
        self.scale.row(self.tile.coarse_m, first, self.shape, out);
    }
}
