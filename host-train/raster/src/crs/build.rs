//! Construction of systems. The keys are those that GDAL 3.10 writes.

use super::method::{self, ProjectionParameters};
use super::{Crs, INLINE, code, key};
use elunar_core::sun::Body;
use tiff::tags::Tag;

/// Origin and unit of the axes of a projected system.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    /// Added to x, in the unit of the map.
    pub false_easting: f64,
    /// Added to y, in the unit of the map.
    pub false_northing: f64,
    /// Whether the unit is the kilometre instead of the metre.
    pub kilometres: bool,
}

impl Axes {
    /// Metres, with the projection's own origin.
    pub const PLAIN: Self = Self { false_easting: 0.0, false_northing: 0.0, kilometres: false };
}

impl Crs {
    /// Makes an equirectangular system on a sphere: standard parallel `lat_ts_deg`, central meridian `lon0_deg`, metres from the equator.
    #[must_use]
    pub fn equirectangular(radius_m: f64, lat_ts_deg: f64, lon0_deg: f64) -> Self {
        Self::equirectangular_from(radius_m, lat_ts_deg, (0.0, lon0_deg), Axes::PLAIN)
    }

    /// Makes a polar stereographic system on a sphere, tangent at the pole, metres. Longitude 0 points downwards (south: upwards).
    #[must_use]
    pub fn polar(radius_m: f64, south: bool) -> Self {
        Self::polar_stereographic(radius_m, if south { -90.0 } else { 90.0 }, 1.0, 0.0, Axes::PLAIN)
    }

    /// Makes a system of longitude and latitude in degrees on a sphere.
    #[must_use]
    pub fn geographic(radius_m: f64) -> Self {
        let name = body(radius_m);
        Builder::new(code::GEOGRAPHIC, &name, &name, radius_m).crs
    }

    /// Makes an equirectangular system on a sphere: standard parallel `lat_ts_deg`; `origin_deg` is (latitude where y is 0, central
    /// meridian).
    #[must_use]
    pub fn equirectangular_from(radius_m: f64, lat_ts_deg: f64, origin_deg: (f64, f64), axes: Axes) -> Self {
        let name = body(radius_m);
        let mut keys = Builder::new(code::PROJECTED, &format!("Equirectangular {name}"), &name, radius_m);
        keys.projected(code::EQUIRECTANGULAR, axes).double(key::STD_PARALLEL_1, lat_ts_deg).axes(axes);
        keys.double(key::CENTRE_LON, origin_deg.1).double(key::CENTRE_LAT, origin_deg.0);
        keys.crs
    }

    /// Makes a polar stereographic system on a sphere. `lat_ts_deg` is the latitude of true scale; its sign gives the pole. At ±90, `scale`
    /// is the scale at the pole; otherwise it must be 1. `lon0_deg` points downwards in the north, upwards in the south.
    #[must_use]
    pub fn polar_stereographic(radius_m: f64, lat_ts_deg: f64, scale: f64, lon0_deg: f64, axes: Axes) -> Self {
        let name = body(radius_m);
        let pole = if lat_ts_deg < 0.0 { "South" } else { "North" };
        let citation = format!("{pole} Polar Stereographic {name}");
        let mut keys = Builder::new(code::PROJECTED, &citation, &name, radius_m);
        keys.projected(code::POLAR_STEREOGRAPHIC, axes).double(key::NAT_ORIGIN_LAT, lat_ts_deg).axes(axes);
        keys.double(key::SCALE, scale).double(key::STRAIGHT_POLE_LON, lon0_deg);
        keys.crs
    }

    /// Makes a system of a projection that `proj4rs` computes, on a sphere.
    pub(crate) fn ported(radius_m: f64, parameters: ProjectionParameters, axes: Axes) -> Self {
        let (number, mut of_map) = parameters.keys();
        let (easting, northing) = match number {
            code::LAMBERT_2SP => (key::FALSE_ORIGIN_EASTING, key::FALSE_ORIGIN_NORTHING),
            _ => (key::FALSE_EASTING, key::FALSE_NORTHING),
        };
        of_map.extend([(easting, axes.false_easting), (northing, axes.false_northing)]);
        of_map.sort_by_key(|&(key, _)| key);
        let (name, what) = (body(radius_m), method::name(f64::from(number)).unwrap_or_default());
        let mut keys = Builder::new(code::PROJECTED, &format!("{what} {name}"), &name, radius_m);
        keys.projected(number, axes);
        for (key, value) in of_map {
            keys.double(key, value);
        }
        keys.crs
    }
}

/// Returns the name of a body in citations.
fn body(radius_m: f64) -> String {
    if radius_m == Body::Moon.radius_m() { "Moon".into() } else { format!("sphere of {radius_m} m") }
}

/// Appends keys in ascending order.
struct Builder {
    crs: Crs,
}

impl Builder {
    /// Starts with the keys that every system has.
    fn new(model: u16, citation: &str, body: &str, radius_m: f64) -> Self {
        let mut keys = Self { crs: Crs { directory: vec![1, 1, 0, 0], doubles: vec![], ascii: String::new() } };
        keys.short(key::MODEL_TYPE, model).short(key::RASTER_TYPE, 1).text(key::CITATION, citation);
        let parts = format!("GCS Name = GCS_{body}|Datum = D_{body}|Ellipsoid = {body}|Primem = Reference Meridian|");
        keys.short(key::GEODETIC_CRS, code::USER_DEFINED).text(key::GEODETIC_CITATION, &parts);
        keys.short(key::DATUM, code::USER_DEFINED).short(key::ANGULAR_UNIT, code::DEGREE);
        keys.short(key::ELLIPSOID, code::USER_DEFINED);
        keys.double(key::SEMI_MAJOR, radius_m).double(key::SEMI_MINOR, radius_m).double(key::PRIME_MERIDIAN_LON, 0.0);
        keys
    }

    fn projected(&mut self, method: u16, axes: Axes) -> &mut Self {
        let unit = if axes.kilometres { code::KILOMETRE } else { code::METRE };
        self.short(key::PROJECTED_CRS, code::USER_DEFINED).short(key::PROJECTION, code::USER_DEFINED);
        self.short(key::METHOD, method).short(key::LINEAR_UNIT, unit)
    }

    fn axes(&mut self, axes: Axes) -> &mut Self {
        self.double(key::FALSE_EASTING, axes.false_easting).double(key::FALSE_NORTHING, axes.false_northing)
    }

    fn entry(&mut self, key: u16, tag: Tag, count: usize, at: usize) -> &mut Self {
        let small = |n: usize| u16::try_from(n).expect("a handful of keys");
        self.crs.directory.extend([key, tag.to_u16(), small(count), small(at)]);
        self.crs.directory[3] += 1;
        self
    }

    fn short(&mut self, key: u16, value: u16) -> &mut Self {
        self.entry(key, INLINE, 1, usize::from(value))
    }

    fn double(&mut self, key: u16, value: f64) -> &mut Self {
        self.crs.doubles.push(value);
        self.entry(key, Tag::GeoDoubleParamsTag, 1, self.crs.doubles.len() - 1)
    }

    fn text(&mut self, key: u16, value: &str) -> &mut Self {
        let at = self.crs.ascii.len();
        self.crs.ascii.push_str(value);
        self.crs.ascii.push('|');
        self.entry(key, Tag::GeoAsciiParamsTag, value.len() + 1, at)
    }
}
