//! Rasters read on demand, window by window. A strip of 5,000 x 50,000 pixels is never whole in memory.

use super::bytes;
use super::format::{self, Format, describe};
use super::mask::masked;
use super::pam::told;
use super::sun::StatedSun;
#[cfg(not(target_family = "wasm"))]
use super::through_gdal::{self, Outcome};
use super::{GeoRef, Raster, geotiff, isis, npy, pds3, pds4, vrt};
use elunar_base::{Error, Result, read};
use elunar_core::tile::Window;
use std::path::Path;

/// Properties of a raster file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Info {
    /// Rows (north to south in a north-up raster).
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Georeference; `None` if the file has no transform.
    pub georef: Option<GeoRef>,
    /// Unit of the samples as returned: `m` for every known length; `None` if the file names none.
    pub unit: Option<String>,
    /// Unit that the file states, in its own words.
    pub unit_in_file: Option<String>,
    /// Scale and offset that made stored numbers samples; `None` if samples are the stored numbers.
    pub applied: Option<(f64, f64)>,
    /// Short description of the format: `GeoTIFF, f32, tiles of 256 x 256, Deflate`.
    pub format: String,
    /// The Sun of an image, as far as the file states it.
    pub sun: StatedSun,
    /// What was passed over in the file, one line each.
    pub warnings: Vec<String>,
}

impl Info {
    /// Returns the georeference, which must be complete. Messages call the raster `name`.
    ///
    /// # Errors
    /// [`Error::Input`] if the geotransform or the reference system is missing, or they contradict each other.
    pub fn place(&self, name: &str) -> Result<&GeoRef> {
        let missing = |what: &str| Error::input(format!("{name}: a raster with {what} expected, none found"));
        let georef = self.georef.as_ref().ok_or_else(|| missing("a geotransform"))?;
        if georef.crs.is_empty() {
            return Err(missing("a coordinate reference system"));
        }
        match georef.contradiction(self.rows, self.cols) {
            Some(what) => Err(Error::input(format!("{name}: {what}"))),
            None => Ok(georef),
        }
    }

    /// Returns whether the file stores integers without sign, as images do and heights rarely.
    #[must_use]
    pub fn is_unsigned(&self) -> bool {
        let words = self.format.split([' ', ',']);
        words.into_iter().any(|word| ["u8", "u16", "u32"].contains(&word))
    }

    /// Returns the side of a pixel on the ground, metres: the square root of its area at the raster's centre.
    ///
    /// # Errors
    /// [`Error::Input`] if the pixel size is unknown.
    pub fn side_m(&self, name: &str) -> Result<f64> {
        let size = self.georef.as_ref().and_then(|georef| georef.pixel_m(self.rows, self.cols));
        let side_m = size.map(|(row_m, col_m)| (row_m * col_m).sqrt());
        side_m.ok_or_else(|| {
            let crs = self.georef.as_ref().map(|georef| &georef.crs).filter(|crs| !crs.is_empty());
            let why = crs.map_or_else(String::new, |crs| format!(": {}; {}", crs.summary(), crs.remedy(name, None)));
            Error::input(format!("{name}: a pixel size in metres expected, none found{why}"))
        })
    }
}

/// A raster open for reading.
pub trait Source: Send + Sync {
    /// Returns the properties of the file.
    fn info(&self) -> &Info;

    /// Reads the samples of a window that lies within the raster, row-major. Heights are in metres above the sphere, images in relative
    /// brightness. Invalid samples are NaN.
    ///
    /// # Errors
    /// If the window exceeds the raster, or the file cannot be read there.
    fn read(&self, window: Window) -> Result<Vec<f32>>;
}

/// Opens a raster file of any supported format. The content decides, not the name. The path of a PDS3 image may be its label or, if a label
/// lies beside it, the image file itself. A file of another format is converted by `gdal_translate`, if that is installed, into a temporary GeoTIFF;
/// a warning says so. A path that is an address (`http://` or `https://`) is a GeoTIFF on the net, of which the bytes that are needed are read
/// (feature `http`).
///
/// # Errors
/// [`Error::Io`] if the file cannot be read, [`Error::Broken`] if it contradicts itself, [`Error::Unsupported`] for unsupported formats and
/// variants, with the command that converts them, if there is one.
pub fn open(path: &Path) -> Result<Box<dyn Source>> {
    open_with(path, None)
}

/// Opens a raster file as [`open`] does. Samples stored as `nodata` are invalid, too, as if the file named this value: it is compared with
/// the stored number, before scale, offset and unit are applied. A mask beside the file (`NAME.msk`, as GDAL writes it) holds, too. Of another
/// side file (`NAME.aux.xml`) that states more than statistics, a warning is noted.
///
/// # Errors
/// As [`open`]; the same about the mask.
pub fn open_with(path: &Path, nodata: Option<f64>) -> Result<Box<dyn Source>> {
    Ok(told(path, masked(path, open_alone(path, nodata)?)?))
}

pub(crate) fn open_alone(path: &Path, nodata: Option<f64>) -> Result<Box<dyn Source>> {
    // One version of a file on the net, from its first bytes on.
    let _held = bytes::held(path)?;
    match Format::of(path)? {
        Format::Tiff => geotiff::open_with(path, nodata),
        _ if read::is_address(path) => Err(bytes::no_geotiff(path, &describe(&format::head(path)?))),
        Format::Pds3 => pds3::open_with(path, nodata),
        Format::Isis => isis::open_with(path, nodata),
        Format::Pds4 => pds4::open_with(path, nodata),
        Format::Vrt => vrt::open_with(path, nodata, 0),
        Format::Npy => npy::open_with(path, nodata),
        Format::Convertible(what) => converted(path, nodata, what.into()),
        Format::Unknown(head) => match pds3::label_beside(path)? {
            Some(label) => pds3::open_with(&label, nodata),
            None => {
                let what = "a GeoTIFF, a PDS3 or PDS4 label or image, an ISIS cube, a VRT, or a .npy array expected";
                converted(path, nodata, format!("{what}, found {} and no PDS3 label beside it", describe(&head)))
            }
        },
    }
}

/// Opens a file of another format through GDAL.
#[cfg(not(target_family = "wasm"))]
fn converted(path: &Path, nodata: Option<f64>, what: String) -> Result<Box<dyn Source>> {
    let refused = |said: String| Err(Error::unsupported(path, format!("{what}; {}{said}", remedy(path))));
    match through_gdal::open_with(path, nodata)? {
        Outcome::Read(source) => Ok(source),
        Outcome::Refused(said) => {
            let said: String = said.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
            refused(format!(" (tried: {said})"))
        }
        Outcome::Absent => refused(String::new()),
    }
}

/// WebAssembly starts no programs.
#[cfg(target_family = "wasm")]
fn converted(path: &Path, _: Option<f64>, what: String) -> Result<Box<dyn Source>> {
    Err(Error::unsupported(path, format!("{what}; {}", remedy(path))))
}

/// Returns the line that converts a file.
fn remedy(path: &Path) -> String {
    format!("convert it first: gdal_translate -of GTiff {0} {0}.tif", path.display())
}

/// Reads a whole file.
///
/// # Errors
/// As [`open`] and [`Source::read`].
pub fn read(path: &Path) -> Result<Raster> {
    read_all(open(path)?.as_ref())
}

/// Reads a whole source.
///
/// # Errors
/// As [`Source::read`].
pub fn read_all(source: &dyn Source) -> Result<Raster> {
    let Info { rows, cols, georef, .. } = source.info().clone();
    let samples = source.read(Window { row: 0, col: 0, rows, cols })?;
    Ok(Raster { rows, cols, samples, georef })
}

/// Refuses a window that exceeds a raster of `rows` x `cols`.
///
/// # Errors
/// [`Error::Input`] with both sizes.
pub fn check_window(window: Window, rows: usize, cols: usize) -> Result<()> {
    let inside = |first: usize, count: usize, all: usize| first.checked_add(count).is_some_and(|end| end <= all);
    if inside(window.row, window.rows, rows) && inside(window.col, window.cols, cols) {
        return Ok(());
    }
    Err(Error::input(format!("expected a window within {rows} x {cols} pixels, found {window:?}")))
}

/// A raster in memory, as a source.
#[derive(Debug, Clone)]
pub struct InMemory {
    info: Info,
    samples: Vec<f32>,
}

impl InMemory {
    /// Wraps `raster`; `unit` and `format` as in [`Info`].
    #[must_use]
    pub fn new(raster: Raster, unit: Option<String>, format: impl Into<String>) -> Self {
        let Raster { rows, cols, samples, georef } = raster;
        let format = format.into();
        Self { info: Info { rows, cols, georef, unit, format, ..Info::default() }, samples }
    }

    /// States the Sun of an image.
    #[must_use]
    pub fn with_sun(mut self, sun: StatedSun) -> Self {
        self.info.sun = sun;
        self
    }
}

impl Source for InMemory {
    fn info(&self) -> &Info {
        &self.info
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        check_window(window, self.info.rows, self.info.cols)?;
        let line = |row: usize| &self.samples[row * self.info.cols + window.col..][..window.cols];
        Ok((window.row..window.row + window.rows).flat_map(|row| line(row).iter().copied()).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_cut_and_never_leave() {
        let samples = (0..12).map(|i| i as f32).collect();
        let source = InMemory::new(Raster { rows: 3, cols: 4, samples, georef: None }, None, "memory");
        let cut = |row, col, rows, cols| source.read(Window { row, col, rows, cols });
        assert_eq!(cut(1, 2, 2, 2).unwrap(), [6.0, 7.0, 10.0, 11.0]);
        for (row, col, rows, cols) in [(0, 0, 4, 1), (0, 3, 1, 2), (usize::MAX, 0, 2, 1)] {
            assert!(cut(row, col, rows, cols).is_err());
        }
        assert_eq!(read_all(&source).unwrap().samples.len(), 12);
    }
}
