//! The Sun's direction as an image's file states it.

/// Angles of the Sun that a file states, degrees, as stated: they may be out of range, and NaN is something other than a number.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StatedSun {
    /// Azimuth, clockwise from the raster's up.
    pub azimuth_deg: Option<f64>,
    /// Elevation above the horizon.
    pub elevation_deg: Option<f64>,
}

impl StatedSun {
    /// Returns these angles, and those of `other` where there is none.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            azimuth_deg: self.azimuth_deg.or(other.azimuth_deg),
            elevation_deg: self.elevation_deg.or(other.elevation_deg),
        }
    }
}
