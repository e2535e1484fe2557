//! Terrain derivatives of a height grid in metres: Horn slope, surface normals, and the hillshade of `gdaldem`.
//!
//! All three look at 3 x 3 pixels. Where the window leaves the grid or meets a pixel that is not real (see
//! [`crate::mask::is_real`]), there is no value: NaN, or 0 in a hillshade, as `gdaldem` does without `-compute_edges`.

pub mod hillshade;
pub mod lunar_lambert;
pub mod normal;
pub mod slope;

pub use hillshade::{Sun, hillshade};
pub use lunar_lambert::lunar_lambert_weight;
pub use normal::normals;
pub use slope::slope_deg;

use crate::grid::GridView;
use crate::mask::is_real;

/// Size of a pixel on the ground, metres; both positive. Grids are north-up: rows go south, columns go east.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelSize {
    /// From one row to the next.
    pub row_m: f64,
    /// From one column to the next.
    pub col_m: f64,
}

impl PixelSize {
    /// A square pixel.
    pub fn square(size_m: f64) -> Self {
        Self { row_m: size_m, col_m: size_m }
    }
}

/// Horn's height gradient (metres per metre) at one pixel, towards east and towards south; `None` at edges and voids.
///
/// Horn (1981): each side of the pixel is averaged with weights 1, 2, 1; the difference of the sides spans two pixels.
pub fn gradient(heights_m: GridView<'_, f32>, row: usize, col: usize, pixel: PixelSize) -> Option<(f64, f64)> {
    if row == 0 || col == 0 || row >= heights_m.rows() || col >= heights_m.cols() {
        return None;
    }
    let mut w = [[0.0f64; 3]; 3];
    for (i, line) in w.iter_mut().enumerate() {
        let source = heights_m.row(row - 1 + i).get(col - 1..col + 2)?;
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
