//! The ground under a lander or rover: the plane under the vehicle, and the deviations from it.

use super::PixelSize;
use super::slope::from_gradient_deg;
use crate::mask::is_real;

/// Largest radius of a footprint, pixels. It limits the work per pixel, which grows with the square of the radius (our choice: 33 x 33
/// pixels are a lander of 16 m in a DTM of 0.5 m).
pub const MAX_RADIUS_PX: usize = 16;
/// Number of lines of the largest footprint.
pub(super) const MAX_SIDE: usize = 2 * MAX_RADIUS_PX + 1;

/// Properties of the ground in a square of pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Footprint {
    /// Slope of the least-squares plane, degrees from horizontal.
    pub(super) slope_deg: f64,
    /// Largest distance of a pixel from that plane, up or down, metres along the vertical.
    pub(super) roughness_m: f64,
}

/// Returns the footprint of 2r + 1 lines, from north to south, around `col` of the middle line; `None` if the window leaves the lines or
/// contains a pixel that is not real. A line that does not exist is empty.
///
/// The plane is z = c + a x + b y with x and y in pixels from the centre. On a full square Σx = Σy = Σxy = 0, so the normal equations are
/// independent: c = Σz/n, a = Σxz/Σx², b = Σyz/Σy², with n = (2r + 1)² and Σx² = Σy² = n r (r + 1)/3.
pub(super) fn at(lines_m: &[&[f32]], col: usize, radius_px: usize, pixel: PixelSize) -> Option<Footprint> {
    let (first, side, r) = (col.checked_sub(radius_px)?, 2 * radius_px + 1, radius_px as f64);
    // Heights relative to the centre, because heights above the sphere would lose digits.
    let centre_m = f64::from(*lines_m.get(radius_px)?.get(col)?);
    let (mut sum, mut east, mut south) = (0.0, 0.0, 0.0);
    for (row, line) in lines_m.iter().enumerate() {
        let (mut line_sum, mut line_east) = (0.0, 0.0);
        for (i, &height_m) in line.get(first..)?.get(..side)?.iter().enumerate() {
            if !is_real(height_m) {
                return None;
            }
            let above_m = f64::from(height_m) - centre_m;
            line_sum += above_m;
            line_east += (i as f64 - r) * above_m;
        }
        sum += line_sum;
        east += line_east;
        south += (row as f64 - r) * line_sum;
    }
    let count = (side * side) as f64;
    let squares = count * r * (r + 1.0) / 3.0;
    let (mean_m, east, south) = (sum / count, east / squares, south / squares);
    let mut roughness_m = 0.0f64;
    for (row, line) in lines_m.iter().enumerate() {
        let plane_m = mean_m + (row as f64 - r) * south;
        for (i, &height_m) in line.get(first..)?.get(..side)?.iter().enumerate() {
            let above_m = f64::from(height_m) - centre_m;
            roughness_m = roughness_m.max((above_m - (plane_m + (i as f64 - r) * east)).abs());
        }
    }
    Some(Footprint { slope_deg: from_gradient_deg((east / pixel.col_m, south / pixel.row_m)), roughness_m })
}
