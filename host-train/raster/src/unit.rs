//! Units of heights.

use elunar_core::sun::Body;

/// Metres in a foot of the United States' surveys, 39.37 inches to the metre.
const US_SURVEY_FOOT_M: f64 = 1200.0 / 3937.0;

/// Words for "no unit".
const NONE: [&str; 8] = ["", "n/a", "na", "none", "null", "unk", "unknown", "not applicable"];

/// Names of units that are read, for messages.
pub(crate) const KNOWN: &str = "m, km, cm, mm, ft or US survey foot";

/// Returns metres per unit of length, for the names that GDAL, ESRI and labels use; `None` for another name.
pub(crate) fn metres_per(unit: &str) -> Option<f64> {
    let plain = unit.to_lowercase().replace(['_', '-'], " ").replace('.', "");
    let words: Vec<&str> = plain.split_whitespace().collect();
    Some(match words.join(" ").as_str() {
        "m" | "metre" | "metres" | "meter" | "meters" => 1.0,
        "km" | "kilometre" | "kilometres" | "kilometer" | "kilometers" => 1000.0,
        "dm" | "decimetre" | "decimetres" | "decimeter" | "decimeters" => 0.1,
        "cm" | "centimetre" | "centimetres" | "centimeter" | "centimeters" => 0.01,
        "mm" | "millimetre" | "millimetres" | "millimeter" | "millimeters" => 0.001,
        "ft" | "foot" | "feet" | "international foot" | "international feet" | "foot (international)" => 0.3048,
        "us survey foot" | "us survey feet" | "us survey ft" | "us foot" | "us feet" | "us ft" | "usft" | "ftus"
        | "ft us" | "foot us" | "feet us" | "survey foot" | "survey feet" | "foot (us survey)" => US_SURVEY_FOOT_M,
        _ => return None,
    })
}

/// Returns the name of a vertical unit of GeoTIFF (key 4099, EPSG): those of [`metres_per`], otherwise its number.
pub(crate) fn of_code(code: u16) -> String {
    match code {
        9001 => "metre".into(),
        9002 => "foot".into(),
        9003 => "US survey foot".into(),
        9036 => "kilometre".into(),
        1033 => "centimetre".into(),
        1025 => "millimetre".into(),
        _ => format!("EPSG {code}"),
    }
}

/// Returns the unit of a vertical reference system of GeoTIFF (key 4096, EPSG) with heights or depths in feet; `None` for metres and unknown systems.
pub(crate) fn of_vertical_system(code: u16) -> Option<&'static str> {
    match code {
        5614 | 6130 | 6131 | 6132 | 8050 | 8051 | 8228 => Some("foot"),
        5702 | 6358 | 6359 | 6360 | 8052 | 8053 | 10919 => Some("US survey foot"),
        _ => None,
    }
}

/// Unit and conversion of stored numbers: sample = stored * scale + offset.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Conversion {
    /// Unit of the samples: `m` for lengths, otherwise as stated.
    pub(crate) unit: Option<String>,
    pub(crate) scale: f64,
    pub(crate) offset: f64,
}

impl Conversion {
    /// Returns scale and offset if they change a number.
    pub(crate) fn applied(&self) -> Option<(f64, f64)> {
        Some((self.scale, self.offset)).filter(|&applied| applied != (1.0, 0.0))
    }
}

/// Returns the conversion to metres above the sphere of a file that states `unit`, `scale` and `offset`.
///
/// SLDEM2015 and the LOLA maps give their sphere's radius as offset (`1737.4` and `1737400.`). Their samples are heights above it already,
/// so the offset is left out. A radius in kilometres also implies the unit if none is stated.
pub(crate) fn conversion(unit: Option<&str>, scale: f64, offset: f64, radius_m: Option<f64>) -> Conversion {
    let unit = unit.map(str::trim).filter(|unit| !NONE.contains(&unit.to_lowercase().as_str()));
    let mut metres = unit.and_then(metres_per);
    let radius_m = radius_m.unwrap_or(Body::Moon.radius_m());
    let is_radius = |factor: f64| (offset * factor - radius_m).abs() <= 1e-6 * radius_m;
    let implied = [1000.0, 1.0].into_iter().find(|&factor| is_radius(factor));
    let above = implied.is_some() || metres.is_some_and(is_radius);
    if unit.is_none() {
        metres = implied;
    }
    let factor = metres.unwrap_or(1.0);
    Conversion {
        unit: if metres.is_some() { Some("m".into()) } else { unit.map(str::to_owned) },
        scale: scale * factor,
        offset: if above { 0.0 } else { offset * factor },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_units_are_known_in_any_spelling() {
        for (name, metres) in [
            ("metre", 1.0),
            ("KILOMETERS", 1000.0),
            ("ft", 0.3048),
            ("Foot_US", US_SURVEY_FOOT_M),
            ("US survey foot", US_SURVEY_FOOT_M),
            ("U.S. survey feet", US_SURVEY_FOOT_M),
            ("us-ft", US_SURVEY_FOOT_M),
            (" cm ", 0.01),
            (&of_code(9003), US_SURVEY_FOOT_M),
        ] {
            assert_eq!(metres_per(name), Some(metres), "{name}");
        }
        for name in ["degree", "rad", "W/m2/micron/sr", "m/s", "pixel", "fathom", "", &of_code(9102)] {
            assert_eq!(metres_per(name), None, "{name}");
        }
    }

    #[test]
    fn an_offset_that_is_the_radius_is_left_out() {
        let of = |unit, offset| {
            let Conversion { unit, scale, offset } = conversion(unit, 0.5, offset, None);
            (unit.unwrap_or_default(), scale, offset)
        };
        let m = || "m".to_string();
        assert_eq!(of(Some("METER"), 1_737_400.0), (m(), 0.5, 0.0));
        assert_eq!(of(None, 1737.4), (m(), 500.0, 0.0));
        assert_eq!(of(Some("km"), 3.0), (m(), 500.0, 3000.0));
        assert_eq!(of(Some("FEET"), 1_737_400.0), (m(), 0.1524, 0.0));
        assert_eq!(of(Some("ft"), 1_737_400.0 / 0.3048), (m(), 0.1524, 0.0));
        assert_eq!(of(Some("unknown"), 7.0), (String::new(), 0.5, 7.0));
        // An unknown unit stays unknown.
        assert_eq!(of(Some("DEGREES"), 1_737_400.0), ("DEGREES".into(), 0.5, 0.0));
    }
}
