//! Rasters with a place on a sphere, and the files they live in.

pub mod geotiff;
pub mod resample;

use crate::{Error, Result};
use std::io::Write;
use std::path::Path;

/// Affine pixel-to-map transform in GDAL's order: x = t0 + col*t1 + row*t2, y = t3 + col*t4 + row*t5, with (0, 0) the outer
/// corner of the first pixel. Map units are metres for projected systems, degrees for geographic ones.
pub type GeoTransform = [f64; 6];

/// Where a raster lies: its transform and its coordinate reference system.
#[derive(Debug, Clone, PartialEq)]
pub struct GeoRef {
    /// Pixel-to-map transform.
    pub transform: GeoTransform,
    /// Coordinate reference system.
    pub crs: Crs,
}

/// A coordinate reference system as GeoTIFF keys carry it. Kept verbatim, so that what comes in goes out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Crs {
    /// GeoKeyDirectoryTag (34735), header included.
    pub directory: Vec<u16>,
    /// GeoDoubleParamsTag (34736).
    pub doubles: Vec<f64>,
    /// GeoAsciiParamsTag (34737).
    pub ascii: String,
}

/// One band of samples with its place, mask and unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    /// Rows (north to south in a north-up raster).
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Row-major samples; metres above the sphere for heights, relative brightness for images. Invalid samples hold NaN.
    pub samples: Vec<f32>,
    /// Where the raster lies; `None` when the file has no CRS and transform.
    pub georef: Option<GeoRef>,
}

/// Writes `bytes` to `path` whole or not at all: a temporary sibling is filled, synced and renamed into place.
///
/// # Errors
/// [`Error::Io`] if the folder or file cannot be written.
pub fn atomic_write(path: &Path, bytes: &[u8]) -> Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = tempfile::NamedTempFile::new_in(folder).map_err(Error::io(path))?;
    file.write_all(bytes).map_err(Error::io(path))?;
    file.as_file().sync_all().map_err(Error::io(path))?;
    file.persist(path).map_err(|e| Error::Io { path: path.into(), source: e.error })?;
    Ok(())
}
