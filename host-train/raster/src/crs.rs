//! Coordinate reference systems, as GeoTIFF keys.

mod build;
mod parse;

pub use build::Axes;

use super::Projection;
use std::collections::BTreeMap;
use tiff::tags::Tag;

/// Radius of the Moon's reference sphere, metres. All heights of this project are above it.
pub const MOON_RADIUS_M: f64 = 1_737_400.0;

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
    pub(crate) const NAT_ORIGIN_LON: u16 = 3080;
    pub(crate) const NAT_ORIGIN_LAT: u16 = 3081;
    pub(crate) const FALSE_EASTING: u16 = 3082;
    pub(crate) const FALSE_NORTHING: u16 = 3083;
    pub(crate) const FALSE_ORIGIN_LON: u16 = 3084;
    pub(crate) const FALSE_ORIGIN_LAT: u16 = 3085;
    pub(crate) const CENTRE_LON: u16 = 3088;
    pub(crate) const CENTRE_LAT: u16 = 3089;
    pub(crate) const SCALE: u16 = 3092;
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
    pub(crate) const STEREOGRAPHIC: u16 = 14;
    pub(crate) const POLAR_STEREOGRAPHIC: u16 = 15;
    pub(crate) const EQUIRECTANGULAR: u16 = 17;
}

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

    /// Returns true for systems with map coordinates in a length unit, false for longitude and latitude.
    #[must_use]
    pub fn is_projected(&self) -> bool {
        self.number(key::MODEL_TYPE) == Some(f64::from(code::PROJECTED))
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
            Some(_) => self.number(key::LINEAR_UNIT_SIZE).filter(|&size| size > 0.0),
        }
    }

    /// Returns the radius of the reference body, metres, if the keys give a sphere.
    #[must_use]
    pub fn sphere_radius_m(&self) -> Option<f64> {
        let (major, minor) = self.axes_m()?;
        (major == minor).then_some(major)
    }

    /// Returns whether both mean the same system. If both are supported, their [`Projection`]s are compared. Otherwise keys and values are
    /// compared. For this, defaults of the standard are filled in and synonymous keys of other writers are unified; citation text and the
    /// pixel-is-area flag are left out.
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

    /// Returns one line for messages: the projection method, its parameters and the sphere.
    #[must_use]
    pub fn summary(&self) -> String {
        if self.is_empty() {
            return "no reference system".into();
        }
        let axes = match self.axes_m() {
            Some((a, b)) if a == b => format!("sphere {a} m"),
            Some((a, b)) => format!("ellipsoid {a} m / {b} m"),
            None => "body unknown".into(),
        };
        if !self.is_projected() {
            return format!("longitude/latitude, {axes}");
        }
        let number = |key| self.number(key);
        let lon0 = [key::CENTRE_LON, key::NAT_ORIGIN_LON, key::STRAIGHT_POLE_LON, key::FALSE_ORIGIN_LON]
            .into_iter()
            .find_map(number);
        let lat0 = [key::STD_PARALLEL_1, key::NAT_ORIGIN_LAT, key::CENTRE_LAT, key::FALSE_ORIGIN_LAT]
            .into_iter()
            .find_map(number);
        let method = match (self.number(key::METHOD), self.number(key::PROJECTED_CRS)) {
            (Some(17.0), _) => "equirectangular".into(),
            (Some(15.0), _) => "polar stereographic".into(),
            (Some(method), _) => format!("projection method {method}"),
            (None, Some(code)) if code != USER_DEFINED => format!("EPSG {code}"),
            _ => "unnamed projection".into(),
        };
        format!("{method}, lat {} deg, lon {} deg, {axes}", lat0.unwrap_or(0.0), lon0.unwrap_or(0.0))
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

    /// Returns the semi-axes of the body, metres.
    fn axes_m(&self) -> Option<(f64, f64)> {
        let major = self.number(key::SEMI_MAJOR)?;
        let minor = self.number(key::SEMI_MINOR).or_else(|| {
            let inverse = self.number(key::INV_FLATTENING).filter(|&f| f != 0.0)?;
            Some(major * (1.0 - 1.0 / inverse))
        });
        Some((major, minor.unwrap_or(major)))
    }

    /// Returns keys and values without defaults and with unified synonyms, for [`Crs::same_as`].
    fn meaning(&self) -> BTreeMap<u16, Value> {
        let mut meaning = BTreeMap::new();
        for (key, value) in self.values() {
            let key = match key {
                key::CITATION | key::GEODETIC_CITATION | key::PROJECTED_CITATION | key::RASTER_TYPE => continue,
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
                key::ANGULAR_UNIT => Some(f64::from(code::DEGREE)),
                key::PRIME_MERIDIAN => Some(8901.0),
                key::PRIME_MERIDIAN_LON | key::FALSE_EASTING | key::FALSE_NORTHING => Some(0.0),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sphere_is_the_moons() {
        for crs in [Crs::moon_equirectangular(12.0, 180.0), Crs::moon_polar(true), Crs::moon_polar(false)] {
            assert!(crs.is_projected() && !crs.is_empty() && !crs.pixel_is_point());
            assert_eq!(crs.sphere_radius_m(), Some(MOON_RADIUS_M));
            assert_eq!(crs.metres_per_unit(), Some(1.0));
            assert_eq!(crs.defect(), None);
            assert!(crs.directory[4..].chunks(4).is_sorted_by_key(|k| k[0]), "keys ascend");
        }
        assert_eq!(Crs::default().sphere_radius_m(), None);
        assert!(!Crs::default().is_projected());
    }

    #[test]
    fn sameness_is_of_meaning() {
        let a = Crs::moon_equirectangular(0.0, 180.0);
        let mut b = Crs::moon_equirectangular(0.0, -180.0);
        assert!(a.same_as(&b), "a meridian has many names");
        b.ascii = b.ascii.replace("Equirectangular Moon", "equirectangular_moon");
        assert!(a.same_as(&b), "citations are comments");
        assert!(!a.same_as(&Crs::moon_equirectangular(1.0, 180.0)), "the standard parallel matters");
        assert!(!a.same_as(&Crs::moon_equirectangular(0.0, 0.0)), "the meridian matters");
        assert!(!a.same_as(&Crs::moon_polar(true)) && !Crs::moon_polar(false).same_as(&Crs::moon_polar(true)));
        assert!(!a.same_as(&Crs::default()) && Crs::default().same_as(&Crs::default()));
        let mut other_sphere = a.clone();
        other_sphere.doubles[0] = 1_738_000.0;
        other_sphere.doubles[1] = 1_738_000.0;
        assert!(!a.same_as(&other_sphere), "the radius matters");
    }

    #[test]
    fn synonyms_and_defaults_are_folded() {
        let a = Crs::moon_equirectangular(0.0, 25.0);
        let mut b = a.clone();
        // Entry of the central meridian. Its key becomes the synonym of other writers, and the zeros are left to their defaults.
        let at = b.directory[4..].chunks(4).position(|entry| entry[0] == key::CENTRE_LON).unwrap() * 4 + 4;
        b.directory[at] = key::NAT_ORIGIN_LON;
        let kept: Vec<u16> = b.directory[4..]
            .chunks(4)
            .filter(|entry| ![key::STD_PARALLEL_1, key::FALSE_EASTING, key::CENTRE_LAT].contains(&entry[0]))
            .flatten()
            .copied()
            .collect();
        b.directory = [vec![1, 1, 0, (kept.len() / 4) as u16], kept].concat();
        assert!(a.same_as(&b) && b.directory.len() < a.directory.len());
        assert_eq!(a.meaning(), b.meaning());
    }

    #[test]
    fn contradictory_tags_are_found() {
        let mut crs = Crs::moon_polar(true);
        crs.doubles.pop();
        assert!(crs.defect().unwrap().contains("3095"));
        assert!(Crs { directory: vec![1, 1, 0, 9], ..Crs::default() }.defect().is_some());
        assert!(Crs { directory: vec![1], ..Crs::default() }.defect().is_some());
        assert!(Crs { directory: vec![7, 1, 0, 0], ..Crs::default() }.defect().is_some());
    }
}
