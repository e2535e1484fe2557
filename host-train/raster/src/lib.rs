//! Rasters with a georeference on a sphere, and their file formats.

pub mod align;
mod binary;
pub mod content;
mod crs;
mod error;
pub mod format;
mod georef;
pub mod geotiff;
pub mod heights;
mod mask;
pub mod memory;
mod nodata;
pub mod npy;
pub mod output;
mod pam;
pub mod pds3;
mod projection;
pub mod quantile;
pub mod read;
pub mod resample;
pub mod source;
pub mod stated;
pub mod sun;
mod unit;

pub use crs::{Axes, Crs, MOON_RADIUS_M};
pub use error::{Error, Result};
pub use georef::{GeoRef, GeoTransform};
pub use output::atomic_write;
pub use projection::Projection;

use std::path::Path;

/// One band of samples with its georeference. Invalid samples are NaN.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    /// Rows (north to south in a north-up raster).
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Row-major samples; metres above the sphere for heights, relative brightness for images. Invalid samples hold NaN.
    pub samples: Vec<f32>,
    /// Georeference; `None` if the file has no transform.
    pub georef: Option<GeoRef>,
}

impl Raster {
    /// Returns the number of finite samples.
    #[must_use]
    pub fn valid_count(&self) -> usize {
        self.samples.iter().filter(|v| v.is_finite()).count()
    }

    /// Returns the smallest and largest valid sample; `None` if there is none.
    #[must_use]
    pub fn range(&self) -> Option<(f32, f32)> {
        self.samples.iter().filter(|v| v.is_finite()).fold(None, |range, &v| match range {
            None => Some((v, v)),
            Some((low, high)) => Some((low.min(v), high.max(v))),
        })
    }

    /// Returns the pixel size on the ground as (row spacing, column spacing) in metres, at the raster's centre; `None` without a
    /// georeference.
    #[must_use]
    pub fn pixel_m(&self) -> Option<(f64, f64)> {
        self.georef.as_ref()?.pixel_m(self.rows, self.cols)
    }
}

/// Returns the folder of a file: its parent, or `.` for a bare name.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bare_name_lies_in_the_current_folder() {
        for (path, folder) in [("a.tif", "."), ("b/a.tif", "b"), ("/a.tif", "/"), ("./a.tif", "."), ("", ".")] {
            assert_eq!(folder_of(Path::new(path)), Path::new(folder), "{path}");
        }
    }
}
