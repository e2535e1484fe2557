#![doc = include_str!("../README.md")]

pub mod align;
mod binary;
mod bytes;
pub mod content;
mod crs;
pub mod footprint;
pub mod format;
#[cfg(test)]
mod gdal_tests;
mod georef;
pub mod geotiff;
pub mod heights;
mod http;
pub mod isis;
mod mask;
mod named_map;
mod nodata;
pub mod npy;
mod pam;
pub mod pds3;
pub mod pds4;
mod projection;
mod relabelled;
pub mod resample;
pub mod source;
pub mod stated;
pub mod sun;
#[cfg(not(target_family = "wasm"))]
mod through_gdal;
mod unit;
pub mod vrt;
mod xml;

pub use crs::{Axes, Crs};
pub use elunar_base::{Error, Result};
pub use elunar_core::tile::Window;
pub use georef::{GeoRef, GeoTransform};
pub use projection::Projection;

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
