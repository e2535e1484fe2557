//! Hillshade and error map as PNG.

use crate::raster::{Raster, atomic_write};
use crate::{Error, Result};
use elunar_core::grid::GridView;
use elunar_core::metrics::height::LIMITS_M;
use elunar_core::terrain::{PixelSize, Sun, hillshade};
use image::{DynamicImage, GrayImage, ImageFormat, Rgb, RgbImage};
use std::io::Cursor;
use std::path::Path;

/// Shades `dtm` as `gdaldem hillshade` does and writes a grey PNG; pixels without a value are black.
///
/// # Errors
/// [`Error::Usage`] if the pixel size is unknown, [`Error::Io`] if the file cannot be written.
pub(super) fn write_hillshade(path: &Path, dtm: &Raster) -> Result<()> {
    let (row_m, col_m) =
        dtm.pixel_m().ok_or_else(|| Error::usage(format!("{}: pixel size in metres unknown", path.display())))?;
    let mut shade = vec![0; dtm.rows * dtm.cols];
    let misfit = |e: elunar_core::error::LengthError| Error::usage(format!("{}: {e}", path.display()));
    let heights = GridView::new(&dtm.samples, dtm.rows, dtm.cols).map_err(misfit)?;
    hillshade(heights, PixelSize { row_m, col_m }, Sun::default(), &mut shade).map_err(misfit)?;
    let picture = GrayImage::from_raw(dtm.cols as u32, dtm.rows as u32, shade).map(DynamicImage::from);
    write_png(path, picture)
}

/// Colours |error| by the paper's limits of 2, 4 and 10 m, too high in reds and too low in blues; black where there is none.
///
/// # Errors
/// [`Error::Io`] if the file cannot be written.
pub(super) fn write_error_map(path: &Path, error_m: &Raster) -> Result<()> {
    const HIGH: [[u8; 3]; 4] = [[245, 245, 240], [253, 204, 138], [240, 100, 60], [150, 0, 20]];
    const LOW: [[u8; 3]; 4] = [[235, 240, 245], [166, 200, 230], [60, 130, 200], [10, 40, 120]];
    let colour = |error: f32| {
        let class = LIMITS_M.iter().filter(|&&limit_m| f64::from(error.abs()) >= limit_m).count();
        if !error.is_finite() {
            [0; 3]
        } else if error < 0.0 {
            LOW[class]
        } else {
            HIGH[class]
        }
    };
    let pixel = |col: u32, row: u32| Rgb(colour(error_m.samples[row as usize * error_m.cols + col as usize]));
    let picture = RgbImage::from_fn(error_m.cols as u32, error_m.rows as u32, pixel);
    write_png(path, Some(DynamicImage::from(picture)))
}

fn write_png(path: &Path, picture: Option<DynamicImage>) -> Result<()> {
    let mut bytes = Cursor::new(Vec::new());
    let unwritable = |e: &dyn std::fmt::Display| Error::usage(format!("{}: {e}", path.display()));
    let picture = picture.ok_or_else(|| unwritable(&"one byte per pixel expected"))?;
    picture.write_to(&mut bytes, ImageFormat::Png).map_err(|e| unwritable(&e))?;
    atomic_write(path, &bytes.into_inner())
}
