//! Grey pictures.

use super::{check_size, percentiles};
use elunar_core::grid::GridView;
use elunar_core::terrain::{PixelSize, Sun};
use elunar_raster::{Error, Result};
use image::{GrayImage, Luma};
use rayon::prelude::*;

/// Rows that a thread shades at once.
const BAND_ROWS: usize = 64;

/// Shades a row-major DTM (metres) as `gdaldem hillshade` does: Sun from the north-west, 45° high. Pixels without a height and the
/// outermost pixels are black.
///
/// # Errors
/// [`Error::Input`] if there are not `rows · cols` samples.
pub fn hillshade(heights_m: &[f32], rows: usize, cols: usize, pixel: PixelSize) -> Result<GrayImage> {
    check_size(heights_m.len(), rows, cols)?;
    let misfit = |e: elunar_core::error::LengthError| Error::input(format!("hillshade: {e}"));
    let mut shade = vec![0; heights_m.len()];
    let bands = shade.par_chunks_mut((BAND_ROWS * cols).max(1)).enumerate();
    bands.try_for_each(|(band, out)| {
        // With the rows above and below.
        let (first, count) = (band * BAND_ROWS, out.len() / cols);
        let (above, below) = (first.saturating_sub(1), (first + count + 1).min(rows));
        let view = GridView::new(&heights_m[above * cols..below * cols], below - above, cols).map_err(misfit)?;
        let mut shade = vec![0; (below - above) * cols];
        elunar_core::terrain::hillshade(view, pixel, Sun::default(), &mut shade).map_err(misfit)?;
        out.copy_from_slice(&shade[(first - above) * cols..][..out.len()]);
        Ok(())
    })?;
    grey(shade, rows, cols)
}

/// Returns row-major bytes as a picture.
///
/// # Errors
/// [`Error::Input`] if there are not `rows · cols` bytes.
pub fn grey(bytes: Vec<u8>, rows: usize, cols: usize) -> Result<GrayImage> {
    let (width, height) = check_size(bytes.len(), rows, cols)?;
    let misfit = || Error::input(format!("picture: {rows} x {cols} bytes expected"));
    GrayImage::from_raw(width, height, bytes).ok_or_else(misfit)
}

/// Stretches the central 99 % of an image's samples over the grey range. Invalid samples are black.
///
/// # Errors
/// [`Error::Input`] if there are not `rows · cols` samples.
pub fn stretch(samples: &[f32], rows: usize, cols: usize) -> Result<GrayImage> {
    let (width, height) = check_size(samples.len(), rows, cols)?;
    let (low, high) = percentiles(samples, 0.005, 0.995).unwrap_or_default();
    let gain = 255.0 / (high - low).max(f32::MIN_POSITIVE);
    Ok(GrayImage::from_fn(width, height, |col, row| {
        let value = samples[row as usize * cols + col as usize];
        // NaN becomes 0. An infinite range makes the gain 0, and infinity times 0 is NaN, too.
        Luma([((value - low) * gain).clamp(0.0, 255.0) as u8])
    }))
}
