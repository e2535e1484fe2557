//! A reduced map for a picture, made while its rows come.

use elunar_raster::{GeoRef, Raster};

/// Longest side of a hillshade, pixels. Browsers and viewers can open it, and the memory for a strip of any length is bounded.
pub(super) const LONGEST_PX: usize = 8192;

/// Means over square cells of a raster whose rows arrive one by one. Invalid samples are left out.
pub struct Preview {
    cell: usize,
    rows: usize,
    cols: usize,
    georef: GeoRef,
    row: usize,
    sums: Vec<(f64, u32)>,
    samples: Vec<f32>,
}

impl Preview {
    /// Starts a map of `rows` x `cols` samples, whose longer side becomes at most `longest_px`.
    #[must_use]
    pub fn new(rows: usize, cols: usize, georef: GeoRef, longest_px: usize) -> Self {
        let cell = rows.max(cols).div_ceil(longest_px.max(1)).max(1);
        Self { cell, rows, cols, georef, row: 0, sums: vec![(0.0, 0); cols.div_ceil(cell)], samples: vec![] }
    }

    /// Adds whole rows, in order.
    pub fn add(&mut self, samples: &[f32]) {
        for line in samples.chunks_exact(self.cols) {
            for (sum, cell) in self.sums.iter_mut().zip(line.chunks(self.cell)) {
                for z in cell.iter().filter(|z| z.is_finite()) {
                    *sum = (sum.0 + f64::from(*z), sum.1 + 1);
                }
            }
            self.row += 1;
            if self.row.is_multiple_of(self.cell) || self.row == self.rows {
                // A cell without a valid sample becomes 0 / 0 = NaN.
                self.samples.extend(self.sums.iter().map(|(sum, n)| (sum / f64::from(*n)) as f32));
                self.sums.fill((0.0, 0));
            }
        }
    }

    /// Returns the reduced raster with its georeference.
    #[must_use]
    pub fn finish(self) -> Raster {
        let [x0, x_col, x_row, y0, y_col, y_row] = self.georef.transform;
        let k = self.cell as f64;
        let transform = [x0, x_col * k, x_row * k, y0, y_col * k, y_row * k];
        let cols = self.sums.len();
        let georef = Some(GeoRef { transform, ..self.georef });
        Raster { rows: self.samples.len() / cols.max(1), cols, samples: self.samples, georef }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::sun::Body;
    use elunar_raster::Crs;

    fn preview(rows: usize, cols: usize, height: impl Fn(usize, usize) -> f32) -> Raster {
        let georef = GeoRef {
            transform: [10.0, 2.0, 0.0, 50.0, 0.0, -2.0],
            crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0),
        };
        let mut preview = Preview::new(rows, cols, georef, LONGEST_PX);
        for row in 0..rows {
            preview.add(&(0..cols).map(|col| height(row, col)).collect::<Vec<f32>>());
        }
        preview.finish()
    }

    #[test]
    fn small_scenes_stay_as_they_are() {
        let found = preview(7, 5, |r, c| if (r, c) == (2, 2) { f32::NAN } else { (r * 5 + c) as f32 });
        assert_eq!((found.rows, found.cols, found.samples[34], found.samples[12].is_nan()), (7, 5, 34.0, true));
        assert_eq!(found.pixel_m(), Some((2.0, 2.0)));
    }

    #[test]
    fn long_ones_are_averaged() {
        let found = preview(3 * LONGEST_PX - 1, 7, |r, c| {
            if r < 3 && c < 3 || c == 4 && r % 3 > 0 { f32::NAN } else { (c / 3) as f32 + (r / 3) as f32 }
        });
        assert_eq!((found.rows, found.cols), (LONGEST_PX, 3));
        assert!(found.samples[0].is_nan());
        assert_eq!(found.samples[1..6], [1.0, 2.0, 1.0, 2.0, 3.0]);
        assert_eq!(found.pixel_m(), Some((6.0, 6.0)));
    }
}
