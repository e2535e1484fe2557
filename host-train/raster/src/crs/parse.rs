//! Reference systems as users write them on the command line.

use super::build::Axes;
use super::{Crs, MOON_RADIUS_M};
use crate::{Error, Result};
use std::collections::BTreeMap;

/// Bodies of `IAU_2015` codes: NAIF number, and radius of the sphere in metres (IAU working group, 2015).
const IAU_BODIES: [(u32, f64); 2] = [(301, MOON_RADIUS_M), (499, 3_396_190.0)];

/// PROJ parameters without effect here.
const IDLE: [&str; 4] = ["no_defs", "type", "wktext", "over"];

impl Crs {
    /// Reads `IAU_2015:30100` (longitude and latitude), `:30110`/`:30115` (equirectangular, central meridian 0 or 180), `:30130`/`:30135`
    /// (polar stereographic, north or south), the same with 499 for Mars, or a PROJ text: `+proj=longlat`, `+proj=eqc` with
    /// `+lat_ts +lat_0 +lon_0`, `+proj=stere` with `+lat_0=±90` and `+lat_ts` or `+k_0`; always with `+R` (or equal `+a` and `+b`), metres.
    ///
    /// # Errors
    /// [`Error::Usage`] for anything else, with the accepted forms.
    pub fn parse(text: &str) -> Result<Self> {
        let text = text.trim();
        if text.starts_with('+') {
            return Proj::new(text)?.crs();
        }
        let code = text.split_once(':').filter(|(authority, _)| authority.eq_ignore_ascii_case("IAU_2015"));
        let (naif, kind) = code.and_then(|(_, code)| Some((code.get(..3)?, code.get(3..)?))).unwrap_or_default();
        let radius_m = IAU_BODIES.iter().find(|(number, _)| number.to_string() == naif).map(|&(_, radius_m)| radius_m);
        let polar = |radius_m, lat| Self::polar_stereographic(radius_m, lat, 1.0, 0.0, Axes::PLAIN);
        match (radius_m, kind) {
            (Some(radius_m), "00") => Ok(Self::geographic(radius_m)),
            (Some(radius_m), "10") => Ok(Self::equirectangular(radius_m, 0.0, (0.0, 0.0), Axes::PLAIN)),
            (Some(radius_m), "15") => Ok(Self::equirectangular(radius_m, 0.0, (0.0, 180.0), Axes::PLAIN)),
            (Some(radius_m), "30") => Ok(polar(radius_m, 90.0)),
            (Some(radius_m), "35") => Ok(polar(radius_m, -90.0)),
            _ => {
                let hint =
                    if text.contains('[') { " (for WKT: gdalsrsinfo -o proj4 FILE gives such a text)" } else { "" };
                Err(Error::usage(format!(
                    "reference system: IAU_2015:30100, :30110, :30115, :30130, :30135 or a text like '+proj=eqc +lat_ts=0 +lon_0=180 +R=1737400' expected, {text:?} found{hint}"
                )))
            }
        }
    }
}

/// A PROJ text, parameter by parameter. Parameters that were read are removed, so that unknown ones can be refused.
struct Proj<'a> {
    text: &'a str,
    values: BTreeMap<&'a str, &'a str>,
}

impl<'a> Proj<'a> {
    fn new(text: &'a str) -> Result<Self> {
        let mut values = BTreeMap::new();
        for word in text.split_whitespace() {
            let (name, value) =
                word.trim_start_matches('+').split_once('=').unwrap_or((word.trim_start_matches('+'), ""));
            if values.insert(name, value).is_some() {
                return Err(Error::usage(format!("reference system {text:?}: +{name} once expected, twice found")));
            }
        }
        values.retain(|name, _| !IDLE.contains(name));
        Ok(Self { text, values })
    }

    fn error(&self, expected: &str) -> Error {
        Error::usage(format!("reference system {:?}: {expected}", self.text))
    }

    fn number(&mut self, name: &str) -> Result<Option<f64>> {
        let Some(value) = self.values.remove(name) else { return Ok(None) };
        match value.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(Some(number)),
            _ => Err(self.error(&format!("a number expected in +{name}, {value:?} found"))),
        }
    }

    fn radius_m(&mut self) -> Result<f64> {
        let (radius, a, b) = (self.number("R")?, self.number("a")?, self.number("b")?);
        match (radius, a, b) {
            (Some(radius), None, None) | (None, Some(radius), None) if radius > 0.0 => Ok(radius),
            (None, Some(a), Some(b)) if a > 0.0 && a == b => Ok(a),
            _ => Err(self.error("one sphere expected: +R=1737400 for the Moon")),
        }
    }

    fn axes(&mut self) -> Result<Axes> {
        let kilometres = match self.values.remove("units") {
            None | Some("m") => false,
            Some("km") => true,
            Some(other) => return Err(self.error(&format!("+units=m or km expected, {other:?} found"))),
        };
        // In PROJ, false origins are in metres, whatever the unit of the map.
        let unit_m = if kilometres { 1000.0 } else { 1.0 };
        let mut origin = |name| Ok(self.number(name)?.unwrap_or(0.0) / unit_m);
        Ok(Axes { false_easting: origin("x_0")?, false_northing: origin("y_0")?, kilometres })
    }

    fn crs(mut self) -> Result<Crs> {
        let name = self.values.remove("proj").unwrap_or_default();
        let radius_m = self.radius_m()?;
        let crs = match name {
            "longlat" | "latlong" | "lonlat" | "latlon" => Crs::geographic(radius_m),
            "eqc" => {
                let lat_ts_deg = self.number("lat_ts")?.unwrap_or(0.0);
                let origin_deg = (self.number("lat_0")?.unwrap_or(0.0), self.number("lon_0")?.unwrap_or(0.0));
                if lat_ts_deg.abs() >= 90.0 {
                    return Err(self.error("a standard parallel (+lat_ts) within 90 degrees of the equator expected"));
                }
                Crs::equirectangular(radius_m, lat_ts_deg, origin_deg, self.axes()?)
            }
            "stere" => self.polar(radius_m)?,
            other => return Err(self.error(&format!("+proj=longlat, eqc or stere expected, {other:?} found"))),
        };
        match self.values.keys().next() {
            Some(left) => Err(self.error(&format!("+{left} is not known here"))),
            None => Ok(crs),
        }
    }

    fn polar(&mut self, radius_m: f64) -> Result<Crs> {
        let lat0_deg = self.number("lat_0")?.unwrap_or(0.0);
        if lat0_deg.abs() != 90.0 {
            return Err(self.error("+lat_0=90 or -90 expected: only polar stereographic maps are known"));
        }
        let (lat_ts_deg, lon0_deg) = (self.number("lat_ts")?.unwrap_or(lat0_deg), self.number("lon_0")?.unwrap_or(0.0));
        let scale = match (self.number("k")?, self.number("k_0")?) {
            (None, None) => 1.0,
            (Some(k), None) | (None, Some(k)) if k > 0.0 => k,
            _ => return Err(self.error("one positive +k_0 expected")),
        };
        if lat_ts_deg * lat0_deg <= 0.0 || lat_ts_deg.abs() > 90.0 || scale != 1.0 && lat_ts_deg != lat0_deg {
            return Err(self.error("+lat_ts between the equator and the pole, or +k_0, expected"));
        }
        Ok(Crs::polar_stereographic(radius_m, lat_ts_deg, scale, lon0_deg, self.axes()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Projection;

    #[test]
    fn codes_and_texts_mean_the_same() {
        for (code, text) in [
            ("IAU_2015:30100", "+proj=longlat +R=1737400 +no_defs"),
            ("iau_2015:30110", "+proj=eqc +R=1737400"),
            (
                "IAU_2015:30115",
                "+proj=eqc +lat_ts=0 +lat_0=0 +lon_0=180 +x_0=0 +y_0=0 +a=1737400 +b=1737400 +units=m +type=crs",
            ),
            ("IAU_2015:30130", "+proj=stere +lat_0=90 +lon_0=0 +k=1 +R=1737400 +units=m"),
            (" IAU_2015:30135", "+proj=stere +lat_0=-90 +lat_ts=-90 +R=1737400"),
            ("IAU_2015:49910", "+proj=eqc +R=3396190"),
        ] {
            let (a, b) = (Crs::parse(code).unwrap(), Crs::parse(text).unwrap());
            assert!(a.same_as(&b) && Projection::of(&a).is_some(), "{code}: {} and {}", a.summary(), b.summary());
            assert_eq!((a.defect(), b.defect()), (None, None));
        }
        assert!(Crs::parse("IAU_2015:30110").unwrap().same_as(&Crs::moon_equirectangular(0.0, 0.0)));
        assert!(Crs::parse("IAU_2015:30135").unwrap().same_as(&Crs::moon_polar(true)));
    }

    #[test]
    fn what_is_not_understood_is_refused_with_a_hint() {
        for (text, hint) in [
            ("", "IAU_2015:30100"),
            ("EPSG:4326", "EPSG:4326"),
            ("IAU_2015:30120", "IAU_2015:30120"),
            ("IAU_2015:3\u{e9}1", "expected"),
            ("PROJCS[\"x\"]", "gdalsrsinfo"),
            ("+proj=eqc", "+R="),
            ("+proj=eqc +R=x", "a number"),
            ("+proj=eqc +R=inf", "a number"),
            ("+proj=eqc +a=2 +b=3", "one sphere"),
            ("+proj=eqc +R=1737400 +lat_ts=90", "lat_ts"),
            ("+proj=eqc +R=1737400 +R=1", "twice"),
            ("+proj=eqc +R=1737400 +units=ft", "units"),
            ("+proj=eqc +R=1737400 +pm=12", "+pm"),
            ("+proj=merc +R=1737400", "longlat, eqc or stere"),
            ("+proj=stere +lat_0=45 +R=1737400", "polar"),
            ("+proj=stere +lat_0=90 +lat_ts=-70 +R=1737400", "lat_ts"),
            ("+proj=stere +lat_0=90 +k=1 +k_0=1 +R=1737400", "k_0"),
        ] {
            let error = Crs::parse(text).unwrap_err().to_string();
            assert!(error.contains(hint), "{text}: {error}");
        }
    }
}
