//! Projections as texts of PROJ.

use super::ported::Ported;
use super::{Method, Projection};
use crate::crs::ProjectionMethod;

impl Projection {
    /// Returns a text of PROJ, which GDAL's programs and [`crate::Crs::parse`] read.
    #[must_use]
    pub fn proj_text(&self) -> String {
        let map = match &self.method {
            Method::Geographic => return format!("+proj=longlat +R={}", self.radius_m),
            Method::Equirectangular { lat_ts_deg, lat0_deg, lon0_deg, .. } => {
                format!("eqc +lat_ts={lat_ts_deg} +lat_0={lat0_deg} +lon_0={lon0_deg}")
            }
            Method::PolarStereographic { sign, scale, lon0_deg } => {
                format!("stere +lat_0={} +lon_0={lon0_deg} +k={scale}", 90.0 * sign)
            }
            Method::Ported(ported) => {
                let p = ported.parameters();
                let (name, [a, b]) = (Ported::name(p.kind), p.parallels_deg);
                let (lat0, lon0, scale) = (p.lat0_deg, p.lon0_deg, p.scale);
                match p.kind {
                    ProjectionMethod::Sinusoidal => format!("{name} +lon_0={lon0}"),
                    ProjectionMethod::Mercator => format!("{name} +lon_0={lon0} +k={scale}"),
                    ProjectionMethod::Orthographic => format!("{name} +lat_0={lat0} +lon_0={lon0}"),
                    ProjectionMethod::LambertConformal if p.has_one_parallel() => {
                        format!("{name} +lat_1={a} +lat_0={lat0} +lon_0={lon0} +k_0={scale}")
                    }
                    ProjectionMethod::LambertConformal => {
                        format!("{name} +lat_1={a} +lat_2={b} +lat_0={lat0} +lon_0={lon0}")
                    }
                    ProjectionMethod::TransverseMercator | ProjectionMethod::Stereographic => {
                        format!("{name} +lat_0={lat0} +lon_0={lon0} +k={scale}")
                    }
                }
            }
        };
        let mut text = format!("+proj={map} +R={}", self.radius_m);
        // In PROJ, false origins are in metres, whatever the unit of the map.
        for (name, value) in [("x_0", self.false_origin.0), ("y_0", self.false_origin.1)] {
            if value != 0.0 {
                text += &format!(" +{name}={}", value * self.unit_m);
            }
        }
        match self.unit_m {
            1.0 => text,
            1000.0 => text + " +units=km",
            unit_m => format!("{text} +to_meter={unit_m}"),
        }
    }
}
