//! From where the Sun shines, and how a scene is mirrored so that it shines from where the network expects it.
//!
//! One image does not tell a bump lit from the left from a hollow lit from the right. The paper's network must find the Sun
//! within every tile; ours may be trained with the Sun in the north-west quadrant of the grid only
//! ([`Illumination::Northwest`]), and a scene is mirrored left–right and up–down to make that so (our choice: the shading of
//! small relief then has one sign per axis, and training is shorter by far). Mirroring turns light and shape together, so
//! nothing is lost, and the result is mirrored back.

use crate::model::config::Illumination;

/// Side of the cells over which image and coarse DTM are compared, pixels: about the coarse DTM's resolution at 2 m a pixel.
const CELL_PX: usize = 24;

/// Mirrorings of a row-major map, undone by applying them again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Turn {
    /// First row last.
    pub rows: bool,
    /// First column last.
    pub cols: bool,
}

impl Turn {
    /// The turn that brings a Sun of this azimuth (degrees clockwise from up) into the north-west quadrant.
    pub fn from_azimuth_deg(azimuth_deg: f64) -> Self {
        let (east, north) = azimuth_deg.to_radians().sin_cos();
        Self { rows: north < 0.0, cols: east > 0.0 }
    }

    /// What `illumination` asks of a scene: nothing, or the turn from the Sun's azimuth, estimated where it is not known.
    pub fn wanted(
        illumination: Illumination,
        azimuth_deg: Option<f64>,
        image: &[f32],
        coarse_m: &[f32],
        shape: (usize, usize),
    ) -> Self {
        if illumination == Illumination::Any {
            return Self::default();
        }
        azimuth_deg
            .or_else(|| estimate_azimuth_deg(image, coarse_m, shape))
            .map_or_else(Self::default, Self::from_azimuth_deg)
    }

    /// Whether nothing is mirrored.
    pub fn is_none(self) -> bool {
        self == Self::default()
    }

    /// The mirrored map.
    pub fn apply<T: Copy>(self, map: &[T], cols: usize) -> Vec<T> {
        let rows = map.len() / cols.max(1);
        let mut out = Vec::with_capacity(map.len());
        for i in 0..rows {
            let row = if self.rows { rows - 1 - i } else { i };
            let line = &map[row * cols..][..cols];
            if self.cols { out.extend(line.iter().rev()) } else { out.extend(line) }
        }
        out
    }
}

/// The Sun's azimuth (degrees clockwise from up) that best explains an image by the slopes of its coarse DTM, both row-major
/// of `shape`; `None` if one of them is featureless. See [`SunEstimate`].
pub fn estimate_azimuth_deg(image: &[f32], coarse_m: &[f32], shape: (usize, usize)) -> Option<f64> {
    let mut sun = SunEstimate::default();
    sun.add(image, coarse_m, shape);
    sun.azimuth_deg()
}

/// Finds the Sun's azimuth in as much of a scene as it is shown.
///
/// For small slopes brightness is linear in them: I = a + b_x ∂z/∂x + b_y ∂z/∂y (x east, y south), falling towards the Sun's
/// side; a least-squares fit over cells of 24 pixels gives b, and the azimuth is that of (-b_x, b_y). Pixels that are not finite
/// are left out.
#[derive(Debug, Clone, Default)]
pub struct SunEstimate {
    /// Brightness and the differences of height to the east and south, of each cell.
    cells: Vec<[f64; 3]>,
}

impl SunEstimate {
    /// Shows it a rectangle of `shape`, row-major.
    pub fn add(&mut self, image: &[f32], coarse_m: &[f32], (rows, cols): (usize, usize)) {
        let (grid_rows, grid_cols) = (rows / CELL_PX, cols / CELL_PX);
        if grid_rows < 3 || grid_cols < 3 {
            return;
        }
        let (image, height) = (cells(image, cols, grid_rows, grid_cols), cells(coarse_m, cols, grid_rows, grid_cols));
        let at = |map: &[f64], r: usize, c: usize| map[r * grid_cols + c];
        let found = (1..grid_rows - 1).flat_map(|r| (1..grid_cols - 1).map(move |c| (r, c))).map(|(r, c)| {
            let dx = at(&height, r, c + 1) - at(&height, r, c - 1);
            let dy = at(&height, r + 1, c) - at(&height, r - 1, c);
            [at(&image, r, c), dx, dy]
        });
        self.cells.extend(found.filter(|cell| cell.iter().all(|v| v.is_finite())));
    }

    /// Degrees clockwise from up; `None` if what was shown is featureless or too small.
    #[must_use]
    pub fn azimuth_deg(&self) -> Option<f64> {
        let n = self.cells.len() as f64;
        let mean: [f64; 3] = std::array::from_fn(|k| self.cells.iter().map(|s| s[k]).sum::<f64>() / n);
        let covariance =
            |a: usize, b: usize| self.cells.iter().map(|s| (s[a] - mean[a]) * (s[b] - mean[b])).sum::<f64>();
        let (xx, yy, xy) = (covariance(1, 1), covariance(2, 2), covariance(1, 2));
        let (ix, iy) = (covariance(0, 1), covariance(0, 2));
        let determinant = xx * yy - xy * xy;
        let (bx, by) = ((ix * yy - iy * xy) / determinant, (iy * xx - ix * xy) / determinant);
        let azimuth = (-bx).atan2(by).to_degrees().rem_euclid(360.0);
        (azimuth.is_finite() && (bx, by) != (0.0, 0.0)).then_some(azimuth)
    }
}

/// Means over cells.
fn cells(map: &[f32], cols: usize, grid_rows: usize, grid_cols: usize) -> Vec<f64> {
    let mut out = vec![0.0; grid_rows * grid_cols];
    for (r, line) in map.chunks_exact(cols).take(grid_rows * CELL_PX).enumerate() {
        for (c, &v) in line.iter().take(grid_cols * CELL_PX).enumerate() {
            out[r / CELL_PX * grid_cols + c / CELL_PX] += f64::from(v);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::{Moon, SynthOptions};

    #[test]
    fn turns_bring_every_sun_to_the_north_west_and_undo_themselves() {
        for azimuth in (5..360).step_by(10).map(f64::from) {
            let turn = Turn::from_azimuth_deg(azimuth);
            let (mut east, mut north) = azimuth.to_radians().sin_cos();
            east *= if turn.cols { -1.0 } else { 1.0 };
            north *= if turn.rows { -1.0 } else { 1.0 };
            assert!(east <= 0.0 && north >= 0.0, "{azimuth}");
        }
        let map = [1, 2, 3, 4, 5, 6];
        let turn = Turn { rows: true, cols: true };
        assert_eq!(turn.apply(&map, 3), [6, 5, 4, 3, 2, 1]);
        assert_eq!(turn.apply(&turn.apply(&map, 3), 3), map);
    }

    #[test]
    fn the_sun_is_found_in_synthetic_scenes() {
        let options = SynthOptions { rows: 512, cols: 640, ..SynthOptions::default() };
        let moon = Moon::new(11, options).unwrap();
        let errors: Vec<f64> = (0..24)
            .map(|index| {
                let tile = moon.tile(index);
                let found = estimate_azimuth_deg(&tile.image, &tile.coarse_m, (tile.rows, tile.cols)).unwrap();
                let error = (found - tile.sun_azimuth_deg + 180.0).rem_euclid(360.0) - 180.0;
                error.abs()
            })
            .collect();
        let good = errors.iter().filter(|e| **e < 45.0).count();
        eprintln!("azimuth errors, degrees: {errors:.0?}");
        assert!(good >= 18, "{good} of 24 within 45 degrees: {errors:.0?}");
    }

    #[test]
    fn a_featureless_scene_has_no_sun() {
        let flat = vec![1.0f32; 96 * 96];
        assert_eq!(estimate_azimuth_deg(&flat, &flat, (96, 96)), None);
        assert_eq!(estimate_azimuth_deg(&flat[..64], &flat[..64], (8, 8)), None);
    }
}
