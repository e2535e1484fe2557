//! Grey pictures.

use super::{check_size, percentiles};
use crate::shading::{HillshadeOptions, shade_all};
use elunar_base::{Error, Result};
use elunar_core::terrain::{PixelSize, Sun};
use image::{GrayImage, Luma};

/// Shades a row-major DTM (metres) as `gdaldem hillshade -compute_edges` does: Sun from the north-west, 45° high. Pixels without a height are
/// black.
///
/// # Errors
/// [`Error::Input`] if there are not `rows · cols` samples.
pub fn hillshade(heights_m: &[f32], rows: usize, cols: usize, pixel: PixelSize) -> Result<GrayImage> {
    check_size(heights_m.len(), rows, cols)?;
    grey(shade_all(heights_m, cols, pixel, &HillshadeOptions { sun: Sun::default(), compute_edges: true })?, rows, cols)
}

/// Shades DTMs of one grid as [`hillshade`] does, with one stretch for all: the central 99 % of their shades fill the greys.
///
/// # Errors
/// As [`hillshade`].
pub fn hillshades(maps_m: &[&[f32]], rows: usize, cols: usize, pixel: PixelSize) -> Result<Vec<GrayImage>> {
    let mut shades: Vec<GrayImage> =
        maps_m.iter().map(|map_m| hillshade(map_m, rows, cols, pixel)).collect::<Result<_>>()?;
    let valid = shades.iter().flat_map(|shade| shade.pixels()).map(|p| f32::from(p.0[0])).filter(|v| *v > 0.0);
    let (low, high) = percentiles(&valid.collect::<Vec<_>>(), 0.005, 0.995).unwrap_or_default();
    let gain = 254.0 / (high - low).max(1.0);
    // Only pixels without a height are black.
    let stretched = |v: u8| if v == 0 { 0 } else { (1.0 + (f32::from(v) - low) * gain).clamp(1.0, 255.0) as u8 };
    shades.iter_mut().flat_map(GrayImage::pixels_mut).for_each(|p| p.0 = [stretched(p.0[0])]);
    Ok(shades)
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
