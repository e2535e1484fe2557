//! What a scene is like, measured on a sample of its rows before a run.

use super::neighbourhoods::{Parts, SceneLight};
use elunar_core::nn::Illumination;
use elunar_core::norm::LightFit;
use elunar_core::photoclinometry::Contrast;
use elunar_net::illumination::{KnownSun, Lighting};
use serde::{Deserialize, Serialize};

/// Properties of a scene, measured on a sample of its rows.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Survey {
    /// Fit of brightness to the coarse DTM's slopes.
    pub light: LightFit,
    /// Contrast of the image, by wavelength and direction.
    pub contrast: Contrast,
    /// What the parts of the scene show of the light.
    pub parts: Parts,
    /// Brightness of the image.
    pub brightness: ImageBrightness,
    /// Valid pixels of the image with a height of the coarse DTM.
    pub covered_pixels: u64,
    /// Lowest valid height of the coarse DTM, metres; infinite without one.
    pub lowest_m: f32,
    /// Highest valid height of the coarse DTM, metres; negative infinity without one.
    pub highest_m: f32,
    /// Extent of the heights, metres: the longer side of the rows that were read.
    pub extent_m: f64,
}

impl Survey {
    /// Returns the share of the image's valid pixels that have a height of the coarse DTM, of the rows that were read; `None` without a valid
    /// pixel.
    #[must_use]
    pub fn coverage(&self) -> Option<f64> {
        let pixels = self.brightness.pixels;
        (pixels > 0).then(|| self.covered_pixels as f64 / pixels as f64)
    }

    /// Returns the scene's light for a network that expects `illumination`. Unknown parts of the Sun's direction are those of the fit.
    #[must_use]
    pub fn lighting(&self, illumination: Illumination, sun: KnownSun) -> Lighting {
        Lighting::decide(illumination, sun, &self.light)
    }

    /// Returns the light of a run, as [`super::Scene::light_for`] does, from a survey that was made before.
    #[must_use]
    pub fn light_for(&self, illumination: Illumination, sun: KnownSun) -> SceneLight {
        let survey = if Lighting::wants_fit(illumination, sun) { self.clone() } else { Self::default() };
        survey.light(illumination, sun)
    }

    /// Returns the light of every place of the scene, as [`Self::lighting`] does for the whole of it.
    #[must_use]
    pub fn light(self, illumination: Illumination, sun: KnownSun) -> SceneLight {
        SceneLight::new(self.lighting(illumination, sun), illumination, sun, self.parts)
    }
}

/// Brightness of an image's valid pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ImageBrightness {
    /// Valid pixels.
    pub pixels: u64,
    sum: f64,
    squares: f64,
    lowest: Extreme,
    highest: Extreme,
}

/// A lowest or highest value, and how many pixels have exactly this value.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct Extreme {
    value: f32,
    pixels: u64,
}

impl Extreme {
    fn add(&mut self, value: f32, is_beyond: bool) {
        if self.pixels == 0 || is_beyond {
            *self = Self { value, pixels: 1 };
        } else if value == self.value {
            self.pixels += 1;
        }
    }
}

impl ImageBrightness {
    /// Adds pixels; those that are not finite do not count.
    pub fn add(&mut self, image: &[f32]) {
        for &value in image.iter().filter(|value| value.is_finite()) {
            self.pixels += 1;
            self.sum += f64::from(value);
            self.squares += f64::from(value) * f64::from(value);
            self.lowest.add(value, value < self.lowest.value);
            self.highest.add(value, value > self.highest.value);
        }
    }

    /// Returns the lowest value, and the share of pixels that have it.
    #[must_use]
    pub fn lowest(&self) -> (f32, f64) {
        (self.lowest.value, self.share(self.lowest.pixels))
    }

    /// Returns the highest value, and the share of pixels that have it.
    #[must_use]
    pub fn highest(&self) -> (f32, f64) {
        (self.highest.value, self.share(self.highest.pixels))
    }

    /// Returns the mean; 0 without pixels.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.sum / self.pixels.max(1) as f64
    }

    /// Returns the standard deviation as a share of the mean; infinite if the mean is not positive.
    #[must_use]
    pub fn contrast(&self) -> f64 {
        let (pixels, mean) = (self.pixels.max(1) as f64, self.mean());
        if mean > 0.0 { (self.squares / pixels - mean * mean).max(0.0).sqrt() / mean } else { f64::INFINITY }
    }

    fn share(&self, pixels: u64) -> f64 {
        pixels as f64 / self.pixels.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extremes_and_contrast_are_counted_over_all_parts() {
        let mut found = ImageBrightness::default();
        found.add(&[3.0, f32::NAN, 5.0]);
        found.add(&[1.0, 5.0, 1.0, 1.0]);
        assert_eq!((found.pixels, found.lowest(), found.highest()), (6, (1.0, 0.5), (5.0, 2.0 / 6.0)));
        // Mean 16 / 6, mean square 62 / 6.
        let mean = 16.0_f64 / 6.0;
        assert!((found.contrast() - (62.0_f64 / 6.0 - mean * mean).sqrt() / mean).abs() < 1e-12);
        found.add(&[-100.0]);
        assert_eq!((found.lowest().0, found.contrast()), (-100.0, f64::INFINITY));
    }
}
