//! Where laser spots lie on a raster.

use super::track::LaserSpot;
use elunar_base::{Error, Result};
use elunar_core::tile::Window;
use elunar_raster::{GeoRef, Projection};

/// A raster's grid, for the places of laser spots.
#[derive(Debug, Clone)]
pub struct SpotGrid {
    pub(super) georef: GeoRef,
    pub(super) projection: Projection,
    /// Rows and columns.
    pub(super) shape: (usize, usize),
}

impl SpotGrid {
    /// Prepares the grid of a raster of `shape` (rows, columns). `name` is its name in messages.
    ///
    /// # Errors
    /// [`Error::Input`] if the raster has no georeference, or its projection is not supported.
    pub fn new(georef: Option<&GeoRef>, shape: (usize, usize), name: &str) -> Result<Self> {
        let missing = |what: &str| Error::input(format!("{name}: a DTM with {what} expected, none found"));
        let georef = georef.cloned().ok_or_else(|| missing("a geotransform"))?;
        if georef.crs.is_empty() {
            return Err(missing("a coordinate reference system"));
        }
        let projection = Projection::of(&georef.crs).ok_or_else(|| {
            let (summary, remedy) = (georef.crs.summary(), georef.crs.remedy(name, None));
            Error::input(format!("{name}: a known map projection expected, found {summary}; {remedy}"))
        })?;
        Ok(Self { georef, projection, shape })
    }

    /// Returns the radius of the sphere, metres.
    #[must_use]
    pub fn sphere_m(&self) -> f64 {
        self.projection.radius_m()
    }

    /// Returns row and column of a spot between the centres of the first and the last pixels, to a thousandth of a pixel; `None` outside.
    /// (0, 0) is the centre of the first pixel. A spot on a centre then has no weight on the neighbours, which may be void.
    #[must_use]
    pub fn place(&self, spot: &LaserSpot) -> Option<(f64, f64)> {
        let is_on = |at: f64, pixels: usize| at >= 0.0 && at <= pixels as f64 - 1.0;
        let rounded = |at: f64| (1000.0 * at).round() / 1000.0;
        let mut places = self.places(spot).map(|(row, col)| (rounded(row), rounded(col)));
        places.find(|(row, col)| is_on(*row, self.shape.0) && is_on(*col, self.shape.1))
    }

    /// Returns all rows and columns of a spot, on the raster or not: a meridian has several values of x, in degrees as in metres.
    pub(super) fn places(&self, spot: &LaserSpot) -> impl Iterator<Item = (f64, f64)> {
        let period = self.projection.period().unwrap_or(0.0);
        let (x, y) = self.projection.forward(spot.lon_deg, spot.lat_deg);
        [0.0, period, -period].into_iter().filter_map(move |turn| pixel(&self.georef.transform, x + turn, y))
    }
}

/// Returns row and column of a map point. (0, 0) is the centre of the first pixel.
fn pixel(t: &[f64; 6], x: f64, y: f64) -> Option<(f64, f64)> {
    let determinant = t[1] * t[5] - t[2] * t[4];
    let (dx, dy) = (x - t[0], y - t[3]);
    let (col, row) = ((dx * t[5] - dy * t[2]) / determinant, (dy * t[1] - dx * t[4]) / determinant);
    (row.is_finite() && col.is_finite()).then_some((row - 0.5, col - 0.5))
}

/// Interpolates bilinearly at a row and column of a patch with the shape of `window`. The result is NaN if a sample with weight is NaN.
#[must_use]
pub fn bilinear(patch: &[f32], window: Window, row: f64, col: f64) -> f64 {
    let (top, left) = (row.floor().max(0.0), col.floor().max(0.0));
    let (down, right) = (row - top, col - left);
    let (top, left) = (top as usize, left as usize);
    let mut sum = 0.0;
    for (weight, r, c) in [
        ((1.0 - down) * (1.0 - right), top, left),
        ((1.0 - down) * right, top, left + 1),
        (down * (1.0 - right), top + 1, left),
        (down * right, top + 1, left + 1),
    ] {
        if weight.abs() > 1e-9 {
            sum += if r < window.rows && c < window.cols {
                weight * f64::from(patch[r * window.cols + c])
            } else {
                f64::NAN
            };
        }
    }
    sum
}
