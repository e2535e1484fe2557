//! The function that writes a file at once.

use super::super::Raster;
use super::options::WriteOptions;
use super::writer::Writer;
use elunar_base::{Error, Result};
use std::path::Path;

/// Writes `raster` as a cloud-optimised GeoTIFF, whole or not at all. ([`Writer`] writes larger ones row by row.) Float files always have
/// the NoData tag, integer files only if a sample is invalid.
///
/// # Errors
/// [`Error::Usage`] if the raster is empty, its sample count is not rows x columns, or a sample does not fit an integer type;
/// [`Error::Io`] if the file cannot be written.
pub fn write(path: &Path, raster: &Raster, options: &WriteOptions) -> Result<()> {
    let Raster { rows, cols, samples, georef } = raster;
    if samples.len() != rows * cols {
        let (path, found) = (path.display(), samples.len());
        return Err(Error::usage(format!("{path}: {rows} x {cols} pixels expected, {found} samples found")));
    }
    let has_gaps = samples.iter().any(|v| !v.is_finite());
    let options = WriteOptions { zero_is_nodata: options.zero_is_nodata && has_gaps, ..options.clone() };
    let mut writer = Writer::create(path, *rows, *cols, georef.as_ref(), &options)?;
    writer.write_rows(samples)?;
    writer.finish()
}
