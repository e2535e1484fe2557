//! Inputs of commands.

use elunar_raster::source::{self, Source};
use elunar_raster::{Raster, Result, heights as raster};
use std::path::Path;

/// Opens a raster of heights, and prints what was passed over in it.
///
/// # Errors
/// As [`elunar_raster::heights::open`].
pub(super) fn heights(path: &Path) -> Result<Box<dyn Source>> {
    let heights = raster::open(path)?;
    heights.info().warnings.iter().for_each(|warning| eprintln!("WARNING: {}: {warning}", path.display()));
    Ok(heights)
}

/// Reads a raster of heights as [`heights`] opens it.
///
/// # Errors
/// As [`heights`] and [`Source::read`].
pub(super) fn read_heights(path: &Path) -> Result<Raster> {
    source::read_all(&*heights(path)?)
}
