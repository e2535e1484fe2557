//! Options of the synthetic Moon.

use super::TerrainKind;
use elunar_base::{Error, Result};

use serde::{Deserialize, Serialize};

/// Finest pixel, metres. Finer images would show boulders and ripples that this terrain lacks.
const PIXEL_M_MIN: f64 = 1.0;
/// Coarsest pixel, metres. Beyond it the coarse DTM of ~59 m is hardly coarser than the image.
const PIXEL_M_MAX: f64 = 8.0;

/// Options of the synthetic Moon. The tour, the experiments and most of the built-in suite use the default. `train` uses wider ranges.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SynthOptions {
    /// Rows of a tile. Default 256 (Sec. III-A).
    pub rows: usize,
    /// Columns of a tile. Default 320 (Sec. III-A).
    pub cols: usize,
    /// Pixel of image and truth, metres, 1–8. Default 2 (NAC DTMs).
    pub pixel_m: f64,
    /// Further pixel sizes, metres. Tiles (not scenes) use `pixel_m` and these in turn. Default none.
    pub also_pixel_m: Vec<f64>,
    /// The terrain of every tile; `None` (default) draws mare or highland per tile.
    pub kind: Option<TerrainKind>,
    /// Sun azimuth, degrees clockwise from north; drawn uniformly. Default 0–360. The ground does not depend on azimuth and elevation.
    pub sun_azimuth_deg: (f64, f64),
    /// Whether the Sun of half of the scenes stands opposite the azimuth that was drawn. Default false.
    pub sun_opposite: bool,
    /// Sun elevation above the horizon, degrees; drawn uniformly. Default 18–64, the paper's training images.
    pub sun_elevation_deg: (f64, f64),
    /// Factor on all relief, craters included; drawn uniformly. Default 1: the roughness of two NAC DTMs.
    pub relief: (f64, f64),
    /// RMS of the coarse DTM's low-frequency error, metres; drawn uniformly. Default 1.5–4 (SLDEM2015: 3–4).
    pub coarse_error_m: (f64, f64),
    /// Largest horizontal misregistration of the coarse DTM, metres. Default 10 (SLDEM2015).
    pub misregistration_m: f64,
    /// Factor on the albedo's contrast (on its logarithm, which varies by some 2 % between the craters, more at fresh ejecta); drawn
    /// uniformly. Default 1.
    pub albedo_contrast: (f64, f64),
    /// Addition to the weight of the Lommel–Seeliger law at the phase angle (the sum stays within 0–1), for ground that differs from the
    /// average; drawn uniformly. Default 0.
    pub lunar_weight_shift: (f64, f64),
    /// Exponent of the DN as a power of the radiance; drawn uniformly. Default 1: a calibrated image.
    pub response_exponent: (f64, f64),
    /// DN without light, as a share of the mean DN: stray light, or the stretch of a picture for viewing; drawn uniformly. Default 0.
    pub pedestal: (f64, f64),
    /// Standard deviation of the camera's blur, pixels, 0–1.5; drawn uniformly. Default 0.5–0.7 (LROC NAC).
    pub blur_px: (f64, f64),
    /// Greatest standard deviation of a Gaussian that smooths the ground before it is photographed, pixels: DTMs of other origin have less
    /// detail than their images could show. Drawn as this times the fourth power of a uniform number: most ground keeps its detail. Default 0.
    pub smooth_ground_px: f64,
    /// RMS of the coarse DTM's stripes along laser tracks and steps at seams, metres; drawn uniformly. Default 0.
    pub coarse_stripes_m: (f64, f64),
    /// Share of the scenes that also have landforms other than craters: blocks, terraces, ridges, dunes, knobs. Default 0.
    pub landforms: f64,
    /// Share of the scenes that also have complex craters, 6 to 160 pixels in radius. Default 0.
    pub complex_craters: f64,
    /// Share of the scenes whose albedo also follows slopes or heights, or has units, streaks or mottles. Default 0.
    pub albedo_features: f64,
    /// Whether fresh craters have boulders. Default true.
    pub boulders: bool,
}

impl Default for SynthOptions {
    fn default() -> Self {
        Self {
            rows: 256,
            cols: 320,
            pixel_m: 2.0,
            also_pixel_m: Vec::new(),
            kind: None,
            sun_azimuth_deg: (0.0, 360.0),
            sun_opposite: false,
            sun_elevation_deg: (18.0, 64.0),
            relief: (1.0, 1.0),
            coarse_error_m: (1.5, 4.0),
            misregistration_m: 10.0,
            albedo_contrast: (1.0, 1.0),
            lunar_weight_shift: (0.0, 0.0),
            response_exponent: (1.0, 1.0),
            pedestal: (0.0, 0.0),
            blur_px: crate::camera::BLUR_PX,
            smooth_ground_px: 0.0,
            coarse_stripes_m: (0.0, 0.0),
            landforms: 0.0,
            complex_craters: 0.0,
            albedo_features: 0.0,
            boulders: true,
        }
    }
}

impl SynthOptions {
    /// Checks every option.
    ///
    /// # Errors
    /// [`Error::Usage`] with the option, its legal range and the value found.
    pub fn validate(&self) -> Result<()> {
        let range = |name: &str, (low, high): (f64, f64), min: f64, max: f64| {
            if low >= min && low <= high && high <= max {
                Ok(())
            } else {
                Err(Error::usage(format!("{name}: expected {min} <= low <= high <= {max}, found {low} and {high}")))
            }
        };
        for (name, value) in [("rows", self.rows), ("cols", self.cols)] {
            if !(16..=8192).contains(&value) {
                return Err(Error::usage(format!("{name}: expected 16 to 8192, found {value}")));
            }
        }
        for pixel_m in std::iter::once(self.pixel_m).chain(self.also_pixel_m.iter().copied()) {
            range("pixel_m", (pixel_m, pixel_m), PIXEL_M_MIN, PIXEL_M_MAX)?;
        }
        range("sun_azimuth_deg", self.sun_azimuth_deg, 0.0, 360.0)?;
        range("sun_elevation_deg", self.sun_elevation_deg, 2.0, 90.0)?;
        range("relief", self.relief, 0.0, 4.0)?;
        range("coarse_error_m", self.coarse_error_m, 0.0, 100.0)?;
        range("albedo_contrast", self.albedo_contrast, 0.0, 10.0)?;
        range("lunar_weight_shift", self.lunar_weight_shift, -1.0, 1.0)?;
        range("response_exponent", self.response_exponent, 0.2, 5.0)?;
        range("pedestal", self.pedestal, -0.5, 2.0)?;
        range("blur_px", self.blur_px, 0.0, 1.5)?;
        range("smooth_ground_px", (self.smooth_ground_px, self.smooth_ground_px), 0.0, 10.0)?;
        let shares = [
            ("landforms", self.landforms),
            ("complex_craters", self.complex_craters),
            ("albedo_features", self.albedo_features),
        ];
        for (name, share) in shares {
            range(name, (share, share), 0.0, 1.0)?;
        }
        range("coarse_stripes_m", self.coarse_stripes_m, 0.0, 100.0)?;
        range("misregistration_m", (self.misregistration_m, self.misregistration_m), 0.0, 100.0)
    }
}
