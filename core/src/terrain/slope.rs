//! Slope by Horn's method.

use super::{PixelSize, gradient};
use crate::error::{LengthError, same_length};
use crate::grid::GridView;

/// Writes the slope of every pixel in degrees from horizontal, [0, 90); NaN at the grid's edge and beside pixels that are not real. As
/// `gdaldem slope`.
///
/// ```
/// use elunar_core::{grid::GridView, terrain::{PixelSize, slope_deg}};
/// let plane = [0.0, 2.0, 4.0, 0.0, 2.0, 4.0, 0.0, 2.0, 4.0]; // rises 2 m per 2 m pixel
/// let mut out = [0.0; 9];
/// slope_deg(GridView::new(&plane, 3, 3)?, PixelSize::square(2.0), &mut out)?;
/// assert_eq!(out[4], 45.0);
/// assert!(out[0].is_nan());
/// # Ok::<(), elunar_core::error::LengthError>(())
/// ```
///
/// # Errors
/// [`LengthError`] if `out` does not have one sample per pixel.
pub fn slope_deg(heights_m: GridView<'_, f32>, pixel: PixelSize, out: &mut [f32]) -> Result<(), LengthError> {
    let (rows, cols) = (heights_m.rows(), heights_m.cols());
    same_length(rows * cols, out.len())?;
    for (i, out) in out.iter_mut().enumerate() {
        *out = at_deg(heights_m, i / cols, i % cols, pixel).map_or(f32::NAN, |slope| slope as f32);
    }
    Ok(())
}

/// Returns the slope of one pixel in degrees; `None` where [`gradient`] is `None`.
pub(crate) fn at_deg(heights_m: GridView<'_, f32>, row: usize, col: usize, pixel: PixelSize) -> Option<f64> {
    gradient(heights_m, row, col, pixel).map(from_gradient_deg)
}

/// Returns the slope in degrees of a surface with the given gradient (towards east and south, metres per metre).
pub(crate) fn from_gradient_deg((east, south): (f64, f64)) -> f64 {
    libm::atan(libm::sqrt(east * east + south * south)).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The angle between the vertical and the product of two vectors in the surface.
        #[test]
        fn the_slope_is_the_tilt_of_the_normal(east in -3.0f64..3.0, south in -3.0f64..3.0) {
            // A step to the east and one to the north, with what they rise.
            let (a, b) = ([1.0, 0.0, east], [0.0, 1.0, -south]);
            let normal = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
            let level = libm::hypot(normal[0], normal[1]);
            let expected = libm::atan2(level, normal[2]).to_degrees();
            prop_assert!((from_gradient_deg((east, south)) - expected).abs() < 1e-9);
        }
    }

    #[test]
    fn non_square_pixels_and_voids() {
        let mut heights = [0.0f32; 25];
        for (i, h) in heights.iter_mut().enumerate() {
            *h = (i / 5) as f32 * 3.0; // 3 m per row
        }
        heights[24] = f32::NAN;
        let mut out = [0.0; 25];
        let pixel = PixelSize { row_m: 3.0, col_m: 100.0 };
        slope_deg(GridView::new(&heights, 5, 5).unwrap(), pixel, &mut out).unwrap();
        assert_eq!(out[2 * 5 + 2], 45.0);
        assert!(out[3 * 5 + 3].is_nan(), "touches the void");
        assert_eq!(out.iter().filter(|s| s.is_finite()).count(), 8);
    }

    #[test]
    fn grids_without_an_inside_have_no_slope() {
        let mut out = [0.0; 4];
        slope_deg(GridView::new(&[1.0, 2.0, 3.0, 4.0], 2, 2).unwrap(), PixelSize::square(1.0), &mut out).unwrap();
        assert!(out.iter().all(|s| s.is_nan()));
        let grid = GridView::new(&[0.0f32; 9], 3, 3).unwrap();
        for (row, col) in [(usize::MAX, 1), (1, usize::MAX), (3, 1), (1, 2)] {
            assert_eq!(gradient(grid, row, col, PixelSize::square(1.0)), None);
        }
        slope_deg(GridView::new(&[], 3, 0).unwrap(), PixelSize::square(1.0), &mut []).unwrap();
    }
}
