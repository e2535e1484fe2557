//! Systems that a file states as a text (WKT) beside its keys, or in their place. ArcGIS writes "ESRI PE String = PROJCS[...]" as the name
//! of the projected system, and GDAL does for projections that have no keys.

use super::{Crs, Value, key};
use crate::Projection;

const CITATIONS: [u16; 3] = [key::PROJECTED_CITATION, key::CITATION, key::GEODETIC_CITATION];

/// First words of WKT, version 1 or 2.
const WORDS: [&str; 6] = ["PROJCS[", "GEOGCS[", "PROJCRS[", "PROJECTEDCRS[", "GEOGCRS[", "GEODCRS["];

/// Returns the part of a text that is WKT.
fn wkt(text: &str) -> Option<&str> {
    let start = WORDS.iter().filter_map(|word| text.find(word)).min()?;
    // ArcGIS may append a vertical system. What is cut short stays, and will not be understood.
    let (text, mut depth, mut quoted) = (&text[start..], 0, false);
    let end = text.bytes().position(|byte| {
        match byte {
            b'"' => quoted = !quoted,
            b'[' if !quoted => depth += 1,
            b']' if !quoted => depth -= 1,
            _ => {}
        }
        byte == b']' && depth == 0
    });
    Some(end.map_or(text, |end| &text[..=end]))
}

/// Returns whether a value is a text with WKT in it.
pub(super) fn is_wkt(value: &Value) -> bool {
    matches!(value, Value::Text(text) if wkt(text).is_some())
}

impl Crs {
    /// Returns the WKT of a citation.
    pub(super) fn cited(&self) -> Option<String> {
        let mut values = self.values();
        CITATIONS.into_iter().filter_map(|key| values.remove(&key)).find_map(|value| match value {
            Value::Text(text) => wkt(&text).map(str::to_owned),
            Value::Numbers(_) => None,
        })
    }

    /// Returns the system with keys for what only a citation states. A system whose keys suffice, or whose WKT is not understood, stays as
    /// it is.
    pub(crate) fn with_keys_of_citation(self) -> Self {
        if Projection::of(&self).is_some() {
            return self;
        }
        let Some(mut stated) = self.cited().and_then(|wkt| Self::parse(&wkt).ok()) else { return self };
        if self.pixel_is_point()
            && let Some(at) = stated.directory[4..].chunks(4).position(|entry| entry[0] == key::RASTER_TYPE)
        {
            stated.directory[4 + 4 * at + 3] = 2;
        }
        stated
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::sun::Body;

    const SOUTH: &str = "PROJCS[\"Moon_2000_South_Pole_Stereographic\",GEOGCS[\"GCS_Moon_2000\",DATUM[\"D_Moon_2000\",SPHEROID[\"Moon_2000_IAU_IAG\",1737400.0,0.0]],PRIMEM[\"Reference_Meridian\",0.0],UNIT[\"Degree\",0.0174532925199433]],PROJECTION[\"Stereographic_South_Pole\"],PARAMETER[\"False_Easting\",0.0],PARAMETER[\"False_Northing\",0.0],PARAMETER[\"Central_Meridian\",0.0],PARAMETER[\"Standard_Parallel_1\",-90.0],UNIT[\"Meter\",1.0]]";

    /// Returns a system as ArcGIS writes it: user-defined, with the WKT in the name of the projected system.
    fn esri(wkt: &str, raster_type: u16) -> Crs {
        let ascii = format!("ESRI PE String = {wkt}|");
        let length = ascii.len() as u16;
        let directory =
            vec![1, 1, 0, 4, 1024, 0, 1, 32767, 1025, 0, 1, raster_type, 3072, 0, 1, 32767, 3073, 34737, length, 0];
        Crs { directory, doubles: vec![], ascii }
    }

    #[test]
    fn the_text_becomes_keys() {
        for raster_type in [1, 2] {
            let crs = esri(SOUTH, raster_type).with_keys_of_citation();
            assert!(crs.same_as(&Crs::polar(Body::Moon.radius_m(), true)), "{crs:?}");
            assert_eq!((crs.defect(), crs.pixel_is_point()), (None, raster_type == 2));
        }
        let heights = format!("{SOUTH},VERTCS[\"a]\",VDATUM[\"b\"],UNIT[\"Meter\",1.0]]");
        assert!(
            esri(&heights, 1).with_keys_of_citation().same_as(&Crs::polar(Body::Moon.radius_m(), true)),
            "with a vertical system"
        );
        // Brackets in a name are none of the text's.
        let named = heights.replace("Moon_2000_South", "[Moon] ] South");
        assert!(esri(&named, 1).with_keys_of_citation().same_as(&Crs::polar(Body::Moon.radius_m(), true)));
        let degrees = &SOUTH[SOUTH.find("GEOGCS").unwrap()..SOUTH.find(",PROJECTION").unwrap()];
        assert!(esri(degrees, 1).with_keys_of_citation().same_as(&Crs::geographic(1_737_400.0)));
        let keyed = Crs::equirectangular(Body::Moon.radius_m(), 3.0, 4.0);
        assert_eq!(keyed.clone().with_keys_of_citation(), keyed, "keys that suffice are kept");
    }

    #[test]
    fn a_text_that_is_not_understood_is_never_degrees() {
        let mollweide = SOUTH.replace("Stereographic_South_Pole", "Mollweide");
        let radians = SOUTH[SOUTH.find("GEOGCS").unwrap()..SOUTH.find(",PROJECTION").unwrap()]
            .replace("[\"Degree\",0.0174532925199433]", "[\"Radian\",1.0]");
        for wkt in
            [&*mollweide, &SOUTH[..200], &SOUTH.replace("[\"Meter\",1.0]", "[\"Foot\",0.3048]"), &radians, "a name"]
        {
            let crs = esri(wkt, 1);
            assert_eq!(crs.clone().with_keys_of_citation(), crs, "{wkt}");
            assert!(!crs.is_geographic() && !crs.is_projected() && Projection::of(&crs).is_none());
            assert!(crs.summary().starts_with("a system"), "{}", crs.summary());
        }
        assert!(esri(&mollweide, 1).summary().contains("Mollweide"), "{}", esri(&mollweide, 1).summary());
        assert!(!esri(&mollweide, 1).same_as(&esri("PROJCS[\"x\",PROJECTION[\"Robinson\"]]", 1)), "two projections");
        assert!(esri(&mollweide, 1).same_as(&esri(&mollweide, 2)));
    }
}
