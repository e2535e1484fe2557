//! The Sun's angles: their ranges.

use crate::illumination::KnownSun;
use elunar_base::{Error, Result};

/// Checks an azimuth: a finite number from -360 to 360 degrees. Messages call it `name`.
///
/// # Errors
/// [`Error::Usage`] with the range and the number found.
pub fn check_azimuth(name: &str, deg: f64) -> Result<()> {
    // No range contains NaN.
    if (-360.0..=360.0).contains(&deg) {
        return Ok(());
    }
    Err(Error::usage(format!("{name}: a number from -360 to 360 degrees expected, found {deg}")))
}

/// Checks an elevation: above 0 and below 90 degrees. Under a Sun at the zenith brightness does not show the direction of a slope. Messages
/// call it `name`.
///
/// # Errors
/// [`Error::Usage`] with the range and the number found.
pub fn check_elevation(name: &str, deg: f64) -> Result<()> {
    if deg > 0.0 && deg < 90.0 {
        return Ok(());
    }
    Err(Error::usage(format!("{name}: a number above 0 and below 90 degrees expected, found {deg}")))
}

/// Checks the known angles of a Sun. Messages call them by their options, `--sun-azimuth` and `--sun-elevation`.
///
/// # Errors
/// As [`check_azimuth`] and [`check_elevation`].
pub fn check_sun(sun: KnownSun) -> Result<()> {
    sun.azimuth_deg.map_or(Ok(()), |deg| check_azimuth("--sun-azimuth", deg))?;
    sun.elevation_deg.map_or(Ok(()), |deg| check_elevation("--sun-elevation", deg))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_out_of_range_are_named() {
        let sun = |azimuth_deg, elevation_deg| check_sun(KnownSun { azimuth_deg, elevation_deg });
        for (azimuth_deg, elevation_deg) in
            [(None, None), (Some(-360.0), Some(1e-6)), (Some(360.0), Some(89.999)), (Some(0.0), None)]
        {
            assert!(sun(azimuth_deg, elevation_deg).is_ok(), "{azimuth_deg:?} {elevation_deg:?}");
        }
        for deg in [360.5, -361.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let text = sun(Some(deg), Some(30.0)).unwrap_err().to_string();
            assert_eq!(text, format!("--sun-azimuth: a number from -360 to 360 degrees expected, found {deg}"));
        }
        for deg in [90.0, 0.0, -3.0, 91.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let text = sun(Some(10.0), Some(deg)).unwrap_err().to_string();
            assert_eq!(text, format!("--sun-elevation: a number above 0 and below 90 degrees expected, found {deg}"));
        }
    }
}
