//! A TIFF with a label beside it.

use super::binary::{Meaning, Sample};
use super::source::{Info, Source};
use super::sun::StatedSun;
use super::unit::Conversion;
use super::{GeoRef, geotiff};
use elunar_base::{Error, Result, read};
use elunar_core::tile::Window;
use std::io::Read;
use std::path::Path;

/// What a label says about the samples of another file.
pub(crate) struct Meant {
    pub(crate) rows: usize,
    pub(crate) cols: usize,
    /// Stored numbers that mean "no measurement".
    pub(crate) missing: Vec<f64>,
    pub(crate) conversion: Conversion,
    pub(crate) unit_in_file: Option<String>,
    pub(crate) georef: Option<GeoRef>,
    pub(crate) sun: StatedSun,
    pub(crate) warnings: Vec<String>,
    /// The label's own format: `PDS3 label`.
    pub(crate) format: &'static str,
}

/// Returns whether a file begins as a TIFF does.
///
/// # Errors
/// As [`read::file`].
pub(crate) fn is_tiff(path: &Path) -> Result<bool> {
    let mut head = [0; 4];
    let whole = read::file(path)?.read_exact(&mut head).is_ok();
    Ok(whole && [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].contains(&&head))
}

/// A TIFF with a label beside it. The TIFF determines the layout of its samples. The label gives their meaning, where the TIFF does not.
pub(crate) struct Relabelled {
    tiff: Box<dyn Source>,
    meaning: Meaning,
    info: Info,
}

impl Relabelled {
    /// Opens the TIFF at `data` with the meaning that the label at `path` gives it.
    ///
    /// # Errors
    /// As [`geotiff::open`]; [`Error::Broken`] if the sizes differ.
    pub(crate) fn new(path: &Path, data: &Path, meant: Meant) -> Result<Self> {
        let tiff = geotiff::open(data)?;
        let Meant { rows, cols, conversion, .. } = meant;
        let found = tiff.info();
        if (found.rows, found.cols) != (rows, cols) {
            let what = format!(
                "{rows} x {cols} samples expected, found {} x {} in {}",
                found.rows,
                found.cols,
                data.display()
            );
            return Err(Error::broken(path, what));
        }
        // A TIFF that names its unit has its own scale and offset, already applied.
        let (scale, offset) = match found.unit {
            Some(_) => (1.0, 0.0),
            None => (conversion.scale, conversion.offset),
        };
        // The TIFF's samples come as floats, whatever it stores.
        let meaning = Meaning::new(Sample::F32, meant.missing, scale, offset);
        let info = Info {
            applied: found.applied.or_else(|| ((scale, offset) != (1.0, 0.0)).then_some((scale, offset))),
            unit: found.unit.clone().or(conversion.unit),
            unit_in_file: found.unit_in_file.clone().or(meant.unit_in_file),
            warnings: meant.warnings,
            format: format!("{}, {}", found.format, meant.format),
            sun: found.sun.or(meant.sun),
            georef: found.georef.clone().or(meant.georef),
            ..found.clone()
        };
        Ok(Self { tiff, meaning, info })
    }
}

impl Source for Relabelled {
    fn info(&self) -> &Info {
        &self.info
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        let mut samples = self.tiff.read(window)?;
        samples.iter_mut().for_each(|v| *v = self.meaning.apply_float(f64::from(*v)));
        Ok(samples)
    }
}
