//! Coordinate reference systems, as GeoTIFF keys.

mod body;
mod build;
mod citation;
mod method;
mod parse;
mod summary;

#[cfg(test)]
mod tests;

pub use build::Axes;
pub(super) use method::{ProjectionMethod, ProjectionParameters};

use super::Projection;
use std::collections::BTreeMap;
use tiff::tags::Tag;

/// Tag of a key whose value is stored in the key itself.
const INLINE: Tag = Tag::Unknown(0);

/// A coordinate reference system in GeoTIFF keys. The keys are stored verbatim, so that they are written as they were read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Crs {
    /// GeoKeyDirectoryTag (34735), header included.
    pub directory: Vec<u16>,
    /// GeoDoubleParamsTag (34736).
    pub doubles: Vec<f64>,
    /// GeoAsciiParamsTag (34737).
    pub ascii: String,
}

/// GeoKey numbers, as the GeoTIFF standard (OGC 19-008) names them.
pub(super) mod key {
    pub(crate) const MODEL_TYPE: u16 = 1024;
    pub(crate) const RASTER_TYPE: u16 = 1025;
    pub(crate) const CITATION: u16 = 1026;
    pub(crate) const GEODETIC_CRS: u16 = 2048;
    pub(crate) const GEODETIC_CITATION: u16 = 2049;
    pub(crate) const DATUM: u16 = 2050;
    pub(crate) const PRIME_MERIDIAN: u16 = 2051;
    pub(crate) const ANGULAR_UNIT: u16 = 2054;
    pub(crate) const ANGULAR_UNIT_SIZE: u16 = 2055;
    pub(crate) const ELLIPSOID: u16 = 2056;
    pub(crate) const SEMI_MAJOR: u16 = 2057;
    pub(crate) const SEMI_MINOR: u16 = 2058;
    pub(crate) const INV_FLATTENING: u16 = 2059;
    pub(crate) const PRIME_MERIDIAN_LON: u16 = 2061;
    pub(crate) const PROJECTED_CRS: u16 = 3072;
    pub(crate) const PROJECTED_CITATION: u16 = 3073;
    pub(crate) const PROJECTION: u16 = 3074;
    pub(crate) const METHOD: u16 = 3075;
    pub(crate) const LINEAR_UNIT: u16 = 3076;
    pub(crate) const LINEAR_UNIT_SIZE: u16 = 3077;
    pub(crate) const STD_PARALLEL_1: u16 = 3078;
    pub(crate) const STD_PARALLEL_2: u16 = 3079;
    pub(crate) const NAT_ORIGIN_LON: u16 = 3080;
    pub(crate) const NAT_ORIGIN_LAT: u16 = 3081;
    pub(crate) const FALSE_EASTING: u16 = 3082;
    pub(crate) const FALSE_NORTHING: u16 = 3083;
    pub(crate) const FALSE_ORIGIN_LON: u16 = 3084;
    pub(crate) const FALSE_ORIGIN_LAT: u16 = 3085;
    pub(crate) const FALSE_ORIGIN_EASTING: u16 = 3086;
    pub(crate) const FALSE_ORIGIN_NORTHING: u16 = 3087;
    pub(crate) const CENTRE_LON: u16 = 3088;
    pub(crate) const CENTRE_LAT: u16 = 3089;
    pub(crate) const CENTRE_EASTING: u16 = 3090;
    pub(crate) const CENTRE_NORTHING: u16 = 3091;
    pub(crate) const SCALE: u16 = 3092;
    pub(crate) const SCALE_AT_CENTRE: u16 = 3093;
    pub(crate) const STRAIGHT_POLE_LON: u16 = 3095;
}

/// Values of the keys above.
pub(super) mod code {
    pub(crate) const USER_DEFINED: u16 = 32767;
    pub(crate) const PROJECTED: u16 = 1;
    pub(crate) const GEOGRAPHIC: u16 = 2;
    pub(crate) const METRE: u16 = 9001;
    pub(crate) const KILOMETRE: u16 = 9036;
    pub(crate) const DEGREE: u16 = 9102;
    pub(crate) const TRANSVERSE_MERCATOR: u16 = 1;
    pub(crate) const MERCATOR: u16 = 7;
    pub(crate) const LAMBERT_2SP: u16 = 8;
    pub(crate) const LAMBERT_1SP: u16 = 9;
    pub(crate) const STEREOGRAPHIC: u16 = 14;
    pub(crate) const POLAR_STEREOGRAPHIC: u16 = 15;
    pub(crate) const OBLIQUE_STEREOGRAPHIC: u16 = 16;
    pub(crate) const EQUIRECTANGULAR: u16 = 17;
    pub(crate) const ORTHOGRAPHIC: u16 = 21;
    pub(crate) const SINUSOIDAL: u16 = 24;
}

/// Lengths that can be the unit of a map, metres (our choice).
const UNITS_M: std::ops::RangeInclusive<f64> = 1e-6..=1e9;

const USER_DEFINED: f64 = code::USER_DEFINED as f64;

/// The value of one key.
#[derive(Debug, Clone, PartialEq)]
enum Value {
    Numbers(Vec<f64>),
    Text(String),
}

impl Crs {
    /// Returns whether the file names no system.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.directory.is_empty()
    }

    /// Returns whether the keys state map coordinates in a length unit.
    #[must_use]
    pub fn is_projected(&self) -> bool {
        self.number(key::MODEL_TYPE) == Some(f64::from(code::PROJECTED))
    }

    /// Returns whether angles are in degrees.
    pub(super) fn is_in_degrees(&self) -> bool {
        self.number(key::ANGULAR_UNIT).is_none_or(|unit| [9102.0, 9122.0].contains(&unit))
    }

    /// Returns whether the keys state longitude and latitude. Some systems are neither: a file may name its system in a text alone.
    #[must_use]
    pub fn is_geographic(&self) -> bool {
        self.number(key::MODEL_TYPE) == Some(f64::from(code::GEOGRAPHIC))
    }

    /// Returns whether (0, 0) of the file's own coordinates means the centre of the first pixel (`AREA_OR_POINT=Point`).
    #[must_use]
    pub fn pixel_is_point(&self) -> bool {
        self.number(key::RASTER_TYPE) == Some(2.0)
    }

    /// Returns metres per map unit of a projected system; `None` for geographic systems and unknown units.
    #[must_use]
    pub fn metres_per_unit(&self) -> Option<f64> {
        if !self.is_projected() {
            return None;
        }
        match self.number(key::LINEAR_UNIT) {
            None => Some(1.0),
            Some(code) if code == f64::from(code::METRE) => Some(1.0),
            Some(9002.0) => Some(0.3048),
            Some(9003.0) => Some(1200.0 / 3937.0),
            Some(9036.0) => Some(1000.0),
            Some(_) => self.number(key::LINEAR_UNIT_SIZE).filter(|size| UNITS_M.contains(size)),
        }
    }

    /// Returns whether both mean the same system. If both are supported, their [`Projection`]s are compared. Otherwise keys and values are
    /// compared. For this, defaults of the standard are filled in and synonymous keys of other writers are unified; citation text and the
    /// pixel-is-area flag are left out. A text that states the system as WKT counts.
    #[must_use]
    pub fn same_as(&self, other: &Crs) -> bool {
        if let (Some(a), Some(b)) = (Projection::of(self), Projection::of(other)) {
            return a.same_as(&b);
        }
        let (a, b) = (self.meaning(), other.meaning());
        let close = |x: &f64, y: &f64| (x - y).abs() <= 1e-9 * x.abs().max(y.abs()).max(1e-3);
        let equal = |x: &Value, y: &Value| match (x, y) {
            (Value::Numbers(x), Value::Numbers(y)) => x.len() == y.len() && x.iter().zip(y).all(|(x, y)| close(x, y)),
            (x, y) => x == y,
        };
        self.is_empty() == other.is_empty()
            && a.len() == b.len()
            && a.iter().zip(&b).all(|((ka, va), (kb, vb))| ka == kb && equal(va, vb))
    }

    /// Returns how the key tags contradict each other, if they do.
    pub(super) fn defect(&self) -> Option<String> {
        let Some(header) = self.directory.first_chunk::<4>() else {
            return (!self.directory.is_empty())
                .then(|| format!("GeoKey directory of {} numbers, at least 4 expected", self.directory.len()));
        };
        let (version, count) = (header[0], usize::from(header[3]));
        if version != 1 {
            return Some(format!("GeoKey directory version {version}, 1 expected"));
        }
        if self.directory.len() < 4 + 4 * count {
            return Some(format!("GeoKey directory promises {count} keys, {} numbers found", self.directory.len()));
        }
        let bad = self.entries().find(|&[_, tag, n, at]| match Tag::from_u16_exhaustive(tag) {
            Tag::GeoDoubleParamsTag => usize::from(at) + usize::from(n) > self.doubles.len(),
            Tag::GeoAsciiParamsTag => usize::from(at) + usize::from(n) > self.ascii.len(),
            Tag::GeoKeyDirectoryTag => usize::from(at) + usize::from(n) > self.directory.len(),
            _ => false,
        });
        bad.map(|[key, tag, n, at]| format!("GeoKey {key} points at {n} values from {at} in tag {tag}, beyond its end"))
            .or_else(|| self.defect_of_body())
    }

    fn entries(&self) -> impl Iterator<Item = [u16; 4]> + '_ {
        let count = self.directory.get(3).map_or(0, |&n| usize::from(n));
        self.directory.get(4..).unwrap_or(&[]).as_chunks::<4>().0.iter().take(count).copied()
    }

    /// Returns the first number of a key.
    pub(super) fn number(&self, key: u16) -> Option<f64> {
        match self.values().remove(&key)? {
            Value::Numbers(numbers) => numbers.first().copied(),
            Value::Text(_) => None,
        }
    }

    fn values(&self) -> BTreeMap<u16, Value> {
        let mut values = BTreeMap::new();
        for [key, tag, n, at] in self.entries() {
            let range = usize::from(at)..usize::from(at) + usize::from(n);
            let value = match Tag::from_u16_exhaustive(tag) {
                INLINE => Some(Value::Numbers(vec![f64::from(at)])),
                Tag::GeoKeyDirectoryTag => {
                    self.directory.get(range).map(|v| Value::Numbers(v.iter().map(|&x| f64::from(x)).collect()))
                }
                Tag::GeoDoubleParamsTag => self.doubles.get(range).map(|v| Value::Numbers(v.to_vec())),
                Tag::GeoAsciiParamsTag => self.ascii.get(range).map(|t| Value::Text(t.trim_end_matches('|').into())),
                _ => None,
            };
            if let Some(value) = value {
                values.insert(key, value);
            }
        }
        values
    }

    /// Returns keys and values without defaults and with unified synonyms, for [`Crs::same_as`].
    fn meaning(&self) -> BTreeMap<u16, Value> {
        let mut meaning = BTreeMap::new();
        for (key, value) in self.values() {
            let key = match key {
                key::RASTER_TYPE => continue,
                key::CITATION | key::GEODETIC_CITATION | key::PROJECTED_CITATION if !citation::is_wkt(&value) => {
                    continue;
                }
                // Sizes of user-defined units, and the axes, are resolved below.
                key::LINEAR_UNIT | key::LINEAR_UNIT_SIZE | key::ANGULAR_UNIT_SIZE => continue,
                key::SEMI_MAJOR | key::SEMI_MINOR | key::INV_FLATTENING => continue,
                key::NAT_ORIGIN_LON | key::STRAIGHT_POLE_LON | key::FALSE_ORIGIN_LON => key::CENTRE_LON,
                key::NAT_ORIGIN_LAT | key::FALSE_ORIGIN_LAT => key::CENTRE_LAT,
                key => key,
            };
            let default = match key {
                key::GEODETIC_CRS | key::DATUM | key::ELLIPSOID | key::PROJECTED_CRS | key::PROJECTION => {
                    Some(USER_DEFINED)
                }
                key::ANGULAR_UNIT if self.is_in_degrees() => continue,
                key::PRIME_MERIDIAN => Some(8901.0),
                key::PRIME_MERIDIAN_LON | key::FALSE_EASTING | key::FALSE_NORTHING => Some(0.0),
                key::FALSE_ORIGIN_EASTING | key::FALSE_ORIGIN_NORTHING => Some(0.0),
                key::CENTRE_LON | key::CENTRE_LAT | key::STD_PARALLEL_1 => Some(0.0),
                key::SCALE => Some(1.0),
                _ => None,
            };
            let value = match (key, value) {
                (key::CENTRE_LON, Value::Numbers(n)) => {
                    Value::Numbers(n.iter().map(|lon| lon.rem_euclid(360.0)).collect())
                }
                (_, value) => value,
            };
            let is_default = default.is_some_and(|d| value == Value::Numbers(vec![d]));
            if !is_default {
                meaning.insert(key, value);
            }
        }
        if let Some((a, b)) = self.axes_m() {
            meaning.insert(key::SEMI_MAJOR, Value::Numbers(vec![a, b]));
        }
        if self.is_projected() {
            let unit =
                self.metres_per_unit().map_or_else(|| Value::Text("unknown".into()), |m| Value::Numbers(vec![m]));
            meaning.insert(key::LINEAR_UNIT, unit);
        }
        meaning
    }
}
