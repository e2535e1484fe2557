//! Where the Sun stands: from time and place on the Moon or on Mars.
//!
//! ```
//! use elunar_core::sun::{Body, UtcTime, sub_solar};
//!
//! let time: UtcTime = "2009-08-30T12:00:00".parse()?;
//! let sun = sub_solar(Body::Moon, time).seen_from(26.13, 3.63); // Apollo 15
//! assert!((sun.azimuth_deg - 107.7).abs() < 0.05 && (sun.elevation_deg - 29.9).abs() < 0.05, "{sun:?}");
//! # Ok::<(), elunar_core::sun::TimeError>(())
//! ```
//!
//! From 1960 to 2060 the direction is within 0.02 degrees of JPL's ephemeris DE421 (`core/tests/sun.rs`). Light time and aberration count.

mod mars;
mod moon;
mod time;

pub use time::{TimeError, UtcTime};

/// A body whose sphere and Sun are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Body {
    /// The Moon, in the mean-Earth system.
    Moon,
    /// Mars, in the system of the IAU.
    Mars,
}

impl Body {
    /// Returns the radius of the sphere that maps and heights of the body refer to, metres (IAU working group, 2015).
    #[must_use]
    pub const fn radius_m(self) -> f64 {
        match self {
            Self::Moon => 1_737_400.0,
            Self::Mars => 3_396_190.0,
        }
    }
}

/// The point under the Sun.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubSolarPoint {
    /// Latitude from the body's centre, degrees north.
    pub lat_deg: f64,
    /// Longitude, degrees east, from -180 to 180.
    pub lon_deg: f64,
    /// Distance of the body from the Sun, astronomical units.
    pub distance_au: f64,
}

/// The direction of the Sun's centre at a place of a sphere, without refraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunDirection {
    /// Azimuth, degrees clockwise from north, from 0 to 360.
    pub azimuth_deg: f64,
    /// Elevation, degrees above the horizon; negative at night.
    pub elevation_deg: f64,
}

/// Returns the point under the Sun.
#[must_use]
pub fn sub_solar(body: Body, time: UtcTime) -> SubSolarPoint {
    let point = match body {
        Body::Moon => moon::sub_solar(time),
        Body::Mars => mars::sub_solar(time),
    };
    SubSolarPoint { lon_deg: turned(point.lon_deg + 180.0) - 180.0, ..point }
}

impl SubSolarPoint {
    /// Returns the direction of the Sun at a place: latitude in degrees north, longitude in degrees east.
    #[must_use]
    pub fn seen_from(&self, lat_deg: f64, lon_deg: f64) -> SunDirection {
        let (sun, lat) = (self.lat_deg.to_radians(), lat_deg.to_radians());
        let east = (self.lon_deg - lon_deg).to_radians();
        let toward_east = libm::cos(sun) * libm::sin(east);
        let toward_north = libm::cos(lat) * libm::sin(sun) - libm::sin(lat) * libm::cos(sun) * libm::cos(east);
        let up = libm::sin(lat) * libm::sin(sun) + libm::cos(lat) * libm::cos(sun) * libm::cos(east);
        SunDirection {
            azimuth_deg: turned(libm::atan2(toward_east, toward_north).to_degrees()),
            elevation_deg: libm::atan2(up, libm::hypot(toward_east, toward_north)).to_degrees(),
        }
    }
}

/// Returns an angle as one from 0 to 360 degrees.
fn turned(angle_deg: f64) -> f64 {
    let rest = libm::fmod(angle_deg, 360.0);
    if rest < 0.0 { rest + 360.0 } else { rest }
}

/// Sine of an angle in degrees.
fn sin(angle_deg: f64) -> f64 {
    libm::sin(angle_deg.to_radians())
}

/// Cosine of an angle in degrees.
fn cos(angle_deg: f64) -> f64 {
    libm::cos(angle_deg.to_radians())
}
