//! Map projections as labels name them. PDS3, ISIS and PDS4 have the same names but for case, blanks and underscores.

use super::crs::{ProjectionMethod, ProjectionParameters};
use super::{Axes, Crs};

/// A map projection of a label.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct NamedMap {
    /// The projection's name, as stated.
    pub(crate) name: String,
    /// Latitude of the centre; that of true scale of equirectangular and polar maps.
    pub(crate) lat_deg: f64,
    /// Latitude where y is 0, of equirectangular maps.
    pub(crate) origin_deg: f64,
    /// Longitude of the centre, positive to the east.
    pub(crate) lon_deg: f64,
    /// Scale at the centre.
    pub(crate) scale: f64,
    /// Standard parallels of Lambert's conformal conic projection.
    pub(crate) parallels_deg: Option<[f64; 2]>,
}

impl NamedMap {
    /// Returns the name in capitals, without blanks and underscores.
    pub(crate) fn plain_name(&self) -> String {
        self.name.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_uppercase()).collect()
    }

    /// Returns the reference system on a sphere of this radius.
    ///
    /// # Errors
    /// What is read, and what was found.
    pub(crate) fn crs(&self, radius_m: f64) -> Result<Crs, String> {
        let Self { lat_deg, origin_deg, lon_deg, scale, parallels_deg, .. } = *self;
        let ported =
            |kind| Crs::ported(radius_m, ProjectionParameters::new(kind, lat_deg, lon_deg, scale), Axes::PLAIN);
        let equirectangular = || Crs::equirectangular_from(radius_m, lat_deg, (origin_deg, lon_deg), Axes::PLAIN);
        let crs = match (self.plain_name().as_str(), parallels_deg) {
            _ if !(lat_deg.abs() <= 90.0
                && origin_deg.abs() <= 90.0
                && lon_deg.is_finite()
                && scale > 0.0
                && scale.is_finite()) =>
            {
                None
            }
            ("EQUIRECTANGULAR", _) if lat_deg.abs() < 90.0 && scale == 1.0 => Some(equirectangular()),
            ("SIMPLECYLINDRICAL", _) if lat_deg == 0.0 && scale == 1.0 => Some(equirectangular()),
            ("POLARSTEREOGRAPHIC", _) if lat_deg.abs() == 90.0 || lat_deg != 0.0 && scale == 1.0 => {
                Some(Crs::polar_stereographic(radius_m, lat_deg, scale, lon_deg, Axes::PLAIN))
            }
            ("ORTHOGRAPHIC", _) if scale == 1.0 => Some(ported(ProjectionMethod::Orthographic)),
            ("TRANSVERSEMERCATOR", _) if lat_deg.abs() < 90.0 => Some(ported(ProjectionMethod::TransverseMercator)),
            ("MERCATOR", _) if lat_deg == 0.0 => Some(ported(ProjectionMethod::Mercator)),
            ("SINUSOIDAL", _) if lat_deg == 0.0 && scale == 1.0 => Some(ported(ProjectionMethod::Sinusoidal)),
            ("LAMBERTCONFORMAL" | "LAMBERTCONFORMALCONIC", Some(parallels_deg)) if scale == 1.0 => {
                let kind = ProjectionMethod::LambertConformal;
                let of_map = ProjectionParameters::new(kind, lat_deg, lon_deg, 1.0);
                Some(Crs::ported(radius_m, ProjectionParameters { parallels_deg, ..of_map }, Axes::PLAIN))
            }
            _ => None,
        };
        crs.ok_or_else(|| {
            let read = "equirectangular, polar stereographic (centre off the equator), orthographic, transverse Mercator, \
                        Lambert conformal, and simple cylindrical, Mercator and sinusoidal (centre on the equator) are read";
            format!("projection {}, centre latitude {lat_deg}, scale {scale}; {read}", self.name)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Projection;

    #[test]
    fn maps_are_read_with_the_parameters_that_they_have() {
        let cone = Some([20.0, 60.0]);
        let far = f64::INFINITY;
        // Name, centre latitude, latitude of the origin, longitude, scale, parallels; whether it is read.
        for (name, lat_deg, origin_deg, lon_deg, scale, parallels_deg, is_read) in [
            ("Equirectangular", 20.0, 5.0, 10.0, 1.0, None, true),
            ("EQUIRECTANGULAR", 90.0, 0.0, 10.0, 1.0, None, false),
            ("EQUIRECTANGULAR", 20.0, 0.0, 10.0, 0.9, None, false),
            ("EQUIRECTANGULAR", 95.0, 0.0, 10.0, 1.0, None, false),
            ("EQUIRECTANGULAR", 20.0, -95.0, 10.0, 1.0, None, false),
            ("EQUIRECTANGULAR", 20.0, 0.0, far, 1.0, None, false),
            ("EQUIRECTANGULAR", 20.0, 0.0, 10.0, far, None, false),
            ("SIMPLE_CYLINDRICAL", 0.0, 0.0, 10.0, 1.0, None, true),
            ("SIMPLE_CYLINDRICAL", 20.0, 0.0, 10.0, 1.0, None, false),
            ("SIMPLE_CYLINDRICAL", 0.0, 0.0, 10.0, 0.9, None, false),
            ("POLAR STEREOGRAPHIC", -90.0, 0.0, 10.0, 0.9, None, true),
            ("PolarStereographic", 70.0, 0.0, 10.0, 1.0, None, true),
            ("PolarStereographic", 70.0, 0.0, 10.0, 0.9, None, false),
            ("PolarStereographic", 0.0, 0.0, 10.0, 1.0, None, false),
            ("Orthographic", 70.0, 0.0, 10.0, 1.0, None, true),
            ("Orthographic", 70.0, 0.0, 10.0, 0.9, None, false),
            ("TransverseMercator", 70.0, 0.0, 10.0, 0.9, None, true),
            ("TransverseMercator", 90.0, 0.0, 10.0, 0.9, None, false),
            ("TransverseMercator", 70.0, 0.0, 10.0, 0.0, None, false),
            ("Mercator", 0.0, 0.0, 10.0, 0.9, None, true),
            ("Mercator", 10.0, 0.0, 10.0, 0.9, None, false),
            ("Sinusoidal", 0.0, 0.0, 10.0, 1.0, None, true),
            ("Sinusoidal", 10.0, 0.0, 10.0, 1.0, None, false),
            ("Sinusoidal", 0.0, 0.0, 10.0, 0.9, None, false),
            ("LambertConformal", 40.0, 0.0, 10.0, 1.0, cone, true),
            ("Lambert Conformal Conic", 40.0, 0.0, 10.0, 0.9, cone, false),
            ("LambertConformal", 40.0, 0.0, 10.0, 1.0, None, false),
            ("Gnomonic", 40.0, 0.0, 10.0, 1.0, None, false),
        ] {
            let map = NamedMap { name: name.into(), lat_deg, origin_deg, lon_deg, scale, parallels_deg };
            match map.crs(1_737_400.0) {
                Ok(crs) => assert!(is_read && Projection::of(&crs).is_some(), "{map:?}"),
                Err(what) => {
                    let found = format!("projection {name}, centre latitude {lat_deg}, scale {scale}; ");
                    assert!(!is_read && what.starts_with(&found), "{map:?}: {what}");
                }
            }
        }
    }
}
