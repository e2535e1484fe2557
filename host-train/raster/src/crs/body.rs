//! The body of a system: a sphere or an ellipsoid.

use super::{Crs, key};

/// Smallest and greatest semi-axis of a body, metres: beyond any that is mapped (our choice).
const AXES_M: std::ops::RangeInclusive<f64> = 1.0..=1e9;

/// Greatest ratio of the semi-axes (our choice). That of Vesta is 1.3.
const FLATTEST: f64 = 2.0;

/// Returns whether these are the semi-axes of a body, metres.
pub(super) fn is_sound((major_m, minor_m): (f64, f64)) -> bool {
    AXES_M.contains(&major_m)
        && AXES_M.contains(&minor_m)
        && major_m <= FLATTEST * minor_m
        && minor_m <= FLATTEST * major_m
}

impl Crs {
    /// Returns the radius of the reference body, metres, if the keys give a sphere.
    #[must_use]
    pub fn sphere_radius_m(&self) -> Option<f64> {
        let (major, minor) = self.axes_m()?;
        (major == minor).then_some(major)
    }

    /// Returns the semi-axes of the body, metres.
    pub(super) fn axes_m(&self) -> Option<(f64, f64)> {
        let major = self.number(key::SEMI_MAJOR)?;
        let minor = self.number(key::SEMI_MINOR).or_else(|| {
            let inverse = self.number(key::INV_FLATTENING).filter(|&f| f != 0.0)?;
            Some(major * (1.0 - 1.0 / inverse))
        });
        Some((major, minor.unwrap_or(major)))
    }

    /// Returns what is wrong with a body that cannot be one.
    pub(super) fn defect_of_body(&self) -> Option<String> {
        let (major, minor) = self.axes_m().filter(|&axes| !is_sound(axes))?;
        let (least, most) = (AXES_M.start(), AXES_M.end());
        Some(format!(
            "semi-axes of a body expected ({least} to {most:e} m, flattened by less than a half), found {major} m and {minor} m"
        ))
    }

    /// Returns whether the body is the Earth: a system that only EPSG's numbers state, or axes within 1 % of the Earth's.
    pub(super) fn is_of_the_earth(&self) -> bool {
        match self.axes_m() {
            Some((major, _)) => (major / 6.378e6 - 1.0).abs() < 0.01,
            None => self.epsg().is_some(),
        }
    }

    /// Returns the number of a system, datum or ellipsoid of EPSG, of which all are the Earth's.
    pub(super) fn epsg(&self) -> Option<u16> {
        let code = |key| self.number(key).filter(|&code| (1024.0..32767.0).contains(&code)).map(|code| code as u16);
        [key::PROJECTED_CRS, key::GEODETIC_CRS, key::DATUM, key::ELLIPSOID].into_iter().find_map(code)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::sun::Body;

    #[test]
    fn absurd_bodies_have_a_defect() {
        let with = |major: f64, second: u16, value: f64| Crs {
            directory: vec![1, 1, 0, 3, 1024, 0, 1, 2, 2057, 34736, 1, 0, second, 34736, 1, 1],
            doubles: vec![major, value],
            ascii: String::new(),
        };
        for (major, second, value) in [
            (f64::INFINITY, 2058, f64::INFINITY),
            (f64::NAN, 2058, f64::NAN),
            (0.0, 2058, 0.0),
            (-Body::Moon.radius_m(), 2058, -Body::Moon.radius_m()),
            (1e300, 2058, 1e300),
            (1e-300, 2058, 1e-300),
            (Body::Moon.radius_m(), 2058, 1.0),
            (Body::Moon.radius_m(), 2058, 4.0 * Body::Moon.radius_m()),
            (Body::Moon.radius_m(), 2059, 1.0),
            (Body::Moon.radius_m(), 2059, 0.5),
            (Body::Moon.radius_m(), 2059, f64::NAN),
        ] {
            let defect = with(major, second, value).defect();
            assert!(defect.as_ref().is_some_and(|d| d.contains("semi-axes")), "{major} {second} {value}: {defect:?}");
        }
        for (major, second, value) in [
            (Body::Moon.radius_m(), 2058, Body::Moon.radius_m()),
            (Body::Moon.radius_m(), 2059, 0.0),
            (3_396_190.0, 2058, 3_376_200.0),
            (6_378_137.0, 2059, 298.257),
            (286_300.0, 2058, 223_200.0),
            (Body::Moon.radius_m(), 2059, f64::INFINITY),
        ] {
            assert_eq!(with(major, second, value).defect(), None, "{major} {second} {value}");
        }
    }
}
