//! Rasters that are read as heights.

use super::source::{self, Source};
use super::stated::Statements;
use super::{Raster, unit};
use elunar_base::{Error, Result};
use std::path::Path;

/// Opens a raster of heights. Its samples are metres above the sphere: known units of length are converted, and heights without a unit are
/// taken for metres.
///
/// # Errors
/// As [`source::open`]; [`Error::Input`] if the file states another unit.
pub fn open(path: &Path) -> Result<Box<dyn Source>> {
    open_with(path, Statements::default(), None)
}

/// Opens a raster of heights as [`open`] does. The user's statements replace those of the file. Samples stored as `nodata` are invalid, too.
///
/// # Errors
/// As [`open`] and [`Statements::of`].
pub fn open_with(path: &Path, stated: Statements, nodata: Option<f64>) -> Result<Box<dyn Source>> {
    let name = path.display().to_string();
    let heights = stated.of(&name, source::open_with(path, nodata)?)?;
    match heights.info().unit.as_deref() {
        None | Some("m") => Ok(heights),
        Some(found) => {
            let known = unit::KNOWN;
            let mend = "mend it with gdal_edit.py -units m FILE.tif, or state --coarse-unit of a coarse DTM";
            Err(Error::input(format!("{name}: heights in {known} expected, found {found:?}; {mend}")))
        }
    }
}

/// Reads all heights of a file.
///
/// # Errors
/// As [`open`] and [`Source::read`].
pub fn read(path: &Path) -> Result<Raster> {
    source::read_all(open(path)?.as_ref())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geotiff::{WriteOptions, write};
    use crate::stated::HeightUnit;

    #[test]
    fn known_units_become_metres_and_others_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tif");
        let stated = |unit: &str, by_user: Option<HeightUnit>| {
            let raster = Raster { rows: 1, cols: 2, samples: vec![1000.0, -500.0], georef: None };
            let mut options = WriteOptions::heights("t");
            options.unit = Some(unit.to_owned()).filter(|unit| !unit.is_empty());
            write(&path, &raster, &options).unwrap();
            let heights = open_with(&path, Statements { unit: by_user, srs: None }, None).map_err(|e| e.to_string())?;
            Ok::<f32, String>(source::read_all(&*heights).unwrap().samples[0])
        };
        for (unit, metres) in
            [("", 1000.0), ("metre", 1000.0), ("km", 1e6), ("cm", 10.0), ("ft", 304.8), ("US survey foot", 304.800_6)]
        {
            assert_eq!(stated(unit, None), Ok(metres), "{unit}");
        }
        for unit in ["degree", "W/m2", "fathom"] {
            let text = stated(unit, None).unwrap_err();
            assert!(
                text.contains(&format!("or US survey foot expected, found {unit:?}; mend it with gdal_edit.py")),
                "{text}"
            );
            assert_eq!(stated(unit, Some(HeightUnit::Ft)), Ok(304.8), "the user knows better");
        }
        assert_eq!(stated("", Some(HeightUnit::UsFt)), Ok(304.800_6));
        assert_eq!(stated("feet", Some(HeightUnit::Ft)), Ok(304.8));
        for (unit, by_user) in [("m", HeightUnit::Km), ("ft", HeightUnit::M), ("ft", HeightUnit::UsFt)] {
            let text = stated(unit, Some(by_user)).unwrap_err();
            assert!(text.contains(&format!("found {unit:?}")), "{text}");
        }
        assert!(stated("km", None).is_ok() && read(&path).unwrap().samples == [1e6, -5e5]);
    }
}
