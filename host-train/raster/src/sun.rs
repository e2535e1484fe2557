//! The Sun's direction as an image's file states it, and from its time and place.

use super::source::Info;
use super::{GeoRef, Projection};
use elunar_core::sun::{Body, UtcTime, sub_solar};

/// Angles of the Sun that a file states, degrees, as stated: they may be out of range, and NaN is something other than a number.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StatedSun {
    /// Azimuth, clockwise from the raster's up.
    pub azimuth_deg: Option<f64>,
    /// Elevation above the horizon.
    pub elevation_deg: Option<f64>,
    /// When the image was taken.
    pub time: Option<UtcTime>,
}

/// Spheres that bodies' maps have, metres.
const SPHERES_M: [(Body, std::ops::RangeInclusive<f64>); 2] =
    [(Body::Moon, 1_736_000.0..=1_739_000.0), (Body::Mars, 3_376_000.0..=3_397_000.0)];

/// A step towards the Sun, radians of the sphere: a hundred metres of the Moon.
const STEP: f64 = 6e-5;

impl StatedSun {
    /// Reads an item of a file's metadata, if it states the Sun: `SUN_AZIMUTH_DEG`, `SUN_ELEVATION_DEG`, `IMAGE_TIME`, `START_TIME`.
    pub(crate) fn add(&mut self, key: &str, text: &str) {
        let angle = || Some(text.trim().parse().unwrap_or(f64::NAN));
        match key {
            "SUN_AZIMUTH_DEG" => self.azimuth_deg = angle(),
            "SUN_ELEVATION_DEG" => self.elevation_deg = angle(),
            "IMAGE_TIME" | "START_TIME" => self.time = self.time.or(text.parse().ok()),
            _ => {}
        }
    }

    /// Returns these angles, and those of `other` where there is none.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            azimuth_deg: self.azimuth_deg.or(other.azimuth_deg),
            elevation_deg: self.elevation_deg.or(other.elevation_deg),
            time: self.time.or(other.time),
        }
    }

    /// Returns the Sun over the centre of a raster at a moment; the azimuth is clockwise from the raster's up, so the grid's convergence counts.
    /// `None` if the raster has no place on the Moon or on Mars.
    #[must_use]
    pub fn at_time(info: &Info, time: UtcTime) -> Option<Self> {
        let georef = info.georef.as_ref()?;
        let body = body_of(georef)?;
        let projection = Projection::of(&georef.crs)?;
        let (x, y) = georef.centre((info.rows as f64 - 1.0) / 2.0, (info.cols as f64 - 1.0) / 2.0);
        let (lon_deg, lat_deg) = projection.inverse(x, y);
        let sun = sub_solar(body, time).seen_from(lat_deg, lon_deg);
        let (lon, lat) = step(lon_deg, lat_deg, sun.azimuth_deg);
        let towards = projection.forward(lon, lat);
        let azimuth_deg = azimuth(georef, (info.rows, info.cols), (towards.0 - x, towards.1 - y))?;
        Some(Self { azimuth_deg: Some(azimuth_deg), elevation_deg: Some(sun.elevation_deg), time: Some(time) })
    }
}

/// Returns the body of a raster's map.
#[must_use]
pub fn body_of(georef: &GeoRef) -> Option<Body> {
    let radius_m = georef.crs.sphere_radius_m()?;
    SPHERES_M.into_iter().find(|(_, radii)| radii.contains(&radius_m)).map(|(body, _)| body)
}

/// Returns the direction of north at the centre of a raster of `rows` x `cols`, degrees clockwise from the raster's up. `None` without a place.
#[must_use]
pub fn north_deg(georef: &GeoRef, rows: usize, cols: usize) -> Option<f64> {
    let projection = Projection::of(&georef.crs)?;
    let (x, y) = georef.centre((rows as f64 - 1.0) / 2.0, (cols as f64 - 1.0) / 2.0);
    let (lon_deg, lat_deg) = projection.inverse(x, y);
    let towards = projection.forward(lon_deg, lat_deg + STEP.to_degrees());
    azimuth(georef, (rows, cols), (towards.0 - x, towards.1 - y))
}

/// Returns longitude and latitude a [`STEP`] along an azimuth from a place, all in degrees.
fn step(lon_deg: f64, lat_deg: f64, azimuth_deg: f64) -> (f64, f64) {
    let (lat, azimuth) = (lat_deg.to_radians(), azimuth_deg.to_radians());
    let up = lat.sin() * STEP.cos() + lat.cos() * STEP.sin() * azimuth.cos();
    let east = (azimuth.sin() * STEP.sin()).atan2(lat.cos() * STEP.cos() - lat.sin() * STEP.sin() * azimuth.cos());
    (lon_deg + east.to_degrees(), up.asin().to_degrees())
}

/// Returns the azimuth of a small step on the map, degrees clockwise from the raster's up, on square metres.
fn azimuth(georef: &GeoRef, (rows, cols): (usize, usize), (x, y): (f64, f64)) -> Option<f64> {
    let (row_m, col_m) = georef.pixel_m(rows, cols)?;
    let [_, t1, t2, _, t4, t5] = georef.transform;
    let area = t1 * t5 - t2 * t4;
    let (right, up) = ((x * t5 - y * t2) / area * col_m, -(y * t1 - x * t4) / area * row_m);
    let azimuth_deg = right.atan2(up).to_degrees().rem_euclid(360.0);
    azimuth_deg.is_finite().then_some(azimuth_deg)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Crs;

    fn info(srs: &str, transform: [f64; 6]) -> Info {
        let georef = GeoRef { transform, crs: Crs::parse(srs).unwrap() };
        Info { rows: 101, cols: 101, georef: Some(georef), ..Info::default() }
    }

    fn angles(srs: &str, transform: [f64; 6]) -> (f64, f64) {
        let time = "2009-08-30T12:00:00".parse().unwrap();
        let sun = StatedSun::at_time(&info(srs, transform), time).unwrap();
        (sun.azimuth_deg.unwrap(), sun.elevation_deg.unwrap())
    }

    /// Apollo 15: 107.71 degrees clockwise from north and 29.92 high by the ephemeris (`core/fixtures/sun.py`).
    #[test]
    fn the_azimuth_counts_from_the_grids_up() {
        let (lat, lon, pixel): (f64, f64, f64) = (26.13, 3.63, 2.0);
        let metres = 1_737_400.0f64.to_radians();
        let near = |found: (f64, f64), azimuth_deg: f64| {
            let off = (found.0 - azimuth_deg + 180.0).rem_euclid(360.0) - 180.0;
            assert!(off.abs() < 0.05 && (found.1 - 29.92).abs() < 0.05, "{found:?}, {azimuth_deg} expected");
        };
        // Degrees, and a map whose north is up.
        let degree = pixel / metres;
        near(angles("IAU_2015:30100", [lon - 50.5 * degree, degree, 0.0, lat + 50.5 * degree, 0.0, -degree]), 107.71);
        let local = format!("+proj=eqc +lat_ts={lat} +lat_0=0 +lon_0=0 +R=1737400");
        let (x, y) = (lon * metres * lat.to_radians().cos(), lat * metres);
        near(angles(&local, [x - 101.0, pixel, 0.0, y + 101.0, 0.0, -pixel]), 107.71);
        // South up and east left: the raster is turned by half a turn.
        near(angles(&local, [x + 101.0, -pixel, 0.0, y - 101.0, 0.0, pixel]), 287.71);
        // About the north pole meridians run outwards: north is up on the meridian of 180 degrees, and turned by the longitude elsewhere.
        let polar = "+proj=stere +lat_0=90 +lon_0=0 +R=1737400";
        let rho = 2.0 * 1_737_400.0 * (std::f64::consts::FRAC_PI_4 - lat.to_radians() / 2.0).tan();
        let (sin, cos) = lon.to_radians().sin_cos();
        let georef = info(polar, [rho * sin, pixel, 0.0, -rho * cos, 0.0, -pixel]).georef.unwrap();
        let north_deg = north_deg(&georef, 1, 1).unwrap();
        assert!((north_deg - (360.0 - lon)).abs() < 0.01, "{north_deg}");
        near(angles(polar, [rho * sin - 101.0, pixel, 0.0, -rho * cos + 101.0, 0.0, -pixel]), 107.71 - lon);
    }

    #[test]
    fn a_raster_without_a_place_has_no_sun() {
        let time = "2009-08-30T12:00:00".parse().unwrap();
        assert_eq!(StatedSun::at_time(&Info { rows: 1, cols: 1, ..Info::default() }, time), None);
        let earth = info("+proj=longlat +R=6371000", [0.0, 1e-5, 0.0, 0.0, 0.0, -1e-5]);
        assert_eq!(StatedSun::at_time(&earth, time), None);
    }
}
