//! The user's statements about a file that does not state its reference system or the unit of its heights.

use super::source::{Info, Source};
use super::{Crs, GeoRef};
use crate::{Error, Result};
use elunar_core::tile::Window;

/// Unit of heights, as the user states it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum HeightUnit {
    /// Metres.
    M,
    /// Kilometres.
    Km,
}

impl std::str::FromStr for HeightUnit {
    type Err = String;

    /// Reads the name as on command lines: m or km.
    fn from_str(name: &str) -> std::result::Result<Self, String> {
        match name {
            "m" => Ok(Self::M),
            "km" => Ok(Self::Km),
            _ => Err(format!("expected m or km, found {name}")),
        }
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
    /// Applies the statements to `source`: it gets the stated system, and samples in metres. Messages call the source `name`.
    ///
    /// # Errors
    /// [`Error::Input`] if the file names a different unit.
    pub fn of(self, name: &str, source: Box<dyn Source>) -> Result<Box<dyn Source>> {
        if self == Self::default() {
            return Ok(source);
        }
        if let (Some(HeightUnit::Km), Some(unit)) = (self.unit, &source.info().unit) {
            let what = format!("{name}: expected a file without a unit to take its heights for kilometres");
            return Err(Error::input(format!("{what}, found one that is read in {unit}")));
        }
        let mut info: Info = source.info().clone();
        if let Some(crs) = self.srs {
            info.georef = info.georef.map(|georef| GeoRef { crs, ..georef });
        }
        let factor = match self.unit {
            Some(HeightUnit::Km) => 1000.0,
            Some(HeightUnit::M) | None => 1.0,
        };
        if self.unit.is_some() {
            info.unit = Some("m".into());
        }
        Ok(Box::new(Stated { info, source, factor }))
    }
}

struct Stated {
    info: Info,
    source: Box<dyn Source>,
    factor: f32,
}

impl Source for Stated {
    fn info(&self) -> &Info {
        &self.info
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        let mut samples = self.source.read(window)?;
        if self.factor != 1.0 {
            samples.iter_mut().for_each(|v| *v *= self.factor);
        }
        Ok(samples)
    }
}
