//! Coloured relief: colour shows height, shading shows shape.

use super::grey::hillshade;
use super::{check_size, percentiles};
use elunar_base::Result;
use elunar_core::terrain::PixelSize;
use image::{Rgb, RgbImage};

/// Colours from low to high, evenly spaced: violet, blue, green, yellow, white (after the LOLA colour maps).
const RAMP: [[f32; 3]; 6] = [
    [70.0, 30.0, 110.0],
    [50.0, 80.0, 170.0],
    [60.0, 150.0, 140.0],
    [150.0, 190.0, 90.0],
    [240.0, 200.0, 90.0],
    [250.0, 245.0, 235.0],
];

/// Draws a shaded, coloured DTM. `range_m` are the heights of the lowest and the highest colour, so that several DTMs can share one scale;
/// `None` takes the DTM's own range. Pixels without a height are black.
///
/// # Errors
/// [`elunar_base::Error::Input`] if there are not `rows · cols` samples.
pub fn relief(
    heights_m: &[f32],
    rows: usize,
    cols: usize,
    pixel: PixelSize,
    range_m: Option<(f32, f32)>,
) -> Result<RgbImage> {
    let (width, height) = check_size(heights_m.len(), rows, cols)?;
    let shade = hillshade(heights_m, rows, cols, pixel)?;
    let (low, high) = range_m.or_else(|| percentiles(heights_m, 0.0, 1.0)).unwrap_or_default();
    Ok(RgbImage::from_fn(width, height, |col, row| {
        let share = (heights_m[row as usize * cols + col as usize] - low) / (high - low).max(f32::MIN_POSITIVE);
        if !share.is_finite() {
            return Rgb([0; 3]);
        }
        // Level ground has a shade of about 180 and keeps its colour.
        let light = f32::from(shade.get_pixel(col, row).0[0]) / 180.0;
        Rgb(colour(share).map(|c| (c * light).min(255.0) as u8))
    }))
}

/// Returns the ramp's colour at `share` (clamped to 0–1).
fn colour(share: f32) -> [f32; 3] {
    let position = share.clamp(0.0, 1.0) * (RAMP.len() - 1) as f32;
    let k = (position as usize).min(RAMP.len() - 2);
    std::array::from_fn(|c| RAMP[k][c] + (RAMP[k + 1][c] - RAMP[k][c]) * (position - k as f32))
}
