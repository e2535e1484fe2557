//! The Sun's angles: their ranges, and what the image's file states of them.

use elunar_base::{Error, Result};
use elunar_net::illumination::{KnownSun, LightSource, Lighting};
use elunar_raster::sun::StatedSun;

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

/// The known angles of the Sun, and where they are from.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KnownFrom {
    /// The angles: the user's, else those of the image's file.
    pub sun: KnownSun,
    /// Whether the azimuth is from the image's file.
    pub azimuth_from_file: bool,
    /// Whether the elevation is from the image's file.
    pub elevation_from_file: bool,
    /// One line for each angle of the image's file that is out of range. It is not used.
    pub refused: Vec<String>,
}

impl KnownFrom {
    /// Makes the known angles from those of the user, which come first, and those that the file of the image `name` states.
    ///
    /// # Errors
    /// As [`check_sun`] for the user's angles.
    pub fn new(user: KnownSun, name: &str, file: StatedSun) -> Result<Self> {
        check_sun(user)?;
        let mut refused = vec![];
        let mut take = |user: Option<f64>, file: Option<f64>, what: &str, check: fn(&str, f64) -> Result<()>| {
            let file = file.filter(|_| user.is_none());
            let found = file.map(|deg| check(&format!("{name}: the Sun's {what} in the file is not used"), deg));
            let usable = matches!(found, Some(Ok(())));
            refused.extend(found.and_then(Result::err).map(|error| error.to_string()));
            (user.or(file.filter(|_| usable)), usable)
        };
        let (azimuth_deg, azimuth_from_file) = take(user.azimuth_deg, file.azimuth_deg, "azimuth", check_azimuth);
        let (elevation_deg, elevation_from_file) =
            take(user.elevation_deg, file.elevation_deg, "elevation", check_elevation);
        let sun = KnownSun { azimuth_deg, elevation_deg };
        Ok(Self { sun, azimuth_from_file, elevation_from_file, refused })
    }

    /// Returns the addition to a light in words that says which angles are from the image's file; empty if none is, or if the network takes
    /// no light.
    #[must_use]
    pub fn origin_of(&self, lighting: &Lighting) -> &'static str {
        if lighting.source == LightSource::NotAsked { "" } else { self.origin() }
    }

    fn origin(&self) -> &'static str {
        match (self.azimuth_from_file, self.elevation_from_file) {
            (true, true) => " (azimuth and elevation from the image's label)",
            (true, false) => " (azimuth from the image's label)",
            (false, true) => " (elevation from the image's label)",
            (false, false) => "",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_user_comes_first_and_the_file_second() {
        let known = |azimuth_deg, elevation_deg| KnownSun { azimuth_deg, elevation_deg };
        let file = |azimuth_deg, elevation_deg| StatedSun { azimuth_deg, elevation_deg };
        let found = |user, file| KnownFrom::new(user, "i.tif", file).unwrap();
        let both = found(known(None, None), file(Some(300.0), Some(20.0)));
        assert_eq!(both.sun, known(Some(300.0), Some(20.0)));
        assert_eq!(both.origin(), " (azimuth and elevation from the image's label)");
        let one = found(known(Some(10.0), None), file(Some(300.0), Some(20.0)));
        assert_eq!((one.sun, one.origin()), (known(Some(10.0), Some(20.0)), " (elevation from the image's label)"));
        let user = found(known(Some(10.0), Some(5.0)), file(Some(f64::NAN), Some(-2.0)));
        assert_eq!((user.sun, user.origin(), user.refused.len()), (known(Some(10.0), Some(5.0)), "", 0));
        let bad = found(known(None, None), file(Some(f64::NAN), Some(-2.0)));
        assert_eq!((bad.sun, bad.origin()), (known(None, None), ""));
        assert_eq!(bad.refused.len(), 2);
        assert_eq!(
            bad.refused[1],
            "i.tif: the Sun's elevation in the file is not used: a number above 0 and below 90 degrees expected, found -2"
        );
        assert!(KnownFrom::new(known(None, Some(90.0)), "i.tif", file(None, None)).is_err());
    }

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
