//! An image as slopes: for each pixel the smallest slope that explains its contrast.
//!
//! Of all slopes g with b . g = c, where c = I / mean(I) - 1 and b is the [`Light`], the smallest is g = c b / |b|^2. The mean is that of
//! lit ground: shadows would make level ground look like a slope towards the Sun. As two maps for the
//! network it gives a possible slope and its direction, independent of the Sun's elevation and azimuth (our choice; the paper gives the
//! brightness, normalised to [0, 1], and the network must also find the Sun).

use super::light::Light;
use crate::mask::{Extent, Mean};
use crate::norm::NormError;
use crate::samples::Samples;
use crate::words::Words;

/// The network's unit of slope: 0.1 (5.7 degrees), a typical slope on the Moon (our choice).
pub const SLOPE_UNIT: f32 = 0.1;
/// A pixel of less than this share of the mean brightness is dark: it shows no slope, only that the ground falls away from the light (our
/// choice).
const DARK: f32 = 0.1;
/// Limit of slopes: 45 degrees, steeper than the angle of repose of loose ground (our choice).
pub const SLOPE_MAX: f32 = 1.0;

/// The brightness of a tile, found in two passes over its samples: all of them, then those that are lit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Brightness {
    pub(crate) extent: Extent,
    pub(crate) all: Mean,
    pub(crate) lit: Mean,
}

impl Brightness {
    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        self.extent.visit(words);
        self.all.visit(words);
        self.lit.visit(words);
    }

    pub(crate) const NONE: Self =
        Self { extent: Extent::NONE, all: Mean { sum: 0.0, count: 0 }, lit: Mean { sum: 0.0, count: 0 } };

    /// Finds it by both passes.
    pub(crate) fn of(image: impl Samples) -> Self {
        let mut brightness = Self::NONE;
        (0..image.len()).for_each(|i| brightness.add(image.at(i)));
        let dark_below = brightness.dark_below();
        (0..image.len()).for_each(|i| brightness.lit.add(image.at(i), dark_below));
        brightness
    }

    /// Adds a sample in the first pass.
    #[inline]
    pub(crate) fn add(&mut self, sample: f32) {
        self.extent.add(sample);
        self.all.add(sample, f32::NEG_INFINITY);
    }

    /// Returns the brightness below which a pixel is dark, from the mean of all valid pixels; NaN if there are none.
    pub(crate) fn dark_below(&self) -> f32 {
        DARK * self.all.value()
    }

    /// Returns the mean brightness of lit ground: of the valid pixels that are brighter than a tenth of the mean of all; NaN if this mean is
    /// not positive.
    pub(crate) fn lit_mean(&self) -> f32 {
        if self.dark_below() > 0.0 { self.lit.value() } else { f32::NAN }
    }

    /// Returns the shading under a light, as [`Shading::new`].
    pub(crate) fn shading(&self, light: Light) -> Result<Shading, NormError> {
        let (low, high) = self.extent.range().map_err(|found| NormError::TooFewValid { found })?;
        let mean = self.lit_mean();
        if !(low < high && mean.is_finite() && mean > 0.0) {
            return Err(NormError::ConstantImage);
        }
        let square = light.east * light.east + light.south * light.south;
        Ok(Shading { mean, per_contrast: [light.east, light.south].map(|b| b / square / SLOPE_UNIT) })
    }
}

/// The conversion of a tile's brightness to slopes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shading {
    mean: f32,
    /// Slope units per contrast, east and south.
    per_contrast: [f32; 2],
}

impl Shading {
    /// The shading of nothing, for words of an absent one.
    pub(crate) const NONE: Self = Self { mean: 1.0, per_contrast: [0.0; 2] };

    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        words.f32(&mut self.mean);
        self.per_contrast.iter_mut().for_each(|v| words.f32(v));
    }

    /// Makes the shading of a tile from its mean brightness over the valid pixels that are not dark (see [`crate::mask`]), under `light`.
    ///
    /// # Errors
    /// [`NormError::TooFewValid`], [`NormError::ConstantImage`] if the image has no contrast or no light.
    pub fn new(image: impl Samples, light: Light) -> Result<Self, NormError> {
        Brightness::of(image).shading(light)
    }

    /// Returns the brightness below which a pixel is dark: a tenth of the mean of lit ground.
    #[must_use]
    pub fn dark_below(&self) -> f32 {
        DARK * self.mean
    }

    /// Returns the slopes of a pixel of this brightness, east and south, in units of [`SLOPE_UNIT`].
    #[must_use]
    #[inline]
    pub fn slopes(&self, brightness: f32) -> [f32; 2] {
        let contrast = brightness / self.mean - 1.0;
        let limit = SLOPE_MAX / SLOPE_UNIT;
        self.per_contrast.map(|p| (contrast * p).clamp(-limit, limit))
    }

    /// Returns the slope along the light of a pixel of this brightness, metres per metre; `strength` is that of the light.
    #[must_use]
    #[inline]
    pub fn along(&self, brightness: f32, strength: f32) -> f32 {
        ((brightness / self.mean - 1.0) / strength).clamp(-SLOPE_MAX, SLOPE_MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Masked;

    #[test]
    fn the_smallest_slope_explains_the_contrast() {
        let light = Light { east: 1.2, south: -0.5 };
        let image = [90.0, 100.0, 110.0, 100.0];
        let shading = Shading::new(&image[..], light).unwrap();
        for v in image {
            let ([east, south], contrast) = (shading.slopes(v), v / 100.0 - 1.0);
            assert!(((light.east * east + light.south * south) * SLOPE_UNIT - contrast).abs() < 1e-6);
            // The slope is along the light, so no smaller one explains the contrast.
            assert!((east * light.south - south * light.east).abs() < 1e-5);
            assert!((shading.along(v, light.strength()) * light.strength() - contrast).abs() < 1e-6);
        }
    }

    #[test]
    fn steep_slopes_are_cut_off() {
        let shading = Shading::new(&[1.0, 3.0, f32::NAN][..], Light { east: 0.1, south: 0.0 }).unwrap();
        assert_eq!([shading.slopes(1.0), shading.slopes(3.0)], [[-10.0, 0.0], [10.0, 0.0]]);
        assert_eq!([shading.along(1.0, 0.1), shading.along(3.0, 0.1)], [-1.0, 1.0]);
    }

    #[test]
    fn level_ground_beside_a_shadow_has_no_slope() {
        // A half in shadow, a void, and a masked pixel.
        let samples = &[100.0, 100.0, 120.0, 80.0, 1.0, 2.0, 1.5, 0.0, f32::NAN, 9e3][..];
        let image = Masked { samples, bits: &[0xff, 1] };
        let light = Light { east: 1.0, south: 0.0 };
        let shading = Shading::new(image, light).unwrap();
        assert_eq!(shading.along(100.0, 1.0), 0.0);
        assert_eq!(shading.dark_below(), 10.0);
    }

    #[test]
    fn darkness_and_sameness_have_no_shading() {
        let light = Light { east: 1.0, south: 0.0 };
        assert_eq!(Shading::new(&[0.0; 4][..], light), Err(NormError::ConstantImage));
        assert_eq!(Shading::new(&[-3.0, 1.0][..], light), Err(NormError::ConstantImage));
        assert_eq!(Shading::new(&[1.0, f32::NAN][..], light), Err(NormError::TooFewValid { found: 1 }));
    }
}
