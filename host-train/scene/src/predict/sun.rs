//! The Sun's angles, and what the image's file states of them.

use elunar_base::Result;
use elunar_net::illumination::{KnownSun, LightSource, Lighting};
use elunar_net::sun::{check_azimuth, check_elevation, check_sun};
use elunar_raster::sun::StatedSun;

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
}
