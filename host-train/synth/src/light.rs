//! Sunlight on terrain: Lunar–Lambert reflectance and cast shadows, seen from straight above.

use elunar_core::terrain::lunar_lambert_weight;

/// Angular radius of the Sun, radians.
const SUN_RADIUS_RAD: f32 = 0.00465;
/// Light that shadows receive from lit ground around them, as a share of the light on level ground (our choice).
const SCATTERED: f32 = 0.004;

/// Direction to the Sun.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sun {
    /// Degrees clockwise from north (up).
    pub azimuth_deg: f64,
    /// Degrees above the horizon.
    pub elevation_deg: f64,
}

impl Sun {
    /// Returns the unit vector towards the Sun: east (columns), south (rows), up.
    fn direction(&self) -> [f64; 3] {
        let (sin_az, cos_az) = libm::sincos(self.azimuth_deg.to_radians());
        let (sin_el, cos_el) = libm::sincos(self.elevation_deg.to_radians());
        [sin_az * cos_el, -cos_az * cos_el, sin_el]
    }
}

/// Returns the reflectance (per unit albedo) of a row-major height field for a camera at nadir, with shadows. The phase angle gives the
/// weight of the Lommel–Seeliger law. `weight_shift` is added to it; the sum is clamped to 0 to 1.
pub(super) fn reflectance(
    heights_m: &[f32],
    [rows, cols]: [usize; 2],
    pixel_m: f64,
    sun: &Sun,
    weight_shift: f32,
) -> Vec<f32> {
    let lit = visibility(heights_m, rows, cols, pixel_m, sun);
    let [east, south, up] = sun.direction().map(|v| v as f32);
    let weight = (lunar_lambert_weight(90.0 - sun.elevation_deg) as f32 + weight_shift).clamp(0.0, 1.0);
    let mut out = vec![0.0; rows * cols];
    let per_m = (0.5 / pixel_m) as f32;
    for row in 0..rows {
        let (above, below) = (row.saturating_sub(1) * cols, (row + 1).min(rows - 1) * cols);
        for col in 0..cols {
            let (left, right) = (col.saturating_sub(1), (col + 1).min(cols - 1));
            let gx = (heights_m[row * cols + right] - heights_m[row * cols + left]) * per_m;
            let gy = (heights_m[below + col] - heights_m[above + col]) * per_m;
            let mu = 1.0 / (1.0 + gx * gx + gy * gy).sqrt();
            let mu0 = (up - gx * east - gy * south) * mu;
            let direct = if mu0 > 0.0 {
                (2.0 * weight * mu0 / (mu0 + mu) + (1.0 - weight) * mu0) * lit[row * cols + col]
            } else {
                0.0
            };
            out[row * cols + col] = direct + SCATTERED * up;
        }
    }
    out
}

/// Returns the visible share of the solar disc for each pixel, 0–1.
///
/// The field is cut into lines that run towards the Sun, one pixel apart. A pass along each line, away from the Sun, tracks the height of
/// the shadow's upper edge. This is exact along the line, with one interpolation into the lines and one back, O(pixels).
pub(super) fn visibility(heights_m: &[f32], rows: usize, cols: usize, pixel_m: f64, sun: &Sun) -> Vec<f32> {
    let [east, south, _] = sun.direction();
    let drop_per_m = libm::tan(sun.elevation_deg.to_radians()) as f32;
    if libm::hypot(east, south) < 1e-6 {
        return vec![1.0; rows * cols];
    }
    let penumbra_per_m = SUN_RADIUS_RAD * (1.0 + drop_per_m * drop_per_m);
    let walk = |field: &[f32], rows: usize, cols: usize, down: f64, across: f64| {
        let step_m = (pixel_m * libm::hypot(down, across) / down.abs()) as f32;
        let walk =
            Walk { drop_m: step_m * drop_per_m, penumbra_m: step_m * penumbra_per_m, soft_m: 0.05 * pixel_m as f32 };
        walk.away_from_sun(field, rows, cols, down > 0.0, across / down)
    };
    if south.abs() >= east.abs() {
        walk(heights_m, rows, cols, south, east)
    } else {
        let turned = walk(&transpose(heights_m, rows, cols), cols, rows, east, south);
        transpose(&turned, cols, rows)
    }
}

/// Constants of one step of a pass away from the Sun, in metres of height.
struct Walk {
    /// Fall of the shadow's edge per step.
    drop_m: f32,
    /// Growth of half the penumbra per step.
    penumbra_m: f32,
    /// Least half width of the penumbra, so that edges are not jagged.
    soft_m: f32,
}

impl Walk {
    /// Passes over the rows from the last to the first if the Sun is beyond the last, otherwise from the first to the last. Lines shift by
    /// `shear` columns per row.
    fn away_from_sun(&self, field: &[f32], rows: usize, cols: usize, sun_after_last: bool, shear: f64) -> Vec<f32> {
        let total_shift = (shear * (rows - 1) as f64).abs().ceil() as usize + 1;
        let lines = cols + total_shift + 1;
        // Line j is at column j + offset(row) of the row. The least offset is -total_shift.
        let base = if shear < 0.0 { 0.0 } else { -(total_shift as f64) };
        let mut edge_m = vec![f32::NEG_INFINITY; lines];
        let mut penumbra_m = vec![0.0f32; lines];
        let mut seen = vec![1.0f32; lines];
        let mut out = vec![1.0; rows * cols];
        for step in 0..rows {
            let row = if sun_after_last { rows - 1 - step } else { step };
            let offset = base + shear * row as f64;
            let whole = offset.floor();
            let (fraction, whole) = ((offset - whole) as f32, whole as isize);
            let heights = &field[row * cols..][..cols];
            // Lines between the first and the last column of this row.
            let first = (-whole).max(0) as usize;
            let end = ((cols as isize - 1 - whole).max(0) as usize).min(lines);
            for line in first..end {
                let col = (line as isize + whole) as usize;
                let height = heights[col] + fraction * (heights[col + 1] - heights[col]);
                let edge = edge_m[line] - self.drop_m;
                let soft = penumbra_m[line] + self.penumbra_m;
                seen[line] = (0.5 + 0.5 * (height - edge) / soft.max(self.soft_m)).clamp(0.0, 1.0);
                let free = height >= edge;
                edge_m[line] = if free { height } else { edge };
                penumbra_m[line] = if free { 0.0 } else { soft };
            }
            if first >= end {
                continue;
            }
            for (col, value) in out[row * cols..][..cols].iter_mut().enumerate() {
                // Line col - whole is `fraction` to the right of this pixel. The line before it is 1 - `fraction` to the left.
                let right = (col as isize - whole).clamp(first as isize, end as isize - 1) as usize;
                let left = (col as isize - whole - 1).clamp(first as isize, end as isize - 1) as usize;
                *value = seen[right] * (1.0 - fraction) + seen[left] * fraction;
            }
        }
        out
    }
}

fn transpose(field: &[f32], rows: usize, cols: usize) -> Vec<f32> {
    const BLOCK: usize = 16;
    let mut out = vec![0.0; field.len()];
    for r0 in (0..rows).step_by(BLOCK) {
        for c0 in (0..cols).step_by(BLOCK) {
            for r in r0..(r0 + BLOCK).min(rows) {
                for c in c0..(c0 + BLOCK).min(cols) {
                    out[c * rows + r] = field[r * cols + c];
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sun(azimuth_deg: f64, elevation_deg: f64) -> Sun {
        Sun { azimuth_deg, elevation_deg }
    }

    #[test]
    fn level_ground_reflects_by_the_formula() {
        let out = reflectance(&[5.0; 64], [8, 8], 2.0, &sun(70.0, 30.0), 0.0);
        let (weight, mu0) = (0.416f32, 0.5);
        let expected = 2.0 * weight * mu0 / (mu0 + 1.0) + (1.0 - weight) * mu0 + SCATTERED * mu0;
        // The weight has three decimals.
        assert!(out.iter().all(|v| (v - expected).abs() < 2e-3), "{} instead of {expected}", out[0]);
    }

    #[test]
    fn a_shifted_weight_runs_from_lambert_to_lommel_seeliger() {
        let level = |shift| reflectance(&[5.0; 64], [8, 8], 2.0, &sun(70.0, 30.0), shift)[0] - SCATTERED * 0.5;
        for (shift, expected) in [(-1.0, 0.5), (1.0, 2.0 * 0.5 / 1.5)] {
            assert!((level(shift) - expected).abs() < 1e-5, "{} instead of {expected}", level(shift));
        }
    }

    #[test]
    fn slopes_towards_the_sun_are_brighter() {
        let ramp: Vec<f32> = (0..400).map(|k| 0.2 * (k % 20) as f32).collect();
        // Ground that rises eastwards faces west. Ground that rises southwards faces north.
        let at = |azimuth_deg| reflectance(&ramp, [20, 20], 2.0, &sun(azimuth_deg, 40.0), 0.0)[210];
        assert!(at(270.0) > at(0.0) && at(0.0) > at(90.0));
        let ramp: Vec<f32> = (0..400).map(|k| 0.2 * (k / 20) as f32).collect();
        let at = |azimuth_deg| reflectance(&ramp, [20, 20], 2.0, &sun(azimuth_deg, 40.0), 0.0)[210];
        assert!(at(0.0) > at(90.0) && at(90.0) > at(180.0));
    }

    #[test]
    fn a_wall_casts_a_shadow_of_its_height_over_the_tangent() {
        let (rows, cols, pixel_m, height_m) = (101, 121, 2.0, 30.0);
        for elevation_deg in [20.0f64, 35.0, 50.0] {
            let length_px = height_m / elevation_deg.to_radians().tan() / pixel_m;
            for azimuth_deg in [0.0, 90.0, 180.0, 270.0] {
                let along_rows = azimuth_deg % 180.0 == 90.0;
                let wall: Vec<f32> = (0..rows * cols)
                    .map(|k| if along_rows { k % cols == 60 } else { k / cols == 50 })
                    .map(|wall| if wall { height_m as f32 } else { 0.0 })
                    .collect();
                let lit = visibility(&wall, rows, cols, pixel_m, &sun(azimuth_deg, elevation_deg));
                let line = |k: usize| if along_rows { lit[50 * cols + k] } else { lit[k * cols + 60] };
                let dark: f32 = (0..if along_rows { cols } else { rows }).map(|k| 1.0 - line(k)).sum();
                assert!(
                    (f64::from(dark) - length_px).abs() < 1.0,
                    "Sun {elevation_deg}° high from {azimuth_deg}°: {dark} px, expected {length_px}"
                );
                // The shadow falls away from the Sun.
                let behind = match azimuth_deg as u32 {
                    0 => line(55),
                    90 => line(55),
                    180 => line(45),
                    _ => line(65),
                };
                assert!(behind < 0.01, "Sun from {azimuth_deg}°");
            }
        }
    }

    /// Computes visibility directly: small steps from each pixel towards the Sun, with bilinear heights.
    fn naive_visibility(heights_m: &[f32], rows: usize, cols: usize, pixel_m: f64, sun: &Sun) -> Vec<bool> {
        let [east, south, up] = sun.direction();
        let level = east.hypot(south);
        let height = |r: f64, c: f64| {
            let (i, j) = (r.floor(), c.floor());
            let (fr, fc) = (r - i, c - j);
            let at = |di: usize, dj: usize| {
                f64::from(heights_m[(i as usize + di).min(rows - 1) * cols + (j as usize + dj).min(cols - 1)])
            };
            (at(0, 0) * (1.0 - fc) + at(0, 1) * fc) * (1.0 - fr) + (at(1, 0) * (1.0 - fc) + at(1, 1) * fc) * fr
        };
        (0..rows * cols)
            .map(|k| {
                let (r0, c0) = ((k / cols) as f64, (k % cols) as f64);
                (1..2000).all(|n| {
                    let distance_px = 0.25 * f64::from(n);
                    let (r, c) = (r0 + distance_px * south / level, c0 + distance_px * east / level);
                    let outside = r < 0.0 || c < 0.0 || r > (rows - 1) as f64 || c > (cols - 1) as f64;
                    outside || height(r, c) <= f64::from(heights_m[k]) + distance_px * pixel_m * up / level
                })
            })
            .collect()
    }

    #[test]
    fn shadows_are_those_of_a_ray_through_every_pixel() {
        let (rows, cols) = (90, 110);
        let heights: Vec<f32> = (0..rows * cols)
            .map(|k| {
                let (r, c) = ((k / cols) as f32, (k % cols) as f32);
                12.0 * (0.13 * r + 0.05 * c).sin() * (0.11 * c - 0.04 * r).cos()
                    + 3.0 * (0.5 * r).sin() * (0.4 * c).cos()
            })
            .collect();
        for azimuth_deg in [10.0, 63.0, 117.0, 170.0, 200.0, 255.0, 290.0, 340.0] {
            let sun = sun(azimuth_deg, 20.0);
            let fast = visibility(&heights, rows, cols, 2.0, &sun);
            let naive = naive_visibility(&heights, rows, cols, 2.0, &sun);
            // At the rim of a shadow the two interpolations differ. A pixel whose neighbours are all equal to it must agree.
            let inner = |k: usize| {
                let (r, c) = (k / cols, k % cols);
                let border = r == 0 || c == 0 || r == rows - 1 || c == cols - 1;
                !border && (r - 1..=r + 1).all(|r| (c - 1..=c + 1).all(|c| naive[r * cols + c] == naive[k]))
            };
            let inner: Vec<usize> = (0..rows * cols).filter(|k| inner(*k)).collect();
            let shadow = inner.iter().filter(|k| !naive[**k]).count();
            let wrong = inner.iter().filter(|k| (fast[**k] > 0.5) != naive[**k]).count();
            assert!(shadow > 500 && inner.len() - shadow > 500, "{shadow} of {} pixels in shadow", inner.len());
            assert!(wrong * 500 <= inner.len(), "Sun from {azimuth_deg}°: {wrong} of {} pixels differ", inner.len());
        }
    }
}
