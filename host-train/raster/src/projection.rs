//! Conversion between longitude and latitude and map coordinates, on a sphere.
//!
//! The formulas are Snyder's (*Map Projections: A Working Manual*, USGS 1395, 1987): 12-1 and 12-2 with the standard parallel for the
//! equirectangular, 21-5 to 21-14 for the polar stereographic projection. Tests compare them with PROJ.

use super::Crs;
use super::crs::{code, key};
use std::f64::consts::FRAC_PI_4;

/// A supported system: longitude and latitude, equirectangular, or polar stereographic, on a sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    radius_m: f64,
    method: Method,
    /// Metres per map unit.
    unit_m: f64,
    /// Added to x and y, map units.
    false_origin: (f64, f64),
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Method {
    Geographic,
    Equirectangular {
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
}

impl Projection {
    /// Returns the projection of `crs`; `None` for other projections, for ellipsoids, and for prime meridians other than the body's own.
    #[must_use]
    pub fn of(crs: &Crs) -> Option<Self> {
        let number = |key| crs.number(key);
        let or = |default: f64, keys: &[u16]| keys.iter().find_map(|&key| crs.number(key)).unwrap_or(default);
        let radius_m = crs.sphere_radius_m().filter(|&radius_m| radius_m > 0.0 && radius_m.is_finite())?;
        let in_degrees = number(key::ANGULAR_UNIT).is_none_or(|unit| unit == f64::from(code::DEGREE));
        if !in_degrees || or(0.0, &[key::PRIME_MERIDIAN_LON]) != 0.0 {
            return None;
        }
        if number(key::MODEL_TYPE) == Some(f64::from(code::GEOGRAPHIC)) {
            return Some(Self { radius_m, method: Method::Geographic, unit_m: 1.0, false_origin: (0.0, 0.0) });
        }
        let unit_m = crs.metres_per_unit().filter(|unit| unit.is_finite())?;
        let lon0_deg = or(0.0, &[key::STRAIGHT_POLE_LON, key::CENTRE_LON, key::NAT_ORIGIN_LON, key::FALSE_ORIGIN_LON]);
        let lat0_deg = or(0.0, &[key::CENTRE_LAT, key::NAT_ORIGIN_LAT, key::FALSE_ORIGIN_LAT]);
        let scale = or(1.0, &[key::SCALE]);
        let number = number(key::METHOD)?;
        let is = |method: u16| number == f64::from(method);
        let method = if is(code::EQUIRECTANGULAR) {
            let cos_lat_ts = or(0.0, &[key::STD_PARALLEL_1]).to_radians().cos();
            Method::Equirectangular { cos_lat_ts, lat0_deg, lon0_deg }
        } else if is(code::POLAR_STEREOGRAPHIC) && lat0_deg != 0.0 {
            // The latitude is that of true scale, as GDAL writes and reads this key. At the pole itself, the scale is stated.
            let true_scale = 0.5 * (1.0 + lat0_deg.abs().to_radians().sin());
            Method::PolarStereographic { sign: lat0_deg.signum(), scale: scale * true_scale, lon0_deg }
        } else if is(code::STEREOGRAPHIC) && lat0_deg.abs() == 90.0 {
            Method::PolarStereographic { sign: lat0_deg.signum(), scale, lon0_deg }
        } else {
            return None;
        };
        let false_origin = (or(0.0, &[key::FALSE_EASTING]), or(0.0, &[key::FALSE_NORTHING]));
        let projection = Self { radius_m, method, unit_m, false_origin };
        projection.is_usable().then_some(projection)
    }

    /// Returns the radius of the sphere, metres.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        self.radius_m
    }

    /// Returns the period of x in map units: 360 degrees in geographic and equirectangular maps; `None` in polar maps.
    #[must_use]
    pub fn period(&self) -> Option<f64> {
        match self.method {
            Method::Geographic => Some(360.0),
            Method::Equirectangular { cos_lat_ts, .. } => {
                Some(std::f64::consts::TAU * self.radius_m * cos_lat_ts / self.unit_m)
            }
            Method::PolarStereographic { .. } => None,
        }
    }

    /// Returns the map coordinates of a point. In equirectangular maps, longitudes are brought to within 180 degrees of the central
    /// meridian, as in PROJ; geographic maps leave them unchanged. NaN for latitudes beyond a pole, and for the pole that a polar map
    /// cannot show.
    #[must_use]
    pub fn forward(&self, lon_deg: f64, lat_deg: f64) -> (f64, f64) {
        if lat_deg.is_nan() || lat_deg.abs() > 90.0 {
            return (f64::NAN, f64::NAN);
        }
        let (x_m, y_m) = match self.method {
            Method::Geographic => return (lon_deg, lat_deg),
            Method::Equirectangular { cos_lat_ts, lat0_deg, lon0_deg } => {
                let lon = wrapped(lon_deg - lon0_deg).to_radians();
                (self.radius_m * cos_lat_ts * lon, self.radius_m * (lat_deg - lat0_deg).to_radians())
            }
            Method::PolarStereographic { sign, scale, lon0_deg } => {
                if lat_deg * sign <= -90.0 {
                    return (f64::NAN, f64::NAN);
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
            Method::Equirectangular { cos_lat_ts, lat0_deg, lon0_deg } => {
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
            return (f64::NAN, f64::NAN);
        }
        (lon_deg, lat_deg.clamp(-90.0, 90.0))
    }

    /// Returns whether both give the same coordinates (to 1e-9 of a degree or of the sphere).
    #[must_use]
    pub fn same_as(&self, other: &Self) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * a.abs().max(b.abs()).max(1.0);
        let same_lon = |a: f64, b: f64| wrapped(a - b).abs() <= 1e-9;
        let same_method = match (self.method, other.method) {
            (Method::Geographic, Method::Geographic) => true,
            (
                Method::Equirectangular { cos_lat_ts, lat0_deg, lon0_deg },
                Method::Equirectangular { cos_lat_ts: cos, lat0_deg: lat, lon0_deg: lon },
            ) => near(cos_lat_ts, cos) && near(lat0_deg, lat) && same_lon(lon0_deg, lon),
            (
                Method::PolarStereographic { sign, scale, lon0_deg },
                Method::PolarStereographic { sign: pole, scale: k, lon0_deg: lon },
            ) => sign == pole && near(scale, k) && same_lon(lon0_deg, lon),
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
            Method::Geographic => true,
            Method::Equirectangular { cos_lat_ts, lat0_deg, lon0_deg } => {
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

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_testing::rasterio;

    const SYSTEMS: [&str; 11] = [
        "+proj=longlat +R=1737400",
        "+proj=eqc +R=1737400",
        "+proj=eqc +lat_ts=26.1 +lon_0=180 +R=1737400",
        "+proj=eqc +lat_ts=-43 +lat_0=12 +lon_0=-33.25 +x_0=1000 +y_0=-2500.5 +R=1737400",
        "+proj=eqc +lat_ts=1 +lon_0=180 +x_0=70000 +R=1737400 +units=km",
        "+proj=eqc +lon_0=77 +R=3396190",
        "+proj=stere +lat_0=90 +R=1737400",
        "+proj=stere +lat_0=-90 +lon_0=0 +R=1737400",
        "+proj=stere +lat_0=-90 +lon_0=123.5 +k=0.994 +x_0=2000000 +y_0=-1e6 +R=1737400",
        "+proj=stere +lat_0=90 +lat_ts=71 +lon_0=-45 +R=3396190",
        "+proj=stere +lat_0=-90 +lat_ts=-80 +lon_0=10 +x_0=5000 +R=1737400 +units=km",
    ];

    fn points() -> Vec<(f64, f64)> {
        let lons = [-180.0, -179.99, -123.4, -45.0, 0.0, 0.001, 33.3, 90.0, 179.9999, 180.0, 200.0, 359.5];
        let lats = [-90.0, -89.999, -80.0, -45.5, -1.0, 0.0, 12.345, 59.9, 80.0, 89.5, 90.0];
        lons.iter().flat_map(|&lon| lats.iter().map(move |&lat| (lon, lat))).collect()
    }

    fn of(text: &str) -> Projection {
        Projection::of(&Crs::parse(text).unwrap()).unwrap_or_else(|| panic!("{text}"))
    }

    #[test]
    fn every_point_comes_back() {
        for text in SYSTEMS {
            let projection = of(text);
            let mut tried = 0;
            for (lon, lat) in points() {
                let (x, y) = projection.forward(lon, lat);
                if text.contains("stere") && (lat.abs() == 90.0 || x.hypot(y) > 1e9) {
                    continue; // The poles have no longitude, and the far one has no position.
                }
                let (lon2, lat2) = projection.inverse(x, y);
                assert!(
                    wrapped(lon2 - lon).abs() < 1e-9 && (lat2 - lat).abs() < 1e-9,
                    "{text}: {lon} {lat} -> {lon2} {lat2}"
                );
                tried += 1;
            }
            assert!(tried >= 80, "{text}: {tried}");
        }
    }

    #[test]
    fn known_places() {
        // A quarter of the equator; a pole in the map of the other; the scale at the standard parallel.
        assert_eq!(of("+proj=eqc +R=1737400").forward(90.0, 0.0), (1_737_400.0 * std::f64::consts::FRAC_PI_2, 0.0));
        let south = of("+proj=stere +lat_0=-90 +R=1737400");
        assert_eq!(south.forward(0.0, -90.0), (0.0, 0.0));
        assert!(south.forward(0.0, 90.0).0.is_nan());
        let (x, y) = south.forward(90.0, 0.0);
        assert!(
            (x - 2.0 * 1_737_400.0).abs() < 1e-6 && y.abs() < 1e-6,
            "the equator at twice the radius, east to the right"
        );
        assert!(south.forward(0.0, -80.0).1 > 0.0 && of("+proj=stere +lat_0=90 +R=1737400").forward(0.0, 80.0).1 < 0.0);
        let b = of("+proj=stere +lat_0=90 +lat_ts=70 +R=1");
        let step = b.forward(0.0, 70.0).1 - b.forward(0.0, 70.001).1;
        assert!((step / -0.001_f64.to_radians() - 1.0).abs() < 1e-4, "{step}");
    }

    #[test]
    fn points_that_do_not_exist_are_nan() {
        let plane = of("+proj=eqc +R=1737400");
        assert!(plane.forward(0.0, 90.5).0.is_nan() && plane.forward(f64::NAN, 0.0).0.is_nan());
        assert!(plane.inverse(0.0, 3e6).0.is_nan() && plane.inverse(f64::INFINITY, 0.0).1.is_nan());
        assert_eq!(plane.inverse(0.0, plane.forward(0.0, 90.0).1).1, 90.0);
    }

    #[test]
    fn other_systems_are_not_guessed() {
        let moon = Crs::moon_equirectangular(0.0, 0.0);
        let change = |key: u16, value: u16| {
            let mut crs = moon.clone();
            let at = crs.directory[4..].chunks(4).position(|entry| entry[0] == key).unwrap() * 4 + 4;
            crs.directory[at + 3] = value;
            crs
        };
        assert!(Projection::of(&change(key::METHOD, 7)).is_none(), "Mercator");
        assert!(Projection::of(&change(key::ANGULAR_UNIT, 9101)).is_none(), "radians");
        let mut flat = moon.clone();
        flat.doubles[1] -= 2000.0;
        assert!(Projection::of(&flat).is_none(), "an ellipsoid");
        let mut turned = moon.clone();
        turned.doubles[2] = 5.0;
        assert!(Projection::of(&turned).is_none(), "another prime meridian");
        assert!(Projection::of(&Crs::default()).is_none());
    }

    /// Comparison with PROJ through rasterio: forward, inverse, and our keys as GDAL reads them.
    #[test]
    fn proj_agrees_to_a_tenth_of_a_millimetre() {
        let folder = tempfile::tempdir().unwrap();
        let mut compared = 0;
        for text in SYSTEMS {
            let mut points = points();
            points.retain(|&(lon, lat)| of(text).forward(lon, lat).0.is_finite());
            let list: String = points.iter().map(|(lon, lat)| format!("({lon}, {lat}),")).collect();
            let geographic = format!("+proj=longlat +R={}", of(text).radius_m());
            let crs = Crs::parse(text).unwrap();
            let georef = crate::GeoRef { transform: [0.0, 1.0, 0.0, 0.0, 0.0, -1.0], crs };
            let raster = crate::Raster { rows: 1, cols: 1, samples: vec![1.0], georef: Some(georef) };
            let options = crate::geotiff::WriteOptions::heights("x");
            crate::geotiff::write(&folder.path().join("keys.tif"), &raster, &options).unwrap();
            // The keys as GDAL reads them decide, not the text, so that writing is tested too. Then the same with GDAL's own keys.
            let script = format!(
                "
from rasterio.warp import transform
crs = rasterio.open('keys.tif').crs
points = [{list}]
lon, lat = zip(*points)
x, y = transform('{geographic}', crs, lon, lat)
x2, y2 = transform('{geographic}', '{text}', lon, lat)
for row in zip(x, y, x2, y2):
    print(*map(repr, map(float, row)))
with rasterio.open('gdal.tif', 'w', driver='GTiff', width=1, height=1, count=1, dtype='uint8', crs='{text}', transform=Affine(1, 0, 0, 0, -1, 0)) as d:
    d.write(np.ones((1, 1, 1), 'uint8'))
"
            );
            let Some(out) = rasterio(&script, folder.path()) else { return };
            let ours = of(text);
            let gdals = crate::geotiff::read(folder.path().join("gdal.tif")).unwrap().georef.unwrap().crs;
            assert!(Projection::of(&gdals).is_some_and(|p| p.same_as(&ours)), "{text}: {gdals:?}");
            let unit_m = if text.contains("longlat") { 1.0_f64.to_radians() * ours.radius_m() } else { ours.unit_m };
            for (line, (lon, lat)) in out.lines().zip(points) {
                let n: Vec<f64> = line.split_whitespace().map(|v| v.parse().unwrap()).collect();
                let (x, y) = ours.forward(lon, lat);
                if !(n[0].abs() < 1e9 && n[1].abs() < 1e9) || text.contains("longlat") && lon > 180.0 {
                    continue;
                }
                let at_seam = ours.period().is_some_and(|period| ((x - n[0]).abs() - period).abs() * unit_m < 1e-3);
                for (px, py) in [(n[0], n[1]), (n[2], n[3])] {
                    let off_m = if at_seam { (y - py).abs() } else { (x - px).hypot(y - py) } * unit_m;
                    // Far from the pole, a stereographic map has few digits left: 1e-12 of the distance.
                    assert!(
                        off_m <= 1e-4_f64.max(1e-12 * x.hypot(y) * unit_m),
                        "{text}: {lon} {lat}: {x} {y}, PROJ {px} {py}"
                    );
                    compared += 1;
                }
            }
        }
        println!("{compared} points compared");
        assert!(compared > 2000, "{compared}");
    }
}
