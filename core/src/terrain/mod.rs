//! Terrain derivatives of a height grid in metres: Horn slope, surface normals, the hillshade of `gdaldem`, and the properties of a
//! lander's footprint: tilt, roughness, hazards.
//!
//! The first three read 3 x 3 pixels, the footprint a square of the caller's choice. Where the window leaves the grid or contains a pixel
//! that is not real (see [`crate::mask::is_real`]), there is no value: NaN, 0 in a hillshade (as `gdaldem` without `-compute_edges`), or
//! [`hazard::UNKNOWN`].
//!
//! [`TerrainLines`] computes all of them line by line, as the lines of a DTM arrive; the functions over a whole grid give the same bits.

mod error;
mod footprint;
pub mod hazard;
pub mod hillshade;
mod lines;
pub mod lunar_lambert;
pub mod normal;
pub mod slope;

pub use error::TerrainError;
pub use footprint::MAX_RADIUS_PX;
pub use hazard::HazardLimits;
pub use hillshade::{Sun, hillshade};
pub use lines::{LineMaps, LineOptions, LinesPaused, TerrainLines};
pub use lunar_lambert::lunar_lambert_weight;
pub use normal::normals;
pub use slope::slope_deg;

use crate::grid::GridView;
use crate::mask::is_real;

/// Size of a pixel on the ground, metres; both positive. Grids are north-up: rows go south, columns go east.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelSize {
    /// Distance from one row to the next.
    pub row_m: f64,
    /// Distance from one column to the next.
    pub col_m: f64,
}

impl PixelSize {
    /// Makes a square pixel.
    pub fn square(size_m: f64) -> Self {
        Self { row_m: size_m, col_m: size_m }
    }
}

/// Returns Horn's height gradient (metres per metre) at one pixel, towards east and towards south; `None` at edges and voids.
///
/// Horn (1981): each side of the pixel is averaged with weights 1, 2, 1; the sides are two pixels apart.
pub fn gradient(heights_m: GridView<'_, f32>, row: usize, col: usize, pixel: PixelSize) -> Option<(f64, f64)> {
    let first = row.checked_sub(1).filter(|_| row < heights_m.rows())?;
    of_lines([0, 1, 2].map(|i| heights_m.row(first + i)), col, pixel)
}

/// Returns the [`gradient`] in the middle one of three neighbouring lines, from north to south; a line that does not exist is empty.
fn of_lines(lines_m: [&[f32]; 3], col: usize, pixel: PixelSize) -> Option<(f64, f64)> {
    let first = col.checked_sub(1)?;
    let mut w = [[0.0f64; 3]; 3];
    for (line, source) in w.iter_mut().zip(lines_m) {
        let source = source.get(first..)?.get(..3)?;
        for (w, &height_m) in line.iter_mut().zip(source) {
            if !is_real(height_m) {
                return None;
            }
            *w = f64::from(height_m);
        }
    }
    let east = (w[0][2] + 2.0 * w[1][2] + w[2][2]) - (w[0][0] + 2.0 * w[1][0] + w[2][0]);
    let south = (w[2][0] + 2.0 * w[2][1] + w[2][2]) - (w[0][0] + 2.0 * w[0][1] + w[0][2]);
    Some((east / (8.0 * pixel.col_m), south / (8.0 * pixel.row_m)))
}
