//! Reference systems as users write them on the command line.

use super::build::Axes;
use super::method::{ProjectionMethod, ProjectionParameters};
use super::{Crs, body};
use crate::Projection;
use elunar_base::{Error, Result};
use elunar_core::sun::Body;
use std::collections::BTreeMap;

/// Bodies of `IAU_2015` codes, and their NAIF numbers.
const IAU_BODIES: [(u32, Body); 2] = [(301, Body::Moon), (499, Body::Mars)];

/// PROJ parameters without effect here.
const IDLE: [&str; 4] = ["no_defs", "type", "wktext", "over"];

/// Deepest brackets and greatest length, bytes, of WKT that is read. WKT of a projected system is at most 8 deep. Its reader recurses.
const DEEPEST: usize = 12;
const LONGEST: usize = 1 << 14;

/// A degree in WKT.
const DEGREE: &str = "0.01745329";

impl Crs {
    /// Reads a code of `IAU_2015` for the Moon (30100 and so on) or Mars (49900), WKT, or a PROJ text on a sphere (`+R`, or equal `+a` and
    /// `+b`; metres): `+proj=longlat`, `eqc` with `+lat_ts +lat_0 +lon_0`, `stere` or `sterea` with `+lat_0 +lon_0` and `+k_0`, at a pole also
    /// with `+lat_ts`, `ortho`, `tmerc`, `merc`, `sinu`, `lcc`.
    ///
    /// # Errors
    /// [`Error::Usage`] for anything else, with the accepted forms.
    pub fn parse(text: &str) -> Result<Self> {
        let text = text.trim();
        if text.starts_with('+') {
            return Proj::new(text)?.crs();
        }
        if text.contains('[') {
            return of_wkt(text);
        }
        of_code(text).map_or_else(
            || {
                let forms = "an IAU_2015 code as IAU_2015:30100 (longitude/latitude), :30110, :30115 (equirectangular), :30130, :30135 (polar) or a text like '+proj=eqc +lat_ts=0 +lon_0=180 +R=1737400'";
                Err(Error::usage(format!("reference system: {forms} expected, {text:?} found")))
            },
            |text| Proj::new(&text)?.crs(),
        )
    }
}

/// Returns the PROJ text of a code of `IAU_2015`, as PROJ's own table has it.
fn of_code(text: &str) -> Option<String> {
    let (_, code) = text.split_once(':').filter(|(authority, _)| authority.eq_ignore_ascii_case("IAU_2015"))?;
    let (naif, kind) = (code.get(..3)?, code.get(3..)?);
    let (_, body) = IAU_BODIES.into_iter().find(|(number, _)| number.to_string() == naif)?;
    let map = match kind {
        "00" => "longlat",
        "10" => "eqc",
        "15" => "eqc +lon_0=180",
        "20" => "sinu",
        "25" => "sinu +lon_0=180",
        "30" => "stere +lat_0=90",
        "35" => "stere +lat_0=-90",
        "60" => "tmerc",
        "65" => "ortho",
        "70" => "ortho +lon_0=180",
        "75" => "lcc +lat_0=40 +lat_1=20 +lat_2=60",
        "90" => "merc",
        _ => return None,
    };
    Some(format!("+proj={map} +R={}", body.radius_m()))
}

/// Returns how deep the brackets of a text are nested.
fn nesting(text: &str) -> usize {
    let mut depth = 0_usize;
    let depths = text.bytes().map(|byte| {
        match byte {
            b'[' | b'(' => depth += 1,
            b']' | b')' => depth = depth.saturating_sub(1),
            _ => {}
        }
        depth
    });
    depths.max().unwrap_or(0)
}

/// Reads WKT, version 1 or 2.
fn of_wkt(text: &str) -> Result<Crs> {
    let refused = |why: String| {
        let start: String = text.chars().take(60).collect();
        let hint = "gdalsrsinfo -o proj4 FILE gives a text that is shorter";
        Error::usage(format!(
            "reference system: WKT of a known projection on a sphere expected, {start:?}... found ({why}; {hint})"
        ))
    };
    if nesting(text) > DEEPEST || text.len() > LONGEST {
        return Err(refused(format!("more than {DEEPEST} brackets deep, or longer than {LONGEST} bytes")));
    }
    let proj = proj4wkt::wkt_to_projstring(text).map_err(|error| refused(error.to_string()))?;
    // The crate reads every geographic system as degrees.
    if proj.starts_with("+proj=longlat") && !text.contains(DEGREE) {
        return Err(refused(format!("a unit of {DEGREE}... radians expected")));
    }
    Proj::new(&proj).and_then(Proj::crs).map_err(|error| refused(error.to_string()))
}

/// A PROJ text, parameter by parameter. ProjectionParameters that were read are removed, so that unknown ones can be refused.
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
            (Some(radius), None, None) | (None, Some(radius), None) if body::is_sound((radius, radius)) => Ok(radius),
            (None, Some(a), Some(b)) if body::is_sound((a, b)) && a == b => Ok(a),
            _ => Err(self.error("one sphere expected: +R=1737400 for the Moon")),
        }
    }

    fn axes(&mut self) -> Result<Axes> {
        let kilometres = match (self.values.remove("units"), self.number("to_meter")?) {
            (None | Some("m"), None) | (None, Some(1.0)) => false,
            (Some("km"), None) | (None, Some(1000.0)) => true,
            (None, Some(factor)) => return Err(self.error(&format!("+to_meter=1 or 1000 expected, {factor} found"))),
            (Some(other), _) => return Err(self.error(&format!("+units=m or km expected, {other:?} found"))),
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
                Crs::equirectangular_from(radius_m, lat_ts_deg, origin_deg, self.axes()?)
            }
            "stere" | "sterea" => self.stereographic(radius_m)?,
            _ => self.ported(name, radius_m)?,
        };
        match self.values.keys().next() {
            Some(left) => Err(self.error(&format!("+{left} is not known here"))),
            None if Projection::of(&crs).is_none() => Err(self.error("parameters that make a map expected")),
            None => Ok(crs),
        }
    }

    fn scale(&mut self) -> Result<f64> {
        match (self.number("k")?, self.number("k_0")?) {
            (None, None) => Ok(1.0),
            (Some(k), None) | (None, Some(k)) if k > 0.0 => Ok(k),
            _ => Err(self.error("one positive +k_0 expected")),
        }
    }

    fn stereographic(&mut self, radius_m: f64) -> Result<Crs> {
        let (lat0_deg, lon0_deg) = (self.number("lat_0")?.unwrap_or(0.0), self.number("lon_0")?.unwrap_or(0.0));
        let scale = self.scale()?;
        if lat0_deg.abs() != 90.0 {
            let parameters = ProjectionParameters::new(ProjectionMethod::Stereographic, lat0_deg, lon0_deg, scale);
            return Ok(Crs::ported(radius_m, parameters, self.axes()?));
        }
        let lat_ts_deg = self.number("lat_ts")?.unwrap_or(lat0_deg);
        if lat_ts_deg * lat0_deg <= 0.0 || lat_ts_deg.abs() > 90.0 || scale != 1.0 && lat_ts_deg != lat0_deg {
            return Err(self.error("+lat_ts between the equator and the pole, or +k_0, expected"));
        }
        Ok(Crs::polar_stereographic(radius_m, lat_ts_deg, scale, lon0_deg, self.axes()?))
    }

    fn ported(&mut self, name: &str, radius_m: f64) -> Result<Crs> {
        let (lat0, lon0_deg) = (self.number("lat_0")?, self.number("lon_0")?.unwrap_or(0.0));
        let lat0_deg = lat0.unwrap_or(0.0);
        let on_equator = |proj: &Self| match lat0_deg {
            0.0 => Ok(()),
            _ => Err(proj.error("+lat_0=0 expected")),
        };
        let parameters = match name {
            "ortho" => {
                if self.scale()? != 1.0 || self.number("alpha")?.unwrap_or(0.0) != 0.0 {
                    return Err(self.error("+k_0=1 and +alpha=0 expected"));
                }
                ProjectionParameters::new(ProjectionMethod::Orthographic, lat0_deg, lon0_deg, 1.0)
            }
            "tmerc" => {
                ProjectionParameters::new(ProjectionMethod::TransverseMercator, lat0_deg, lon0_deg, self.scale()?)
            }
            "sinu" => {
                on_equator(self)?;
                ProjectionParameters::new(ProjectionMethod::Sinusoidal, 0.0, lon0_deg, 1.0)
            }
            "merc" => {
                on_equator(self)?;
                // Only PROJ's tables have it, and on a sphere it changes nothing.
                self.values.remove("R_C");
                let scale = match (self.number("lat_ts")?, self.scale()?) {
                    (None, scale) => scale,
                    (Some(lat_ts_deg), 1.0) if lat_ts_deg.abs() < 90.0 => lat_ts_deg.to_radians().cos(),
                    _ => return Err(self.error("+lat_ts within 90 degrees of the equator, or +k_0, expected")),
                };
                ProjectionParameters::new(ProjectionMethod::Mercator, 0.0, lon0_deg, scale)
            }
            "lcc" => self.lambert(lat0, lon0_deg)?,
            other => {
                let known = "+proj=longlat, eqc, stere, ortho, tmerc, merc, sinu or lcc";
                return Err(self.error(&format!("{known} expected, {other:?} found")));
            }
        };
        Ok(Crs::ported(radius_m, parameters, self.axes()?))
    }

    /// With one standard parallel, it is the latitude of the origin unless that is stated, as in PROJ.
    fn lambert(&mut self, lat0: Option<f64>, lon0_deg: f64) -> Result<ProjectionParameters> {
        let (a, b, scale) = (self.number("lat_1")?.unwrap_or(0.0), self.number("lat_2")?, self.scale()?);
        let lat0_deg = lat0.unwrap_or(if b.is_none() { a } else { 0.0 });
        let parallels_deg = [a, b.unwrap_or(a)];
        let parameters = ProjectionParameters {
            parallels_deg,
            ..ProjectionParameters::new(ProjectionMethod::LambertConformal, lat0_deg, lon0_deg, scale)
        };
        if scale != 1.0 && !parameters.has_one_parallel() {
            return Err(self.error("+k_0 only where +lat_1 is +lat_0 expected"));
        }
        Ok(parameters)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            ("IAU_2015:30125", "+proj=sinu +lon_0=180 +R=1737400"),
            ("IAU_2015:30165", "+proj=ortho +lat_0=0 +R=1737400"),
            ("IAU_2015:30175", "+proj=lcc +lat_0=40 +lat_1=20 +lat_2=60 +R=1737400"),
            ("IAU_2015:30190", "+proj=merc +R_C +lat_0=0 +lat_ts=0 +R=1737400"),
        ] {
            let (a, b) = (Crs::parse(code).unwrap(), Crs::parse(text).unwrap());
            assert!(a.same_as(&b) && Projection::of(&a).is_some(), "{code}: {} and {}", a.summary(), b.summary());
            assert_eq!((a.defect(), b.defect()), (None, None));
        }
        assert!(Crs::parse("IAU_2015:30110").unwrap().same_as(&Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0)));
        assert!(Crs::parse("IAU_2015:30135").unwrap().same_as(&Crs::polar(Body::Moon.radius_m(), true)));
    }

    #[test]
    fn wkt_is_read() {
        let geographic =
            "BASEGEOGCRS[\"m\",DATUM[\"m\",ELLIPSOID[\"m\",1737400,0,LENGTHUNIT[\"metre\",1]]],PRIMEM[\"m\",0]]";
        let map = "CONVERSION[\"c\",METHOD[\"Orthographic\",ID[\"EPSG\",9840]],PARAMETER[\"Latitude of natural origin\",10,ANGLEUNIT[\"degree\",0.0174532925199433]]]";
        let crs =
            Crs::parse(&format!("PROJCRS[\"x\",{geographic},{map},CS[Cartesian,2],LENGTHUNIT[\"metre\",1]]")).unwrap();
        assert!(crs.same_as(&Crs::parse("+proj=ortho +lat_0=10 +R=1737400").unwrap()), "{}", crs.summary());
        let deep = format!("PROJCS[\"x\",{}1{}]", "A[".repeat(20_000), "]".repeat(20_000));
        assert!(Crs::parse(&deep).unwrap_err().to_string().contains("brackets deep"));
        let long = format!("PROJCS[\"{}\"]", "x".repeat(LONGEST));
        assert!(Crs::parse(&long).unwrap_err().to_string().contains("longer than 16384 bytes"));
    }

    #[test]
    fn what_is_not_understood_is_refused_with_a_hint() {
        for (text, hint) in [
            ("", "IAU_2015:30100"),
            ("EPSG:4326", "EPSG:4326"),
            ("IAU_2015:30140", "IAU_2015:30140"),
            ("IAU_2015:3\u{e9}1", "expected"),
            ("PROJCS[\"x\"]", "gdalsrsinfo"),
            ("+proj=eqc", "+R="),
            ("+proj=eqc +R=x", "a number"),
            ("+proj=eqc +R=inf", "a number"),
            ("+proj=eqc +a=2 +b=3", "one sphere"),
            ("+proj=eqc +a=0 +b=0", "one sphere"),
            ("+proj=eqc +R=1737400 +lat_ts=90", "lat_ts"),
            ("+proj=eqc +R=1737400 +R=1", "twice"),
            ("+proj=eqc +R=1737400 +units=ft", "units"),
            ("+proj=eqc +R=1737400 +pm=12", "+pm"),
            ("+proj=eqc +R=1e300", "one sphere"),
            ("+proj=eqc +R=1737400 +to_meter=0.3048", "to_meter"),
            ("+proj=moll +R=1737400", "sinu or lcc expected, \"moll\" found"),
            ("+proj=ortho +lat_0=95 +R=1737400", "parameters that make a map"),
            ("+proj=ortho +alpha=3 +R=1737400", "+alpha"),
            ("+proj=tmerc +k=0 +R=1737400", "k_0"),
            ("+proj=merc +lat_ts=90 +R=1737400", "lat_ts"),
            ("+proj=merc +lat_0=10 +R=1737400", "+lat_0=0"),
            ("+proj=lcc +lat_1=30 +lat_2=-30 +R=1737400", "parameters that make a map"),
            ("+proj=lcc +R=1737400", "parameters that make a map"),
            ("+proj=lcc +lat_1=30 +lat_0=35 +k_0=0.99 +R=1737400", "k_0"),
            ("+proj=stere +lat_0=45 +lat_ts=40 +R=1737400", "+lat_ts"),
            ("+proj=stere +lat_0=95 +R=1737400", "parameters that make a map"),
            ("+proj=stere +lat_0=90 +lat_ts=-70 +R=1737400", "lat_ts"),
            ("+proj=stere +lat_0=90 +lat_ts=95 +R=1737400", "lat_ts"),
            ("+proj=stere +lat_0=90 +lat_ts=80 +k=0.9 +R=1737400", "lat_ts"),
            ("+proj=stere +lat_0=90 +k=1 +k_0=1 +R=1737400", "k_0"),
            ("+proj=ortho +k_0=0.9 +R=1737400", "+k_0=1"),
        ] {
            let error = Crs::parse(text).unwrap_err().to_string();
            assert!(error.contains(hint), "{text}: {error}");
        }
    }
}
