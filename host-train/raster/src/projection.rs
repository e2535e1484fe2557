//! Conversion between longitude and latitude and map coordinates, on a sphere.
//!
//! The formulas are Snyder's (*Map Projections: A Working Manual*, USGS 1395, 1987): 12-1 and 12-2 with the standard parallel for the
//! equirectangular, 21-5 to 21-14 for the polar stereographic projection. The others are those of `proj4rs`. Tests compare all with PROJ.

mod named;
mod ported;
mod text;

#[cfg(test)]
mod tests;

use super::Crs;
use super::crs::{ProjectionParameters, code, key};
use ported::Ported;
use std::f64::consts::FRAC_PI_4;

/// A supported system: longitude and latitude, equirectangular, stereographic, orthographic, Mercator, transverse Mercator, sinusoidal, or
/// Lambert conformal conic, on a sphere.
#[derive(Debug, Clone, PartialEq)]
pub struct Projection {
    radius_m: f64,
    method: Method,
    /// Metres per map unit.
    unit_m: f64,
    /// Added to x and y, map units.
    false_origin: (f64, f64),
}

#[derive(Debug, Clone, PartialEq)]
enum Method {
    Geographic,
    Equirectangular {
        lat_ts_deg: f64,
        cos_lat_ts: f64,
        lat0_deg: f64,
        lon0_deg: f64,
    },
    /// `scale` is the scale at the pole; `sign` is -1 in the south.
    PolarStereographic {
        sign: f64,
        scale: f64,
        lon0_deg: f64,
    },
    Ported(Ported),
}

/// A point without a position.
const NOWHERE: (f64, f64) = (f64::NAN, f64::NAN);

impl Projection {
    /// Returns the projection of `crs`; `None` for other projections, for ellipsoids, and for prime meridians other than the body's own.
    #[must_use]
    pub fn of(crs: &Crs) -> Option<Self> {
        let number = |key| crs.number(key);
        let or = |default: f64, keys: &[u16]| keys.iter().find_map(|&key| crs.number(key)).unwrap_or(default);
        let radius_m = crs.sphere_radius_m().filter(|&radius_m| radius_m > 0.0 && radius_m.is_finite())?;
        if !crs.is_in_degrees() || or(0.0, &[key::PRIME_MERIDIAN_LON]) != 0.0 {
            return None;
        }
        if crs.is_geographic() {
            return Some(Self { radius_m, method: Method::Geographic, unit_m: 1.0, false_origin: (0.0, 0.0) });
        }
        let unit_m = crs.metres_per_unit().filter(|unit| unit.is_finite())?;
        let lon0_deg = or(0.0, &[key::STRAIGHT_POLE_LON, key::CENTRE_LON, key::NAT_ORIGIN_LON, key::FALSE_ORIGIN_LON]);
        let lat0_deg = or(0.0, &[key::CENTRE_LAT, key::NAT_ORIGIN_LAT, key::FALSE_ORIGIN_LAT]);
        let scale = or(1.0, &[key::SCALE]);
        let number = number(key::METHOD)?;
        let is = |method: u16| number == f64::from(method);
        let method = if is(code::EQUIRECTANGULAR) {
            let lat_ts_deg = or(0.0, &[key::STD_PARALLEL_1]);
            Method::Equirectangular { lat_ts_deg, cos_lat_ts: lat_ts_deg.to_radians().cos(), lat0_deg, lon0_deg }
        } else if is(code::POLAR_STEREOGRAPHIC) && lat0_deg != 0.0 {
            // The latitude is that of true scale, as GDAL writes and reads this key. At the pole itself, the scale is stated.
            let true_scale = 0.5 * (1.0 + lat0_deg.abs().to_radians().sin());
            Method::PolarStereographic { sign: lat0_deg.signum(), scale: scale * true_scale, lon0_deg }
        } else if is(code::STEREOGRAPHIC) && lat0_deg.abs() == 90.0 {
            Method::PolarStereographic { sign: lat0_deg.signum(), scale, lon0_deg }
        } else {
            Method::Ported(Ported::new(radius_m, ProjectionParameters::of(crs)?)?)
        };
        let false_origin = (
            or(0.0, &[key::FALSE_EASTING, key::FALSE_ORIGIN_EASTING, key::CENTRE_EASTING]),
            or(0.0, &[key::FALSE_NORTHING, key::FALSE_ORIGIN_NORTHING, key::CENTRE_NORTHING]),
        );
        let projection = Self { radius_m, method, unit_m, false_origin };
        projection.is_usable().then_some(projection)
    }

    /// Returns the radius of the sphere, metres.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        self.radius_m
    }

    /// Returns the period of x in map units: 360 degrees in geographic, equirectangular and Mercator maps; `None` in others.
    #[must_use]
    pub fn period(&self) -> Option<f64> {
        match &self.method {
            Method::Geographic => Some(360.0),
            Method::Equirectangular { cos_lat_ts, .. } => {
                Some(std::f64::consts::TAU * self.radius_m * cos_lat_ts / self.unit_m)
            }
            Method::PolarStereographic { .. } => None,
            Method::Ported(ported) => ported.period_m().map(|period_m| period_m / self.unit_m),
        }
    }

    /// Returns the map coordinates of a point. In all projected maps, longitudes are brought to within 180 degrees of the central meridian,
    /// as in PROJ; geographic maps leave them unchanged. NaN for latitudes beyond a pole, and for points that the map cannot show: the other
    /// pole of a polar map, the far side of an orthographic one, the poles of a Mercator map.
    #[must_use]
    pub fn forward(&self, lon_deg: f64, lat_deg: f64) -> (f64, f64) {
        if lat_deg.is_nan() || lat_deg.abs() > 90.0 {
            return NOWHERE;
        }
        let (x_m, y_m) = match self.method {
            Method::Geographic => return (lon_deg, lat_deg),
            Method::Ported(ref ported) => ported.forward(lon_deg, lat_deg),
            Method::Equirectangular { cos_lat_ts, lat0_deg, lon0_deg, .. } => {
                let lon = wrapped(lon_deg - lon0_deg).to_radians();
                (self.radius_m * cos_lat_ts * lon, self.radius_m * (lat_deg - lat0_deg).to_radians())
            }
            Method::PolarStereographic { sign, scale, lon0_deg } => {
                if lat_deg * sign <= -90.0 {
                    return NOWHERE;
                }
                let rho_m = 2.0 * self.radius_m * scale * (FRAC_PI_4 - 0.5 * sign * lat_deg.to_radians()).tan();
                let (sin, cos) = (lon_deg - lon0_deg).to_radians().sin_cos();
                (rho_m * sin, -sign * rho_m * cos)
            }
        };
        (x_m / self.unit_m + self.false_origin.0, y_m / self.unit_m + self.false_origin.1)
    }

    /// Returns longitude and latitude, degrees, of map coordinates. The longitude is within -180 and 180 for projected maps, unchanged for
    /// geographic ones. NaN where no such point exists.
    #[must_use]
    pub fn inverse(&self, x: f64, y: f64) -> (f64, f64) {
        let (x_m, y_m) = ((x - self.false_origin.0) * self.unit_m, (y - self.false_origin.1) * self.unit_m);
        let (lon_deg, lat_deg) = match self.method {
            Method::Geographic => (x, y),
            Method::Ported(ref ported) => ported.inverse(x_m, y_m),
            Method::Equirectangular { cos_lat_ts, lat0_deg, lon0_deg, .. } => {
                let lon_deg = lon0_deg + (x_m / (self.radius_m * cos_lat_ts)).to_degrees();
                (wrapped(lon_deg), lat0_deg + (y_m / self.radius_m).to_degrees())
            }
            Method::PolarStereographic { sign, scale, lon0_deg } => {
                let rho = x_m.hypot(y_m) / (2.0 * self.radius_m * scale);
                // At the pole every longitude is valid. The central one is taken.
                let lon_deg = if rho == 0.0 { lon0_deg } else { lon0_deg + x_m.atan2(-sign * y_m).to_degrees() };
                (wrapped(lon_deg), sign * (90.0 - 2.0 * rho.atan().to_degrees()))
            }
        };
        // By rounding, the row of the pole may lie slightly beyond it.
        let beyond = lat_deg.abs() - 90.0;
        if beyond > 1e-9 || !lon_deg.is_finite() || !lat_deg.is_finite() {
            return NOWHERE;
        }
        (lon_deg, lat_deg.clamp(-90.0, 90.0))
    }

    /// Returns whether both give the same coordinates (to 1e-9 of a degree or of the sphere).
    #[must_use]
    pub fn same_as(&self, other: &Self) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * a.abs().max(b.abs()).max(1.0);
        let same_lon = |a: f64, b: f64| wrapped(a - b).abs() <= 1e-9;
        let same_method = match (&self.method, &other.method) {
            (Method::Geographic, Method::Geographic) => true,
            (
                &Method::Equirectangular { cos_lat_ts, lat0_deg, lon0_deg, .. },
                &Method::Equirectangular { cos_lat_ts: cos, lat0_deg: lat, lon0_deg: lon, .. },
            ) => near(cos_lat_ts, cos) && near(lat0_deg, lat) && same_lon(lon0_deg, lon),
            (
                &Method::PolarStereographic { sign, scale, lon0_deg },
                &Method::PolarStereographic { sign: pole, scale: k, lon0_deg: lon },
            ) => sign == pole && near(scale, k) && same_lon(lon0_deg, lon),
            (Method::Ported(a), Method::Ported(b)) => {
                let (a, b) = (a.parameters(), b.parameters());
                let same = near(a.lat0_deg, b.lat0_deg) && same_lon(a.lon0_deg, b.lon0_deg) && near(a.scale, b.scale);
                a.kind == b.kind && same && (0..2).all(|i| near(a.parallels_deg[i], b.parallels_deg[i]))
            }
            _ => false,
        };
        same_method
            && near(self.radius_m, other.radius_m)
            && near(self.unit_m, other.unit_m)
            && near(self.false_origin.0, other.false_origin.0)
            && near(self.false_origin.1, other.false_origin.1)
    }

    /// Returns whether the numbers are valid. A broken file may hold numbers that make every coordinate meaningless.
    fn is_usable(&self) -> bool {
        let sound = match self.method {
            Method::Geographic | Method::Ported(_) => true,
            Method::Equirectangular { cos_lat_ts, lat0_deg, lon0_deg, .. } => {
                cos_lat_ts > 1e-9 && lat0_deg.abs() <= 90.0 && lon0_deg.is_finite()
            }
            Method::PolarStereographic { scale, lon0_deg, .. } => {
                scale > 0.0 && scale.is_finite() && lon0_deg.is_finite()
            }
        };
        sound && self.false_origin.0.is_finite() && self.false_origin.1.is_finite()
    }
}

/// Brings a longitude into -180..=180, PROJ's range. A longitude within the range stays unchanged, bit for bit.
fn wrapped(lon_deg: f64) -> f64 {
    if lon_deg.abs() <= 180.0 { lon_deg } else { (lon_deg + 180.0).rem_euclid(360.0) - 180.0 }
}
