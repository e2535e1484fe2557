//! Systems in messages.

use super::{Crs, MOON_RADIUS_M, code, key, method};
use crate::Projection;

impl Crs {
    /// Returns one line for messages: the projection, its parameters and the sphere.
    #[must_use]
    pub fn summary(&self) -> String {
        if self.is_empty() {
            return "no reference system".into();
        }
        let axes = match (self.axes_m(), self.epsg()) {
            (Some((a, b)), _) if a == b => format!("sphere {a} m"),
            (Some((a, b)), _) => format!("ellipsoid {a} m / {b} m"),
            (None, Some(code)) => format!("EPSG:{code}, an ellipsoid of the Earth"),
            (None, None) => "body unknown".into(),
        };
        if self.is_geographic() {
            return format!("longitude/latitude, {axes}");
        }
        if !self.is_projected() {
            return match self.cited() {
                Some(wkt) => format!("a system that only a text states ({})", shortened(&wkt)),
                None => "a system whose keys state neither a projection nor longitude/latitude".into(),
            };
        }
        let first = |keys: [u16; 4]| keys.into_iter().find_map(|key| self.number(key)).unwrap_or(0.0);
        let lon0 = first([key::CENTRE_LON, key::NAT_ORIGIN_LON, key::STRAIGHT_POLE_LON, key::FALSE_ORIGIN_LON]);
        let lat0 = first([key::STD_PARALLEL_1, key::NAT_ORIGIN_LAT, key::CENTRE_LAT, key::FALSE_ORIGIN_LAT]);
        let method = match (self.number(key::METHOD), self.number(key::PROJECTED_CRS)) {
            (Some(number), _) => method::name(number).map_or_else(|| format!("projection method {number}"), Into::into),
            (None, Some(number)) if number != f64::from(code::USER_DEFINED) => format!("EPSG:{number}"),
            _ => "unnamed projection".into(),
        };
        format!("{method}, lat {lat0} deg, lon {lon0} deg, {axes}")
    }

    /// Returns what to do with the file `name`, whose system is not supported, for the end of a message. `wanted` is the system of the file
    /// that it must fit, if that is supported.
    #[must_use]
    pub fn remedy(&self, name: &str, wanted: Option<&Crs>) -> String {
        let state = |srs: &str| {
            format!(
                "state it: --image-srs or --coarse-srs {srs}, or gdal_translate -a_srs {srs} {name} {name}.placed.tif"
            )
        };
        if self.is_of_the_earth() {
            return format!("a sphere is expected; if the coordinates are the Moon's, {}", state("IAU_2015:30100"));
        }
        if !self.is_geographic() && !self.is_projected() && self.cited().is_none() {
            return state("SRS");
        }
        let text = wanted.and_then(Projection::of).map(|projection| projection.proj_text()).unwrap_or_else(|| {
            let radius_m = self.axes_m().map_or(MOON_RADIUS_M, |(major, _)| major);
            format!("+proj=eqc +R={radius_m}")
        });
        format!("convert it: gdalwarp -t_srs '{text}' {name} {name}.warped.tif")
    }
}

/// Returns the name of the system and its projection, of WKT.
fn shortened(wkt: &str) -> String {
    let quoted = |from: &str| from.split('"').nth(1).map(|name| name.chars().take(60).collect::<String>());
    let name = quoted(wkt).unwrap_or_default();
    let method = ["PROJECTION[", "METHOD["].iter().find_map(|word| wkt.find(word)).and_then(|at| quoted(&wkt[at..]));
    method.map_or_else(|| name.clone(), |method| format!("{name}, projection {method}"))
}
