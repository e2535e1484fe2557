//! Surface normals.

use super::{PixelSize, gradient};
use crate::error::{LengthError, same_length};
use crate::grid::GridView;

/// Returns the upward unit normal (east, north, up) of a surface with the given gradient (towards east and south, metres per metre).
pub fn from_gradient(east: f64, south: f64) -> [f64; 3] {
    let length = libm::sqrt(east * east + south * south + 1.0);
    [-east / length, south / length, 1.0 / length]
}

/// Writes the upward unit normal (east, north, up) of every pixel, from Horn's gradient; NaN at the grid's edge and beside pixels that are
/// not real.
///
/// # Errors
/// [`LengthError`] if `out` does not have one normal per pixel.
pub fn normals(heights_m: GridView<'_, f32>, pixel: PixelSize, out: &mut [[f32; 3]]) -> Result<(), LengthError> {
    let (rows, cols) = (heights_m.rows(), heights_m.cols());
    same_length(rows * cols, out.len())?;
    for (i, out) in out.iter_mut().enumerate() {
        *out = gradient(heights_m, i / cols, i % cols, pixel)
            .map_or([f32::NAN; 3], |(east, south)| from_gradient(east, south).map(|c| c as f32));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn normals_of_a_plane_are_perpendicular_to_it(east in -3.0f64..3.0, north in -3.0f64..3.0) {
            let heights: Vec<f32> = (0..9).map(|i| (east * (i % 3) as f64 - north * (i / 3) as f64) as f32).collect();
            let mut out = [[0.0; 3]; 9];
            normals(GridView::new(&heights, 3, 3).unwrap(), PixelSize::square(1.0), &mut out).unwrap();
            let [x, y, z] = out[4].map(f64::from);
            prop_assert!((x + east * z).abs() < 1e-5 && (y + north * z).abs() < 1e-5);
            prop_assert!((x * x + y * y + z * z - 1.0).abs() < 1e-6 && z > 0.0);
            prop_assert!(out[0][0].is_nan());
        }
    }
}
