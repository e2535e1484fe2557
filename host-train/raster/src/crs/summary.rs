//! Systems in messages.

use super::{Crs, body, key, method};
use crate::Projection;
use elunar_core::sun::Body;

impl Crs {
    /// Returns one line for messages: the projection, its parameters and the sphere.
    #[must_use]
    pub fn summary(&self) -> String {
        if self.is_empty() {
            return "no reference system".into();
        }
        let axes = match (self.axes_m(), self.epsg()) {
            (Some((a, b)), _) if a == b => format!("sphere {a} m"),
            (Some((a, b)), None) => format!("ellipsoid {a} m / {b} m"),
            (Some((a, b)), Some(code)) => format!("ellipsoid {a} m / {b} m of EPSG:{code}"),
            (None, Some(code)) => format!("an ellipsoid of the Earth, EPSG:{code}"),
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
        if self.number(key::METHOD).is_none()
            && let Some(code) = self.epsg()
        {
            return format!("EPSG:{code}, a map of the Earth");
        }
        let first = |keys: [u16; 4]| keys.into_iter().find_map(|key| self.number(key)).unwrap_or(0.0);
        let lon0 = first([key::CENTRE_LON, key::NAT_ORIGIN_LON, key::STRAIGHT_POLE_LON, key::FALSE_ORIGIN_LON]);
        let lat0 = first([key::STD_PARALLEL_1, key::NAT_ORIGIN_LAT, key::CENTRE_LAT, key::FALSE_ORIGIN_LAT]);
        let method = match self.number(key::METHOD) {
            Some(number) => method::name(number).map_or_else(|| format!("projection method {number}"), Into::into),
            None => "unnamed projection".into(),
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
            let srs = if self.is_geographic() { "IAU_2015:30100" } else { "SRS" };
            return format!("a sphere is expected; if the coordinates are the Moon's, {}", state(srs));
        }
        if !self.is_geographic() && !self.is_projected() && self.cited().is_none() {
            return state("SRS");
        }
        let text = wanted.and_then(Projection::of).map(|projection| projection.proj_text()).unwrap_or_else(|| {
            let cited = || self.cited().and_then(|wkt| radius_m(&wkt));
            let radius_m = self.axes_m().map(|(major, _)| major).or_else(cited).unwrap_or(Body::Moon.radius_m());
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

/// Returns the semi-major axis, metres, of WKT: the second entry of its spheroid.
fn radius_m(wkt: &str) -> Option<f64> {
    let at = ["SPHEROID[", "ELLIPSOID["].iter().find_map(|word| wkt.find(word))?;
    wkt[at..].split('"').nth(2)?.split(',').nth(1)?.trim().parse().ok().filter(|&axis| body::is_sound((axis, axis)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(pairs: &[(u16, u16)]) -> Crs {
        let entries = pairs.iter().flat_map(|&(key, value)| [key, 0, 1, value]);
        Crs { directory: [1, 1, 0, pairs.len() as u16].into_iter().chain(entries).collect(), ..Crs::default() }
    }

    #[test]
    fn systems_are_named() {
        let degrees = keys(&[(1024, 2), (2048, 4326)]);
        assert_eq!(degrees.summary(), "longitude/latitude, an ellipsoid of the Earth, EPSG:4326");
        assert!(degrees.remedy("a.tif", None).contains("gdal_translate -a_srs IAU_2015:30100 a.tif a.tif.placed.tif"));
        let utm = keys(&[(1024, 1), (3072, 32633)]);
        assert_eq!(utm.summary(), "EPSG:32633, a map of the Earth");
        assert!(utm.remedy("a.tif", None).contains("-a_srs SRS"), "{}", utm.remedy("a.tif", None));
        assert!(keys(&[(1024, 3)]).summary().starts_with("a system whose keys state neither"));
        for (method, name) in
            [(21, "orthographic"), (23, "Robinson"), (28, "cylindrical equal area"), (77, "projection method 77")]
        {
            let map = keys(&[(1024, 1), (3072, 32767), (3075, method)]);
            assert!(map.summary().starts_with(&format!("{name}, lat 0 deg")), "{}", map.summary());
        }
        let text = "ESRI PE String = PROJCS[\"m\",GEOGCS[\"m\",DATUM[\"m\",SPHEROID[\"m\",3396190.0,0.0]]],PROJECTION[\"Mollweide\"]]|";
        let mars = Crs {
            directory: vec![1, 1, 0, 2, 1024, 0, 1, 32767, 3073, 34737, text.len() as u16, 0],
            doubles: vec![],
            ascii: text.into(),
        };
        assert_eq!(mars.summary(), "a system that only a text states (m, projection Mollweide)");
        assert_eq!(
            mars.remedy("m.tif", None),
            "convert it: gdalwarp -t_srs '+proj=eqc +R=3396190' m.tif m.tif.warped.tif"
        );
    }

    #[test]
    fn systems_that_say_little_are_named() {
        assert_eq!(Crs::default().summary(), "no reference system");
        let state = "state it: --image-srs or --coarse-srs SRS, or gdal_translate -a_srs SRS a.tif a.tif.placed.tif";
        assert_eq!(keys(&[(1024, 3)]).remedy("a.tif", None), state);
        let unnamed = keys(&[(1024, 1), (3072, 32767)]);
        assert_eq!(unnamed.summary(), "unnamed projection, lat 0 deg, lon 0 deg, body unknown");
        // An ellipsoid in radians.
        let mut mars = keys(&[(1024, 2), (2054, 9101)]);
        mars.directory.extend([2057, 34736, 1, 0, 2058, 34736, 1, 1]);
        mars.directory[3] += 2;
        mars.doubles = vec![3_396_190.0, 3_376_200.0];
        assert_eq!(mars.summary(), "longitude/latitude, ellipsoid 3396190 m / 3376200 m");
        let text = "convert it: gdalwarp -t_srs '+proj=eqc +R=3396190' a.tif a.tif.warped.tif";
        assert_eq!(mars.remedy("a.tif", None), text);
    }
}
