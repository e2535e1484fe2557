//! The line along which the Sun shines, as the image alone shows it.

/// Standard deviation of the axis of relief alone, degrees (our choice: on eight real images with a DTM it errs by 2 to 10 degrees).
const RELIEF_SD_DEG: f64 = 6.0;
/// The directed part of the contrast of ground without albedo. Shading is not quite linear, and ground has directions of its own (our choice,
/// near 0.72, the best of 0.72, 0.8, 0.9 and 1 on real scenes).
pub(crate) const DIRECTED_RELIEF: f64 = 0.75;
/// Smallest share of relief that is expected (our choice).
const SHARE_MIN: f64 = 0.1;

/// The line along which the Sun shines, as the image alone shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Axis {
    /// Azimuth of one of its ends, degrees clockwise from up, 0 to 180.
    pub azimuth_deg: f64,
    /// Standard deviation, degrees: 6 divided by the directed part of the contrast.
    pub sd_deg: f64,
}

impl Axis {
    /// Makes an axis. `directed` is the directed part of the contrast, above 0: 0 for albedo alone, near 1 for relief alone.
    pub(crate) fn new(azimuth_deg: f64, directed: f64) -> Self {
        Self { azimuth_deg, sd_deg: RELIEF_SD_DEG / directed.min(1.0) }
    }

    /// Returns the share of the contrast that is relief under a Sun at this azimuth, 0.1 to 1.
    pub(super) fn share(self, azimuth_deg: f64) -> f64 {
        let apart = 2.0 * (azimuth_deg - self.azimuth_deg).to_radians();
        (RELIEF_SD_DEG / self.sd_deg * libm::cos(apart) / DIRECTED_RELIEF).clamp(SHARE_MIN, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_is_that_of_the_directed_contrast() {
        let axis = Axis::new(30.0, 0.6);
        assert!((axis.sd_deg - 10.0).abs() < 1e-12);
        for azimuth_deg in [30.0, 210.0, -150.0] {
            assert!((axis.share(azimuth_deg) - 0.8).abs() < 1e-12);
        }
        assert!((axis.share(60.0) - 0.4).abs() < 1e-12);
        assert_eq!((axis.share(120.0), Axis::new(0.0, 5.0).share(0.0)), (SHARE_MIN, 1.0));
    }
}
