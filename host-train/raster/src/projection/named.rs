//! Projections by the names that labels of the PDS have.

use super::{Method, Projection};
use crate::crs::ProjectionMethod;
use crate::named_map::NamedMap;

impl Projection {
    /// Returns name and parameters of the map in metres without false origin, as [`NamedMap::crs`] reads them. A map of degrees is the
    /// equirectangular one of the equator. `None` for maps that have no name there.
    pub(crate) fn named(&self) -> Option<NamedMap> {
        let map = |name: &str, lat_deg, origin_deg, lon_deg, scale, parallels_deg| NamedMap {
            name: name.into(),
            lat_deg,
            origin_deg,
            lon_deg,
            scale,
            parallels_deg,
        };
        Some(match &self.method {
            Method::Geographic => map("Equirectangular", 0.0, 0.0, 0.0, 1.0, None),
            &Method::Equirectangular { lat_ts_deg, lat0_deg, lon0_deg, .. } => {
                map("Equirectangular", lat_ts_deg, lat0_deg, lon0_deg, 1.0, None)
            }
            &Method::PolarStereographic { sign, scale, lon0_deg } => {
                map("Polar Stereographic", 90.0 * sign, 90.0 * sign, lon0_deg, scale, None)
            }
            Method::Ported(ported) => {
                let p = ported.parameters();
                let of = |name, parallels| map(name, p.lat0_deg, p.lat0_deg, p.lon0_deg, p.scale, parallels);
                match p.kind {
                    ProjectionMethod::Orthographic => of("Orthographic", None),
                    ProjectionMethod::TransverseMercator => of("Transverse Mercator", None),
                    ProjectionMethod::Mercator => of("Mercator", None),
                    ProjectionMethod::Sinusoidal => of("Sinusoidal", None),
                    ProjectionMethod::LambertConformal if p.scale == 1.0 => {
                        of("Lambert Conformal Conic", Some(p.parallels_deg))
                    }
                    ProjectionMethod::LambertConformal | ProjectionMethod::Stereographic => return None,
                }
            }
        })
    }

    /// Returns a point of this map in metres, without false origin: on [`Projection::named`].
    pub(crate) fn in_metres(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let unit_m = match self.method {
            Method::Geographic => self.radius_m.to_radians(),
            _ => self.unit_m,
        };
        ((x - self.false_origin.0) * unit_m, (y - self.false_origin.1) * unit_m)
    }
}
