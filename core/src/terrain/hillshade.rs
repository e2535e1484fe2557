//! The hillshade of `gdaldem`, so that images can be compared with those of other tools.

use super::{PixelSize, gradient};
use crate::error::{LengthError, same_length};
use crate::grid::GridView;

/// The direction of the light, and the exaggeration of heights. The default is that of `gdaldem hillshade`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sun {
    /// Azimuth, degrees clockwise from north.
    pub azimuth_deg: f64,
    /// Elevation, degrees above the horizon.
    pub elevation_deg: f64,
    /// Factor on the heights; 1 for true scale.
    pub exaggeration: f64,
}

impl Default for Sun {
    fn default() -> Self {
        Self { azimuth_deg: 315.0, elevation_deg: 45.0, exaggeration: 1.0 }
    }
}

/// Writes the shaded relief, one byte per pixel: 0 for voids, else 1 to 255 (`gdaldem hillshade`, Horn).
///
/// The value is `max(1, 1 + 254 c)`, rounded to nearest, where c is the cosine between surface normal and Sun. GDAL uses an approximation
/// of 1/√x, so a pixel within its error of a rounding boundary could differ by 1.
///
/// # Errors
/// [`LengthError`] if `out` does not have one byte per pixel.
pub fn hillshade(heights_m: GridView<'_, f32>, pixel: PixelSize, sun: Sun, out: &mut [u8]) -> Result<(), LengthError> {
    let (rows, cols) = (heights_m.rows(), heights_m.cols());
    same_length(rows * cols, out.len())?;
    let light = SunVector::of(sun);
    for (i, out) in out.iter_mut().enumerate() {
        *out = gradient(heights_m, i / cols, i % cols, pixel).map_or(0, |gradient| light.shade(gradient));
    }
    Ok(())
}

/// The direction and the exaggeration of a [`Sun`].
#[derive(Debug, Clone, Copy)]
pub(super) struct SunVector {
    /// Unit vector: east, north, up.
    direction: [f64; 3],
    exaggeration: f64,
}

impl SunVector {
    pub(super) fn of(sun: Sun) -> Self {
        let (azimuth, elevation) = (sun.azimuth_deg.to_radians(), sun.elevation_deg.to_radians());
        let direction = [
            libm::sin(azimuth) * libm::cos(elevation), // east
            libm::cos(azimuth) * libm::cos(elevation), // north
            libm::sin(elevation),                      // up
        ];
        Self { direction, exaggeration: sun.exaggeration }
    }

    /// Returns the byte of a pixel with the given gradient (towards east and south, metres per metre), 1 to 255.
    pub(super) fn shade(&self, (east, south): (f64, f64)) -> u8 {
        let normal = super::normal::from_gradient(east * self.exaggeration, south * self.exaggeration);
        let light = self.direction;
        let cosine = normal[0] * light[0] + normal[1] * light[1] + normal[2] * light[2];
        let shade = (1.0 + 254.0 * cosine.max(0.0)) as f32; // as GDAL, which rounds to `f32` before bytes
        libm::floorf(shade + 0.5) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The textbook's form of the same cosine, by slope and aspect (Horn 1981, Eq. 16): no vectors.
        #[test]
        fn shades_are_those_of_slope_and_aspect(
            slope_deg in 0.0f64..80.0, aspect_deg in 0.0f64..360.0, azimuth_deg in 0.0f64..360.0, elevation_deg in 0.0f64..=90.0,
            exaggeration in 0.5f64..4.0,
        ) {
            let [slope, aspect, azimuth, elevation] = [slope_deg, aspect_deg, azimuth_deg, elevation_deg].map(f64::to_radians);
            // Ground faces where it falls to.
            let fall = libm::tan(slope);
            let gradient = (-fall * libm::sin(aspect), fall * libm::cos(aspect));
            let found = SunVector::of(Sun { azimuth_deg, elevation_deg, exaggeration }).shade(gradient);
            let slope = libm::atan(exaggeration * fall);
            let towards = libm::cos(azimuth - aspect);
            let cosine = libm::sin(elevation) * libm::cos(slope) + libm::cos(elevation) * libm::sin(slope) * towards;
            let expected = 1.0 + 254.0 * cosine.max(0.0);
            prop_assert!((f64::from(found) - expected).abs() <= 0.5001, "{found} {expected}");
        }
    }

    #[test]
    fn flat_ground_shows_the_sine_of_the_suns_elevation() {
        let mut out = [9u8; 9];
        let sun = Sun { elevation_deg: 90.0, ..Sun::default() };
        hillshade(GridView::new(&[5.0; 9], 3, 3).unwrap(), PixelSize::square(2.0), sun, &mut out).unwrap();
        assert_eq!(out, [0, 0, 0, 0, 255, 0, 0, 0, 0]);
    }

    #[test]
    fn slopes_facing_away_are_one() {
        let mut out = [9u8; 9];
        let steep_east = [900.0, 600.0, 300.0, 900.0, 600.0, 300.0, 900.0, 600.0, 300.0];
        hillshade(GridView::new(&steep_east, 3, 3).unwrap(), PixelSize::square(1.0), Sun::default(), &mut out).unwrap();
        assert_eq!(out[4], 1);
    }
}
