//! Projections of GeoTIFF: their names, and the keys of those that `proj4rs` computes ([`crate::Projection`]).

use super::{Crs, code, key};

/// Names of the methods, in the order of their numbers from 1 (GeoTIFF 1.0, Sec. 6.3.3.3; the last one is GDAL's).
const NAMES: [&str; 28] = [
    "transverse Mercator",
    "transverse Mercator (modified Alaska)",
    "oblique Mercator",
    "oblique Mercator (Laborde)",
    "oblique Mercator (Rosenmund)",
    "oblique Mercator (spherical)",
    "Mercator",
    "Lambert conformal conic (two standard parallels)",
    "Lambert conformal conic (one standard parallel)",
    "Lambert azimuthal equal area",
    "Albers equal area",
    "azimuthal equidistant",
    "equidistant conic",
    "stereographic",
    "polar stereographic",
    "oblique stereographic",
    "equirectangular",
    "Cassini-Soldner",
    "gnomonic",
    "Miller cylindrical",
    "orthographic",
    "polyconic",
    "Robinson",
    "sinusoidal",
    "van der Grinten",
    "New Zealand map grid",
    "transverse Mercator (south oriented)",
    "cylindrical equal area",
];

/// Returns the name of a method, by its number.
pub(super) fn name(method: f64) -> Option<&'static str> {
    (method >= 1.0).then(|| NAMES.get(method as usize - 1).copied()).flatten()
}

/// A projection that `proj4rs` computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ProjectionMethod {
    Orthographic,
    TransverseMercator,
    Mercator,
    /// About a point that is no pole.
    Stereographic,
    Sinusoidal,
    LambertConformal,
}

/// Its parameters. Those that a kind does not have are 0, and the scale 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ProjectionParameters {
    pub(crate) kind: ProjectionMethod,
    /// Latitude of the origin.
    pub(crate) lat0_deg: f64,
    /// Central meridian.
    pub(crate) lon0_deg: f64,
    /// Scale at the origin. That of a Mercator map is the one at the equator.
    pub(crate) scale: f64,
    /// Standard parallels of Lambert's conformal conic projection; with one of them, twice the same.
    pub(crate) parallels_deg: [f64; 2],
}

impl ProjectionParameters {
    /// Combines the parameters that most kinds have.
    pub(crate) fn new(kind: ProjectionMethod, lat0_deg: f64, lon0_deg: f64, scale: f64) -> Self {
        Self { kind, lat0_deg, lon0_deg, scale, parallels_deg: [0.0; 2] }
    }

    /// Reads the keys of a projected system; `None` for other projections, and for keys that are missing or contradict each other.
    pub(crate) fn of(crs: &Crs) -> Option<Self> {
        let first = |keys: &[u16]| keys.iter().find_map(|&key| crs.number(key));
        let lon0_deg = first(&[key::CENTRE_LON, key::NAT_ORIGIN_LON, key::FALSE_ORIGIN_LON, key::STRAIGHT_POLE_LON])
            .unwrap_or(0.0);
        let lat0_deg = first(&[key::CENTRE_LAT, key::NAT_ORIGIN_LAT, key::FALSE_ORIGIN_LAT]).unwrap_or(0.0);
        let scale = first(&[key::SCALE, key::SCALE_AT_CENTRE]).unwrap_or(1.0);
        let parallels = [key::STD_PARALLEL_1, key::STD_PARALLEL_2].map(|key| crs.number(key));
        let new = |kind, scale| Some(Self::new(kind, lat0_deg, lon0_deg, scale));
        let method = crs.number(key::METHOD)?;
        match (method as u16, parallels) {
            (code::ORTHOGRAPHIC, _) => new(ProjectionMethod::Orthographic, 1.0),
            (code::TRANSVERSE_MERCATOR, _) => new(ProjectionMethod::TransverseMercator, scale),
            (code::STEREOGRAPHIC | code::OBLIQUE_STEREOGRAPHIC, _) => new(ProjectionMethod::Stereographic, scale),
            (code::SINUSOIDAL, _) if lat0_deg == 0.0 => new(ProjectionMethod::Sinusoidal, 1.0),
            (code::MERCATOR, [None, _]) if lat0_deg == 0.0 => new(ProjectionMethod::Mercator, scale),
            (code::MERCATOR, [Some(lat_ts_deg), _]) if lat0_deg == 0.0 && scale == 1.0 => {
                new(ProjectionMethod::Mercator, lat_ts_deg.to_radians().cos())
            }
            (code::LAMBERT_1SP, [a, None]) if a.is_none_or(|a| a == lat0_deg) => {
                Some(Self { parallels_deg: [lat0_deg; 2], ..new(ProjectionMethod::LambertConformal, scale)? })
            }
            (code::LAMBERT_2SP, [Some(a), Some(b)]) if scale == 1.0 => {
                Some(Self { parallels_deg: [a, b], ..new(ProjectionMethod::LambertConformal, 1.0)? })
            }
            _ => None,
        }
    }

    /// Returns the number of the method and the keys that GDAL writes, without those of the false origin.
    pub(super) fn keys(&self) -> (u16, Vec<(u16, f64)>) {
        let Self { kind, lat0_deg: lat, lon0_deg: lon, scale, parallels_deg: [a, b] } = *self;
        let natural = || vec![(key::NAT_ORIGIN_LON, lon), (key::NAT_ORIGIN_LAT, lat), (key::SCALE, scale)];
        match kind {
            ProjectionMethod::Orthographic => {
                (code::ORTHOGRAPHIC, vec![(key::CENTRE_LON, lon), (key::CENTRE_LAT, lat)])
            }
            ProjectionMethod::TransverseMercator => (code::TRANSVERSE_MERCATOR, natural()),
            ProjectionMethod::Mercator => (code::MERCATOR, natural()),
            ProjectionMethod::Stereographic => {
                (code::STEREOGRAPHIC, vec![(key::CENTRE_LON, lon), (key::CENTRE_LAT, lat), (key::SCALE, scale)])
            }
            ProjectionMethod::Sinusoidal => (code::SINUSOIDAL, vec![(key::CENTRE_LON, lon)]),
            ProjectionMethod::LambertConformal if self.has_one_parallel() => (code::LAMBERT_1SP, natural()),
            ProjectionMethod::LambertConformal => {
                let parallels = [(key::STD_PARALLEL_1, a), (key::STD_PARALLEL_2, b)];
                (
                    code::LAMBERT_2SP,
                    [&parallels[..], &[(key::FALSE_ORIGIN_LON, lon), (key::FALSE_ORIGIN_LAT, lat)]].concat(),
                )
            }
        }
    }

    /// Returns whether the one standard parallel is the latitude of the origin, so that a scale can be stated.
    pub(crate) fn has_one_parallel(&self) -> bool {
        self.parallels_deg == [self.lat0_deg; 2]
    }
}
