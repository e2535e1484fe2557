//! PNG pictures: images, hillshades, coloured relief, error maps, contact sheets and training curves.
//!
//! Pictures are drawn in memory. [`write_png`] writes them whole or not at all; [`png_bytes`] returns them for embedding. [`shading`] makes the
//! hillshade of a raster of any size, in bands of rows.

mod bars;
mod canvas;
mod curves;
mod errors;
mod font;
mod grey;
mod histogram;
mod relief;
pub mod shading;
mod sheet;
mod text;

pub use bars::{Bars, bars};
pub use canvas::Canvas;
pub use curves::{Chart, Series, curves, plot, plot_log_x};
pub use errors::{ErrorLimits, ErrorMap, error_map};
pub use font::FONT;
pub use grey::{grey, hillshade, hillshades, stretch};
pub use histogram::histogram;
pub use relief::relief;
pub use sheet::{Panel, sheet};

use elunar_base::quantile::nearest_rank;
use elunar_base::{Error, Result, atomic_write};
use image::{DynamicImage, ImageFormat};
use std::io::Cursor;
use std::path::Path;

/// Returns the picture as the bytes of a PNG file.
///
/// # Errors
/// [`Error::Usage`] if the picture has no pixels.
pub fn png_bytes(picture: &DynamicImage) -> Result<Vec<u8>> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png).map_err(|e| Error::usage(format!("picture: {e}")))?;
    Ok(bytes.into_inner())
}

/// Writes the picture to a PNG file, whole or not at all.
///
/// # Errors
/// [`Error::Usage`] if the picture has no pixels, [`Error::Io`] if the file cannot be written.
pub fn write_png(path: &Path, picture: impl Into<DynamicImage>) -> Result<()> {
    atomic_write(path, &png_bytes(&picture.into())?)
}

/// Checks that there is one sample per pixel and that the picture fits a PNG.
fn check_size(samples: usize, rows: usize, cols: usize) -> Result<(u32, u32)> {
    let (Ok(height), Ok(width)) = (u32::try_from(rows), u32::try_from(cols)) else {
        return Err(Error::usage(format!(
            "picture: at most {} rows and columns expected, {rows} x {cols} found",
            u32::MAX
        )));
    };
    if rows.checked_mul(cols) != Some(samples) {
        return Err(Error::usage(format!("picture: {rows} x {cols} samples expected, {samples} found")));
    }
    Ok((width, height))
}

/// Returns the two percentiles `low` and `high` (0–1) of the finite samples; `None` without finite samples.
fn percentiles(samples: &[f32], low: f64, high: f64) -> Option<(f32, f32)> {
    let mut finite: Vec<f32> = samples.iter().copied().filter(|v| v.is_finite()).collect();
    Some((nearest_rank(&mut finite, low)?, nearest_rank(&mut finite, high)?))
}

#[cfg(test)]
mod tests;
