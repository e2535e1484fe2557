//! The user's statements about a file that does not state its reference system or the unit of its heights.

use super::nodata::sample;
use super::source::{Info, Source};
use super::unit::metres_per;
use super::{Crs, GeoRef};
use elunar_base::{Error, Result};
use elunar_core::tile::Window;

/// Unit of heights, as the user states it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum HeightUnit {
    /// Metres.
    M,
    /// Kilometres.
    Km,
    /// Centimetres.
    Cm,
    /// Feet.
    Ft,
    /// Feet of United States' surveys.
    UsFt,
}

/// The units and their names on command lines.
const NAMES: [(HeightUnit, &str); 5] = [
    (HeightUnit::M, "m"),
    (HeightUnit::Km, "km"),
    (HeightUnit::Cm, "cm"),
    (HeightUnit::Ft, "ft"),
    (HeightUnit::UsFt, "us-ft"),
];

impl HeightUnit {
    fn name(self) -> &'static str {
        NAMES.iter().find(|(unit, _)| *unit == self).map_or("m", |(_, name)| name)
    }

    fn metres(self) -> f64 {
        metres_per(self.name()).unwrap_or(1.0)
    }
}

impl std::str::FromStr for HeightUnit {
    type Err = String;

    /// Reads the name as on command lines: m, km, cm, ft or us-ft.
    fn from_str(name: &str) -> std::result::Result<Self, String> {
        let found = NAMES.iter().find(|(_, known)| *known == name).map(|(unit, _)| *unit);
        found.ok_or_else(|| format!("expected m, km, cm, ft or us-ft, found {name}"))
    }
}

/// A user's statements about a raster. A stated system replaces the file's own.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Statements {
    /// Reference system of the map coordinates.
    pub srs: Option<Crs>,
    /// Unit of the samples.
    pub unit: Option<HeightUnit>,
}

impl Statements {
    /// Applies the statements to `source`: it gets the stated system, and samples in metres. Messages call the source `name`. A unit that the
    /// file states and this program does not know is replaced.
    ///
    /// # Errors
    /// [`Error::Input`] if the file states another length.
    pub fn of(self, name: &str, source: Box<dyn Source>) -> Result<Box<dyn Source>> {
        if self == Self::default() {
            return Ok(source);
        }
        let mut info: Info = source.info().clone();
        if let Some(crs) = self.srs {
            info.georef = info.georef.map(|georef| GeoRef { crs, ..georef });
        }
        let mut factor = 1.0;
        if let Some(unit) = self.unit {
            factor = factor_to_metres(name, &info, unit)?;
            info.unit = Some("m".into());
        }
        Ok(Box::new(Stated { info, source, factor }))
    }
}

/// Returns metres per unit of a source's samples, which `unit` says. A source in metres has them, whatever its file stores.
fn factor_to_metres(name: &str, info: &Info, unit: HeightUnit) -> Result<f64> {
    if info.unit.as_deref() != Some("m") {
        return Ok(unit.metres());
    }
    let in_file = info.unit_in_file.as_deref();
    if in_file.map_or(unit == HeightUnit::M, |in_file| metres_per(in_file) == Some(unit.metres())) {
        return Ok(1.0);
    }
    let what = format!("{name}: expected a file without a unit to take its heights for {}", unit.name());
    Err(Error::input(format!("{what}, found {:?}", in_file.unwrap_or("m"))))
}

struct Stated {
    info: Info,
    source: Box<dyn Source>,
    factor: f64,
}

impl Source for Stated {
    fn info(&self) -> &Info {
        &self.info
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        let mut samples = self.source.read(window)?;
        if self.factor != 1.0 {
            samples.iter_mut().for_each(|v| *v = sample(f64::from(*v) * self.factor));
        }
        Ok(samples)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Raster;
    use crate::source::{InMemory, read_all};

    #[test]
    fn a_stated_system_replaces_the_files_and_leaves_the_samples() {
        let georef = Some(GeoRef { transform: [5.0, 1.0, 0.0, 6.0, 0.0, -1.0], crs: Crs::default() });
        for georef in [georef, None] {
            let raster = Raster { rows: 1, cols: 2, samples: vec![1.0, -3.0], georef: georef.clone() };
            let source = Box::new(InMemory::new(raster.clone(), Some("km".into()), "test"));
            let srs = Crs::geographic(1_737_400.0);
            let stated = Statements { srs: Some(srs.clone()), unit: None }.of("a.tif", source).unwrap();
            assert_eq!(stated.info().unit.as_deref(), Some("km"));
            let expected = georef.map(|georef| GeoRef { crs: srs, ..georef });
            assert_eq!(read_all(&*stated).unwrap(), Raster { georef: expected, ..raster });
        }
    }
}
