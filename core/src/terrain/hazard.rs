//! Hazards for landing and driving: one byte per pixel, one bit per reason.

use super::footprint::Footprint;
use crate::terrain::TerrainError;

/// The plane under the footprint is steeper than the limit.
pub const TOO_STEEP: u8 = 1;
/// A pixel is above or below that plane by more than the limit.
pub const TOO_ROUGH: u8 = 2;
/// The footprint leaves the grid or contains a void. Such ground is unknown and counts as a hazard.
pub const UNKNOWN: u8 = 4;

/// The plane under the footprint may be steeper than the limit: it is so within the stated number of standard deviations
/// ([`HazardLimits::with_sigmas`]), or the standard deviation is unknown.
pub const MAYBE_TOO_STEEP: u8 = 8;

/// The limits of a vehicle. Ground is safe (a hazard byte of 0) if slope and roughness of its footprint are known and neither exceeds its
/// limit.
///
/// The slope is that of the footprint's plane, on which the vehicle would stand, not Horn's slope of the pixel (our choice).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HazardLimits {
    slope_deg: f32,
    roughness_m: f32,
    sigmas: f32,
}

impl HazardLimits {
    /// Makes limits that ground may reach but not exceed: the footprint's slope in degrees, above 0 and at most 90, and its roughness in
    /// metres, finite and above 0.
    ///
    /// # Errors
    /// [`TerrainError::SlopeLimit`], [`TerrainError::RoughnessLimit`].
    pub fn new(slope_deg: f32, roughness_m: f32) -> Result<Self, TerrainError> {
        if !(slope_deg > 0.0 && slope_deg <= 90.0) {
            return Err(TerrainError::SlopeLimit { found_deg: slope_deg });
        }
        if !(roughness_m > 0.0 && roughness_m.is_finite()) {
            return Err(TerrainError::RoughnessLimit { found_m: roughness_m });
        }
        Ok(Self { slope_deg, roughness_m, sigmas: 0.0 })
    }

    /// Asks for [`MAYBE_TOO_STEEP`] within this number of standard deviations of the slope's error; 0 asks for none. The standard deviation is
    /// that of a pixel's slope. That of a footprint is smaller, so the bit errs towards safety (our choice).
    ///
    /// # Errors
    /// [`TerrainError::Sigmas`] if the number is negative or not finite.
    pub fn with_sigmas(self, sigmas: f32) -> Result<Self, TerrainError> {
        if sigmas >= 0.0 && sigmas.is_finite() {
            Ok(Self { sigmas, ..self })
        } else {
            Err(TerrainError::Sigmas { found: sigmas })
        }
    }

    /// Returns the number of standard deviations; 0 if the slope's error does not count.
    #[must_use]
    pub fn sigmas(&self) -> f32 {
        self.sigmas
    }

    /// Returns the hazard byte. It compares the `f32` values of the maps, so that maps and byte always agree.
    /// `slope_sd` is the standard deviation of the slope's error, metres per metre, NaN if unknown.
    pub(super) fn classify(&self, footprint: Option<Footprint>, slope_sd: f32) -> u8 {
        let Some(Footprint { slope_deg, roughness_m }) = footprint else { return UNKNOWN };
        let steep = if slope_deg as f32 <= self.slope_deg { 0 } else { TOO_STEEP };
        let rough = if roughness_m as f32 <= self.roughness_m { 0 } else { TOO_ROUGH };
        let maybe = match self.sigmas {
            sigmas if sigmas > 0.0 => {
                let steepest = libm::tan(slope_deg.to_radians()) + f64::from(sigmas * slope_sd);
                if libm::atan(steepest).to_degrees() as f32 <= self.slope_deg { 0 } else { MAYBE_TOO_STEEP }
            }
            _ => 0,
        };
        steep | rough | maybe
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_finite_and_positive() {
        assert!(HazardLimits::new(10.0, 0.3).is_ok() && HazardLimits::new(90.0, f32::MAX).is_ok());
        for slope_deg in [0.0, -1.0, 90.1, f32::NAN, f32::INFINITY] {
            let error = HazardLimits::new(slope_deg, 0.3).unwrap_err();
            assert!(
                matches!(error, TerrainError::SlopeLimit { found_deg } if found_deg.to_bits() == slope_deg.to_bits())
            );
        }
        for roughness_m in [0.0, -0.3, f32::NAN, f32::INFINITY] {
            let error = HazardLimits::new(10.0, roughness_m).unwrap_err();
            assert!(matches!(error, TerrainError::RoughnessLimit { .. }), "{error}");
        }
    }

    #[test]
    fn a_limit_may_be_reached_and_not_exceeded_and_the_unknown_is_a_hazard() {
        let limits = HazardLimits::new(10.0, 0.5).unwrap();
        let classify = |slope_deg, roughness_m| limits.classify(Some(Footprint { slope_deg, roughness_m }), f32::NAN);
        assert_eq!(classify(10.0, 0.5), 0);
        assert_eq!(classify(10.1, 0.5), TOO_STEEP);
        assert_eq!(classify(10.0, 0.51), TOO_ROUGH);
        assert_eq!(classify(f64::NAN, f64::NAN), TOO_STEEP | TOO_ROUGH);
        assert_eq!(limits.classify(None, 0.0), UNKNOWN);
    }

    #[test]
    fn an_unsure_slope_is_a_hazard() {
        let limits = HazardLimits::new(10.0, 0.5).unwrap().with_sigmas(2.0).unwrap();
        let classify = |slope_deg, sd| limits.classify(Some(Footprint { slope_deg, roughness_m: 0.1 }), sd);
        // tan 10 deg is 0.1763, tan 5 deg 0.0875: two standard deviations of 0.0443 lie between.
        assert_eq!((classify(5.0, 0.044), classify(5.0, 0.045)), (0, MAYBE_TOO_STEEP));
        assert_eq!(classify(11.0, 0.0), TOO_STEEP | MAYBE_TOO_STEEP);
        assert_eq!((classify(10.0, 0.0), classify(0.0, f32::NAN)), (0, MAYBE_TOO_STEEP));
        assert_eq!(limits.classify(None, 0.01), UNKNOWN);
        for sigmas in [-1.0, f32::NAN, f32::INFINITY] {
            assert!(matches!(limits.with_sigmas(sigmas), Err(TerrainError::Sigmas { .. })));
        }
    }
}
