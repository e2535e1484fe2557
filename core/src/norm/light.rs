//! The relation of brightness to slope.
//!
//! For small slopes and a constant albedo, brightness is linear in the slopes (our choice, after linear photoclinometry):
//!
//! ```text
//! I / mean(I) - 1 = b_x dz/dx + b_y dz/dy        x along columns, y along rows (down)
//! ```
//!
//! [`Light`] is b, the *contrast of a unit slope*. It points away from the Sun, and is longer for a lower Sun.

use crate::tile::Shape;
use crate::words::Words;

/// Contrast of a unit slope along columns and along rows.
///
/// ```
/// use elunar_core::norm::Light;
///
/// // A Sun in the west, 30 degrees high: ground that rises to the east faces it.
/// let light = Light::from_sun(270.0, 30.0).expect("above the horizon");
/// assert!(light.east > 1.3 && light.east < 1.5 && light.south.abs() < 1e-6);
/// assert!((light.azimuth_deg() - 270.0).abs() < 1e-3);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// b_x: contrast of ground that rises by one metre per metre along a row, to the right.
    pub east: f32,
    /// b_y: contrast of ground that rises by one metre per metre down a column.
    pub south: f32,
}

/// Smallest strength for which contrast depends on slopes: even a Sun at 80 degrees has 0.13.
pub(super) const STRENGTH_MIN: f64 = 0.05;
/// Largest strength; beyond it most ground would be in shadow. A Sun at 3 degrees has 17.
pub(super) const STRENGTH_MAX: f64 = 20.0;
/// The assumed Sun where its angles are unknown: in the north-west, at the middle elevation of the paper's training images (our choice).
const ASSUMED_AZIMUTH_DEG: f64 = 315.0;
const ASSUMED_ELEVATION_DEG: f64 = 40.0;

impl Light {
    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        words.f32(&mut self.east);
        words.f32(&mut self.south);
    }

    /// Makes a light; `None` unless it is finite and its strength is between that of a Sun near the zenith and one at the horizon.
    #[must_use]
    pub fn new(east: f64, south: f64) -> Option<Self> {
        let strength = libm::hypot(east, south);
        // No range contains NaN.
        (STRENGTH_MIN..=STRENGTH_MAX).contains(&strength).then_some(Self { east: east as f32, south: south as f32 })
    }

    /// Makes the light of a Sun at an azimuth (degrees clockwise from up) and an elevation above the horizon, for ground that reflects by
    /// the Lunar-Lambert law with McEwen's L(phase), viewed from the zenith: the derivative of the reflectance by slope, divided by the
    /// reflectance of level ground. `None` if the Sun is not above the horizon.
    #[must_use]
    pub fn from_sun(azimuth_deg: f64, elevation_deg: f64) -> Option<Self> {
        if !(elevation_deg > 0.0 && elevation_deg < 90.0) {
            return None;
        }
        let (sin, cos) = (libm::sin(elevation_deg.to_radians()), libm::cos(elevation_deg.to_radians()));
        let lunar = crate::terrain::lunar_lambert_weight(90.0 - elevation_deg);
        let level = 2.0 * lunar * sin / (sin + 1.0) + (1.0 - lunar) * sin;
        let by_cosine = 2.0 * lunar / ((sin + 1.0) * (sin + 1.0)) + (1.0 - lunar);
        Self::of(azimuth_deg, by_cosine * cos / level)
    }

    /// Returns the assumed light, for ground where [`super::LightFit`] finds none: a Sun 40 degrees high at the known azimuth (degrees
    /// clockwise from up), else in the north-west (our choice). [`crate::nn::Lighting`] says when it is assumed.
    #[must_use]
    pub fn assumed(azimuth_deg: Option<f64>) -> Self {
        let light =
            azimuth_deg.and_then(Self::from_azimuth_deg).or_else(|| Self::from_azimuth_deg(ASSUMED_AZIMUTH_DEG));
        // Not reached: a Sun above the horizon is always a light.
        light.unwrap_or(Self { east: 1.0, south: 1.0 })
    }

    /// Makes the light of a Sun at an azimuth and the assumed elevation.
    pub(crate) fn from_azimuth_deg(azimuth_deg: f64) -> Option<Self> {
        Self::from_sun(azimuth_deg, ASSUMED_ELEVATION_DEG)
    }

    /// Makes the light of a Sun at `azimuth_deg` with this strength.
    pub(crate) fn of(azimuth_deg: f64, strength: f64) -> Option<Self> {
        let (east, north) = (libm::sin(azimuth_deg.to_radians()), libm::cos(azimuth_deg.to_radians()));
        Self::new(-strength * east, strength * north)
    }

    /// Returns the strength: the contrast of a unit slope towards the Sun.
    #[must_use]
    pub fn strength(self) -> f32 {
        libm::hypotf(self.east, self.south)
    }

    /// Returns the azimuth of the Sun, degrees clockwise from up, 0 to 360.
    #[must_use]
    pub fn azimuth_deg(self) -> f64 {
        let deg = libm::atan2(-f64::from(self.east), f64::from(self.south)).to_degrees();
        if deg < 0.0 { deg + 360.0 } else { deg }
    }

    /// Returns the elevation of a Sun with this strength, degrees: the inverse of [`Self::from_sun`].
    #[must_use]
    pub fn elevation_deg(self) -> f64 {
        let (mut low, mut high) = (0.0f64, 90.0f64);
        // Strength falls with elevation, so each step halves the interval.
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            match Self::from_sun(0.0, middle) {
                Some(light) if light.strength() < self.strength() => high = middle,
                // Beyond the strengths of lights: near the horizon above, near the zenith below.
                None if middle > 45.0 => high = middle,
                _ => low = middle,
            }
        }
        0.5 * (low + high)
    }

    /// Returns the light in a mirrored map.
    #[must_use]
    pub fn mirrored(self, mirror: Mirror) -> Self {
        let sign = |mirrored: bool| if mirrored { -1.0 } else { 1.0 };
        Self { east: self.east * sign(mirror.cols), south: self.south * sign(mirror.rows) }
    }
}

/// A mirroring of a row-major map. A second application undoes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Mirror {
    /// Whether the order of rows is reversed.
    pub rows: bool,
    /// Whether the order of columns is reversed.
    pub cols: bool,
}

impl Mirror {
    /// Returns the mirroring that brings a Sun at this azimuth (degrees clockwise from up) into the north-west quadrant.
    #[must_use]
    pub fn from_azimuth_deg(azimuth_deg: f64) -> Self {
        let (east, north) = (libm::sin(azimuth_deg.to_radians()), libm::cos(azimuth_deg.to_radians()));
        Self { rows: north < 0.0, cols: east > 0.0 }
    }

    /// Returns whether nothing is mirrored.
    #[must_use]
    pub fn is_none(self) -> bool {
        self == Self::default()
    }

    /// Returns the index in the original map of pixel `index` of the mirrored map, both row-major and of this shape.
    #[must_use]
    #[inline]
    pub fn source(self, index: usize, Shape { rows, cols }: Shape) -> usize {
        let cols = cols.max(1);
        let (row, col) = (index / cols, index % cols);
        let row = if self.rows { rows.saturating_sub(1).wrapping_sub(row) } else { row };
        row.wrapping_mul(cols).wrapping_add(if self.cols { cols - 1 - col } else { col })
    }

    /// Returns [`Self::source`] of the pixels from `index` on to the end of its row.
    pub(crate) fn sources(self, index: usize, shape: Shape) -> impl Iterator<Item = usize> {
        let first = self.source(index, shape);
        (0..shape.cols).map(move |i| if self.cols { first.wrapping_sub(i) } else { first + i })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn mirrors_bring_every_sun_to_the_north_west(azimuth in 0.0f64..360.0, strength in 0.3f64..3.0) {
            let light = Light::of(azimuth, strength).unwrap();
            prop_assert!((light.azimuth_deg() - azimuth).abs() < 1e-3 || azimuth < 1e-3);
            let mirrored = light.mirrored(Mirror::from_azimuth_deg(azimuth));
            prop_assert!(mirrored.east >= -1e-6 && mirrored.south >= -1e-6, "{mirrored:?}");
        }
    }

    #[test]
    fn the_sun_sets_the_strength() {
        let strength = |elevation| Light::from_sun(10.0, elevation).unwrap().strength();
        // Lambert's cotangent, reduced by the Lunar-Lambert law.
        assert!((strength(20.0) / 2.747 - 0.85).abs() < 0.05, "{}", strength(20.0));
        assert!((strength(60.0) / 0.577 - 0.69).abs() < 0.05, "{}", strength(60.0));
        for elevation in [4.0, 10.0, 45.0, 78.0] {
            let found = Light::from_sun(10.0, elevation).unwrap().elevation_deg();
            assert!((found - elevation).abs() < 1e-4, "{found} for {elevation}");
        }
        // The weakest and the strongest lights are those of a Sun near the zenith and at the horizon.
        let [weakest, strongest] = [STRENGTH_MIN, STRENGTH_MAX].map(|strength| Light::of(10.0, strength).unwrap());
        assert!((strength(weakest.elevation_deg() - 1e-3) / 0.05 - 1.0).abs() < 1e-3, "{}", weakest.elevation_deg());
        assert!(
            (strength(strongest.elevation_deg() + 1e-3) / 20.0 - 1.0).abs() < 1e-3,
            "{}",
            strongest.elevation_deg()
        );
        for out in [0.0, -3.0, 90.0, f64::NAN] {
            assert_eq!(Light::from_sun(10.0, out), None);
        }
        assert_eq!(Light::from_sun(f64::NAN, 30.0), None);
    }

    #[test]
    fn ground_without_light_is_lit_from_the_north_west() {
        assert_eq!(Light::assumed(None), Light::from_sun(315.0, 40.0).unwrap());
        assert_eq!(Light::assumed(Some(f64::NAN)), Light::assumed(None));
        assert_eq!(Light::assumed(Some(100.0)), Light::from_sun(100.0, 40.0).unwrap());
    }

    #[test]
    fn mirrored_pixels_come_from_their_mirror_image() {
        let mirror = |rows, cols| Mirror { rows, cols };
        let order = |t: Mirror| (0..6).map(|i| t.source(i, Shape::new(2, 3))).collect::<Vec<_>>();
        assert_eq!(order(mirror(false, false)), [0, 1, 2, 3, 4, 5]);
        assert_eq!(order(mirror(false, true)), [2, 1, 0, 5, 4, 3]);
        assert_eq!(order(mirror(true, true)), [5, 4, 3, 2, 1, 0]);
    }
}
