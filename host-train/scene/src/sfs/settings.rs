//! Options of shape from shading.

use super::reflectance::SfsLight;
use elunar_base::{Error, Result};
use elunar_core::tile::{INFERENCE_OVERLAP_PX, TILE_COLS, TILE_ROWS};
use serde::Serialize;

/// Default weight of second derivatives, in pixels. Weights scale with the pixel, because ground and pixels enlarged alike give the same
/// image.
pub const SMOOTHNESS_PX: f64 = 0.25;
/// Default weight of the departure from the coarse DTM, per pixel.
pub const DEM_CONSTRAINT_PER_PX: f64 = 0.06;

/// Options of shape from shading. The default weights are the best of a sweep over synthetic scenes (`docs/sfs.md`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SfsSettings {
    /// Azimuth of the Sun, degrees clockwise from the grid's up.
    pub sun_azimuth_deg: f64,
    /// Elevation of the Sun above the horizon, degrees, above 0 and at most 90.
    pub sun_elevation_deg: f64,
    /// Weight of the heights' second derivatives (per metre) against brightness (relative to the tile's mean), metres.
    pub smoothness_weight_m: f64,
    /// Weight of the departure from the coarse DTM (metres) against brightness (relative to the tile's mean), per metre.
    pub dem_constraint_weight_per_m: f64,
    /// Pixels at or below this share of the tile's mean brightness are shadow. Their brightness has no weight.
    pub shadow_threshold: f64,
    /// Levels of the pyramid. Each has half the resolution of the one before; 1 is the image alone.
    pub levels: usize,
    /// Greatest number of Gauss–Newton steps of a level.
    pub iterations: usize,
    /// A level is finished when three steps together lower its cost by no more than this share.
    pub tolerance: f64,
    /// Rows and columns of a tile.
    pub tile: (usize, usize),
    /// Overlap of neighbouring tiles, pixels.
    pub overlap_px: usize,
    /// Number of threads; 0 takes as many as the machine offers. The result does not depend on it.
    #[serde(skip)]
    pub threads: usize,
}

impl SfsSettings {
    /// Returns the default for a Sun and for pixels of `pixel_m` metres. The weights follow from [`SMOOTHNESS_PX`] and
    /// [`DEM_CONSTRAINT_PER_PX`].
    #[must_use]
    pub fn new(sun_azimuth_deg: f64, sun_elevation_deg: f64, pixel_m: f64) -> Self {
        Self {
            sun_azimuth_deg,
            sun_elevation_deg,
            smoothness_weight_m: SMOOTHNESS_PX * pixel_m,
            dem_constraint_weight_per_m: DEM_CONSTRAINT_PER_PX / pixel_m,
            shadow_threshold: 0.0,
            levels: 4,
            iterations: 40,
            tolerance: 1e-3,
            tile: (TILE_ROWS, TILE_COLS),
            overlap_px: INFERENCE_OVERLAP_PX,
            threads: 0,
        }
    }

    /// Checks all settings and returns the light.
    ///
    /// # Errors
    /// [`Error::Usage`] naming the first setting out of range.
    pub fn light(&self) -> Result<SfsLight> {
        let positive = |name: &str, value: f64| {
            if value.is_finite() && value > 0.0 {
                return Ok(());
            }
            Err(Error::usage(format!("{name}: a finite number above 0 expected, {value} found")))
        };
        positive("smoothness weight", self.smoothness_weight_m)?;
        positive("DEM constraint weight", self.dem_constraint_weight_per_m)?;
        positive("tolerance", self.tolerance)?;
        let share = self.shadow_threshold;
        if !(0.0..1.0).contains(&share) {
            return Err(Error::usage(format!("shadow threshold: a share from 0 to below 1 expected, {share} found")));
        }
        if self.levels == 0 || self.iterations == 0 {
            let (levels, iterations) = (self.levels, self.iterations);
            let found = format!("{levels} and {iterations} found");
            return Err(Error::usage(format!("levels and iterations: at least 1 each expected, {found}")));
        }
        SfsLight::new(self.sun_azimuth_deg, self.sun_elevation_deg)
    }

    /// Returns one line for file metadata.
    #[must_use]
    pub fn description(&self) -> String {
        format!(
            "shape from shading, Lunar-Lambert, Sun {} deg high from {} deg, smoothness weight {} m, \
             DEM constraint weight {} /m, shadow threshold {}, {} levels, tolerance {}",
            self.sun_elevation_deg,
            self.sun_azimuth_deg,
            self.smoothness_weight_m,
            self.dem_constraint_weight_per_m,
            self.shadow_threshold,
            self.levels,
            self.tolerance
        )
    }
}
