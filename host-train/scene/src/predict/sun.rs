//! The Sun's angles, and what the image's file states of them.

use elunar_base::Result;
use elunar_net::illumination::{KnownSun, LightSource, Lighting};
use elunar_net::sun::{check_azimuth, check_elevation, check_sun};
use elunar_raster::sun::StatedSun;

/// Least difference of an angle that a file states from that of its time that is a contradiction, degrees (our choice).
const CONTRADICTION_DEG: f64 = 2.0;

/// Who says an angle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AngleSource {
    /// The user, or nobody.
    #[default]
    User,
    /// The image's file.
    File,
    /// The Sun at a moment over the image's place.
    Time,
}

/// What is known of the Sun beside the user's angles.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SunEvidence {
    /// The angles of the image's file.
    pub file: StatedSun,
    /// The Sun over the image when it was taken.
    pub timed: StatedSun,
    /// Whether the user told the time, which then comes before the file's angles.
    pub time_is_told: bool,
}

/// The known angles of the Sun, and where they are from.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KnownFrom {
    /// The angles: the user's, else those of a time that the user tells, of the image's file, of the file's time.
    pub sun: KnownSun,
    /// Who says the azimuth.
    pub azimuth_from: AngleSource,
    /// Who says the elevation.
    pub elevation_from: AngleSource,
    /// One line for each angle of the image's file or time that is out of range, which is not used, and for each angle of the file that its
    /// time contradicts.
    pub refused: Vec<String>,
}

impl KnownFrom {
    /// Makes the known angles from those of the user, which come first, and what the file of the image `name` and the time say.
    ///
    /// # Errors
    /// As [`check_sun`] for the user's angles.
    pub fn new(user: KnownSun, name: &str, evidence: SunEvidence) -> Result<Self> {
        check_sun(user)?;
        let SunEvidence { file, timed, time_is_told } = evidence;
        let mut refused = vec![];
        let mut take = |user: Option<f64>, file: Option<f64>, timed: Option<f64>, what: &str, check: Check| {
            let of_file = (AngleSource::File, file, "in the file");
            let of_time = (AngleSource::Time, timed, "at its time");
            let order = if time_is_told { [of_time, of_file] } else { [of_file, of_time] };
            let mut found = (user, AngleSource::User);
            for (source, angle, place) in order {
                let Some(deg) = angle.filter(|_| found.0.is_none()) else { continue };
                match check(&format!("{name}: the Sun's {what} {place} is not used"), deg) {
                    Ok(()) => found = (Some(deg), source),
                    Err(error) => refused.push(error.to_string()),
                }
            }
            if let (AngleSource::File, Some(file), Some(timed)) = (found.1, file, timed)
                && ((file - timed + 180.0).rem_euclid(360.0) - 180.0).abs() > CONTRADICTION_DEG
            {
                refused.push(format!(
                    "{name}: the Sun's {what} in the file is {file:.1} deg, but at its time {timed:.1} deg"
                ));
            }
            found
        };
        let (azimuth_deg, azimuth_from) =
            take(user.azimuth_deg, file.azimuth_deg, timed.azimuth_deg, "azimuth", check_azimuth);
        let (elevation_deg, elevation_from) =
            take(user.elevation_deg, file.elevation_deg, timed.elevation_deg, "elevation", check_elevation);
        let sun = KnownSun { azimuth_deg, elevation_deg };
        Ok(Self { sun, azimuth_from, elevation_from, refused })
    }

    /// Returns the addition to a light in words that says which angles are not the user's; empty if none is, or if the network takes no light.
    #[must_use]
    pub fn origin_of(&self, lighting: &Lighting) -> String {
        if lighting.source == LightSource::NotAsked { String::new() } else { self.origin() }
    }

    fn origin(&self) -> String {
        let from = |source, whose: &str| match (self.azimuth_from == source, self.elevation_from == source) {
            (true, true) => format!(" (azimuth and elevation from {whose})"),
            (true, false) => format!(" (azimuth from {whose})"),
            (false, true) => format!(" (elevation from {whose})"),
            (false, false) => String::new(),
        };
        from(AngleSource::File, "the image's label") + &from(AngleSource::Time, "the image's time")
    }
}

/// A check of an angle that is called so.
type Check = fn(&str, f64) -> Result<()>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_user_comes_first_and_the_file_second() {
        let known = |azimuth_deg, elevation_deg| KnownSun { azimuth_deg, elevation_deg };
        let stated = |azimuth_deg, elevation_deg| StatedSun { azimuth_deg, elevation_deg, time: None };
        let file = |azimuth_deg, elevation_deg| SunEvidence {
            file: stated(azimuth_deg, elevation_deg),
            ..SunEvidence::default()
        };
        let found = |user, file| KnownFrom::new(user, "i.tif", file).unwrap();
        let both = found(known(None, None), file(Some(300.0), Some(20.0)));
        assert_eq!(both.sun, known(Some(300.0), Some(20.0)));
        assert_eq!(both.origin(), " (azimuth and elevation from the image's label)");
        let one = found(known(Some(10.0), None), file(Some(300.0), Some(20.0)));
        assert_eq!(
            (one.sun, one.origin().as_str()),
            (known(Some(10.0), Some(20.0)), " (elevation from the image's label)")
        );
        let user = found(known(Some(10.0), Some(5.0)), file(Some(f64::NAN), Some(-2.0)));
        assert_eq!((user.sun, user.origin().as_str(), user.refused.len()), (known(Some(10.0), Some(5.0)), "", 0));
        let bad = found(known(None, None), file(Some(f64::NAN), Some(-2.0)));
        assert_eq!((bad.sun, bad.origin().as_str()), (known(None, None), ""));
        assert_eq!(bad.refused.len(), 2);
        assert_eq!(
            bad.refused[1],
            "i.tif: the Sun's elevation in the file is not used: a number above 0 and below 90 degrees expected, found -2"
        );
        assert!(KnownFrom::new(known(None, Some(90.0)), "i.tif", file(None, None)).is_err());
        // The time comes after the file's angles, unless the user tells it.
        let timed = |time_is_told| SunEvidence {
            file: stated(None, Some(20.0)),
            timed: stated(Some(100.0), Some(30.0)),
            time_is_told,
        };
        let after = found(known(None, None), timed(false));
        assert_eq!(after.sun, known(Some(100.0), Some(20.0)));
        assert_eq!(after.origin(), " (elevation from the image's label) (azimuth from the image's time)");
        assert_eq!(after.refused, ["i.tif: the Sun's elevation in the file is 20.0 deg, but at its time 30.0 deg"]);
        let before = found(known(None, None), timed(true));
        assert_eq!((before.sun, before.refused.len()), (known(Some(100.0), Some(30.0)), 0));
        let night = found(known(None, None), SunEvidence { timed: stated(Some(9.0), Some(-3.0)), ..timed(true) });
        assert_eq!(night.sun, known(Some(9.0), Some(20.0)));
        assert!(
            night.refused[0].starts_with("i.tif: the Sun's elevation at its time is not used"),
            "{:?}",
            night.refused
        );
    }
}
