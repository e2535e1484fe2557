//! Resampling of a coarse grid on a fine one: interpolating bicubic, through an affine map between pixel centres.
//!
//! [`elunar_core::resample`] does the arithmetic. Catmull–Rom is our choice. It passes through the nodes. Against thin-plate splines its
//! error is 0.22 m rms, that of GDAL's approximating B-spline 1.43 m. Unlike the prefiltered spline (0.19 m) it is local, so a hole in the
//! coarse DTM changes only its neighbourhood.

use super::GeoTransform;
use elunar_core::resample::{EDGE_PX, Fraction, bicubic_at, continued};
use rayon::prelude::*;

/// Map from the centre of output pixel (row, col) to the source grid, in source pixels. (0, 0) is the *centre* of the first source pixel:
/// `source_row = row0 + row·row_per_row + col·row_per_col`, likewise for the column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelMap {
    /// Source row of output pixel (0, 0).
    pub row0: f64,
    /// Source rows per output row.
    pub row_per_row: f64,
    /// Source rows per output column.
    pub row_per_col: f64,
    /// Source column of output pixel (0, 0).
    pub col0: f64,
    /// Source columns per output row.
    pub col_per_row: f64,
    /// Source columns per output column.
    pub col_per_col: f64,
}

impl PixelMap {
    /// Returns the map between two rasters of one coordinate system; `None` if `source` cannot be inverted.
    pub fn between(output: &GeoTransform, source: &GeoTransform) -> Option<Self> {
        let det = source[1] * source[5] - source[2] * source[4];
        if !det.is_finite() || det == 0.0 {
            return None;
        }
        // From corner-based (col, row) on the output grid to map coordinates, then through the inverse of the source transform.
        let to_source = |col: f64, row: f64| {
            let dx = (output[0] - source[0]) + col * output[1] + row * output[2];
            let dy = (output[3] - source[3]) + col * output[4] + row * output[5];
            ((dx * source[5] - dy * source[2]) / det, (dy * source[1] - dx * source[4]) / det)
        };
        let (col0, row0) = to_source(0.5, 0.5);
        let (col_c, row_c) = to_source(1.5, 0.5);
        let (col_r, row_r) = to_source(0.5, 1.5);
        Some(Self {
            row0: row0 - 0.5,
            row_per_row: row_r - row0,
            row_per_col: row_c - row0,
            col0: col0 - 0.5,
            col_per_row: col_r - col0,
            col_per_col: col_c - col0,
        })
    }

    /// Returns the source position (row, col) of the centre of output pixel (`row`, `col`).
    pub fn apply(&self, row: f64, col: f64) -> (f64, f64) {
        (
            self.row0 + row * self.row_per_row + col * self.row_per_col,
            self.col0 + row * self.col_per_row + col * self.col_per_col,
        )
    }

    /// Returns the map for an output window whose first pixel is (`row`, `col`) of this map's output.
    pub fn window(&self, row: usize, col: usize) -> Self {
        let (row0, col0) = self.apply(row as f64, col as f64);
        Self { row0, col0, ..*self }
    }
}

/// Interpolates `source` (row-major `src_rows` × `src_cols`, NaN = invalid) at the `rows` × `cols` output pixels of `map`.
///
/// Beyond the outermost centres, up to the outer edge of the outermost pixels, the grid is extrapolated linearly from its last two samples.
/// Further out the result is NaN. If one of the sixteen samples is invalid, the four nearest are interpolated bilinearly. If one of these
/// is invalid too, and has weight, the result is NaN.
///
/// # Panics
/// If `source` does not hold `src_rows · src_cols` samples.
pub fn resample_bicubic(
    source: &[f32],
    src_rows: usize,
    src_cols: usize,
    map: &PixelMap,
    rows: usize,
    cols: usize,
) -> Vec<f32> {
    assert_eq!(source.len(), src_rows * src_cols, "samples of a {src_rows} x {src_cols} grid");
    let mut out = vec![f32::NAN; rows * cols];
    if source.is_empty() || out.is_empty() {
        return out;
    }
    let padded = Padded::new(source, src_rows, src_cols);
    out.par_chunks_mut(cols).enumerate().for_each(|(row, line)| {
        for (col, value) in line.iter_mut().enumerate() {
            let (r, c) = map.apply(row as f64, col as f64);
            *value = padded.sample(r, c);
        }
    });
    out
}

/// Number of extrapolated samples on each side of the source, so that the inner loop needs no edge cases.
const RING: usize = 2;

/// The source with [`RING`] linearly extrapolated samples on every side.
pub(super) struct Padded {
    samples: Vec<f32>,
    rows: usize,
    cols: usize,
    stride: usize,
}

impl Padded {
    pub(super) fn new(source: &[f32], rows: usize, cols: usize) -> Self {
        let stride = cols + 2 * RING;
        let mut samples = vec![0.0; (rows + 2 * RING) * stride];
        for row in 0..rows {
            let at = (row + RING) * stride + RING;
            samples[at..at + cols].copy_from_slice(&source[row * cols..(row + 1) * cols]);
            continue_line(&mut samples, at, cols, 1);
        }
        for col in 0..stride {
            continue_line(&mut samples, RING * stride + col, rows, stride);
        }
        Self { samples, rows, cols, stride }
    }

    /// Returns the value at source position (`r`, `c`); NaN outside the outer pixel edges.
    pub(super) fn sample(&self, r: f64, c: f64) -> f32 {
        let (row, col) = (Between::new(r, self.rows), Between::new(c, self.cols));
        row.zip(col).map_or(f32::NAN, |(row, col)| self.at(row, col))
    }

    /// Samples where each of `rows` crosses each of `cols`, as [`Self::sample`] does; `out` has a line for each row.
    pub(super) fn crossings(&self, rows: &[f64], cols: &[f64], out: &mut [f32]) {
        let cols: Vec<Option<Between>> = cols.iter().map(|&c| Between::new(c, self.cols)).collect();
        out.par_chunks_mut(cols.len().max(1)).zip(rows).for_each(|(line, &r)| {
            let row = Between::new(r, self.rows);
            for (value, &col) in line.iter_mut().zip(&cols) {
                *value = row.zip(col).map_or(f32::NAN, |(row, col)| self.at(row, col));
            }
        });
    }

    #[inline]
    fn at(&self, row: Between, col: Between) -> f32 {
        let first = row.first * self.stride + col.first;
        let around = std::array::from_fn(|k| {
            let line = &self.samples[first + k * self.stride..][..4];
            [line[0], line[1], line[2], line[3]]
        });
        bicubic_at(&around, row.fraction, col.fraction)
    }
}

/// A place between the samples of a row or a column.
#[derive(Clone, Copy)]
struct Between {
    /// The first of four samples, in the padded grid.
    first: usize,
    /// How far the place lies after the second.
    fraction: Fraction,
}

impl Between {
    /// Finds the place of a position; `None` beyond the outer edges of `count` samples.
    fn new(position: f64, count: usize) -> Option<Self> {
        let is_on = (-EDGE_PX..=count as f64 - 1.0 + EDGE_PX).contains(&position);
        let floor = position.floor();
        // The first sample is one before the floor. With the tolerance the floor may be -1, but not less.
        is_on.then(|| Self {
            first: (floor as isize - 1 + RING as isize) as usize,
            fraction: Fraction::new((position - floor) as f32),
        })
    }
}

/// Fills the [`RING`] samples before and after `len` samples that start at `at` and lie `step` apart.
fn continue_line(samples: &mut [f32], at: usize, len: usize, step: usize) {
    let inner = if len > 1 { step } else { 0 };
    let last = at + (len - 1) * step;
    for k in 1..=RING {
        samples[at - k * step] = continued(samples[at], samples[at + inner], k);
        samples[last + k * step] = continued(samples[last], samples[last - inner], k);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scale(factor: f64) -> PixelMap {
        // Output pixels are `factor` times finer than the source; both grids share their outer corner.
        let step = 1.0 / factor;
        let origin = 0.5 * step - 0.5;
        PixelMap {
            row0: origin,
            row_per_row: step,
            row_per_col: 0.0,
            col0: origin,
            col_per_row: 0.0,
            col_per_col: step,
        }
    }

    #[test]
    fn passes_through_the_nodes() {
        let source: Vec<f32> = (0..30).map(|k| ((k * 7919) % 101) as f32).collect();
        let out = resample_bicubic(&source, 5, 6, &scale(1.0), 5, 6);
        assert_eq!(out, source);
    }

    #[test]
    fn keeps_a_plane_up_to_the_outer_edge() {
        let source: Vec<f32> = (0..5 * 7).map(|k| 3.0 + 2.0 * (k / 7) as f32 - 0.5 * (k % 7) as f32).collect();
        let out = resample_bicubic(&source, 5, 7, &scale(30.0), 150, 210);
        for (k, value) in out.iter().enumerate() {
            let (r, c) = scale(30.0).apply((k / 210) as f64, (k % 210) as f64);
            assert!((f64::from(*value) - (3.0 + 2.0 * r - 0.5 * c)).abs() < 1e-5, "pixel {k}: {value}");
        }
    }

    #[test]
    fn matches_the_cubic_formula_written_out() {
        // Keys' kernel with a = -1/2, evaluated by distance.
        let keys = |x: f64| {
            let x = x.abs();
            if x < 1.0 {
                1.5 * x * x * x - 2.5 * x * x + 1.0
            } else if x < 2.0 {
                -0.5 * x * x * x + 2.5 * x * x - 4.0 * x + 2.0
            } else {
                0.0
            }
        };
        let source: Vec<f32> = (0..100).map(|k| ((k * k * 31 + 17 * k) % 97) as f32).collect();
        let map = PixelMap {
            row0: 3.1,
            row_per_row: 0.21,
            row_per_col: 0.11,
            col0: 3.7,
            col_per_row: -0.13,
            col_per_col: 0.17,
        };
        let out = resample_bicubic(&source, 10, 10, &map, 8, 9);
        for (k, value) in out.iter().enumerate() {
            let (r, c) = map.apply((k / 9) as f64, (k % 9) as f64);
            let mut expected = 0.0;
            for i in 0..10 {
                for j in 0..10 {
                    expected += f64::from(source[i * 10 + j]) * keys(r - i as f64) * keys(c - j as f64);
                }
            }
            assert!((f64::from(*value) - expected).abs() < 1e-3, "pixel {k}: {value} instead of {expected}");
        }
    }

    #[test]
    fn a_hole_spoils_only_its_own_neighbourhood() {
        let mut source = vec![1.0f32; 9 * 9];
        source[4 * 9 + 4] = f32::NAN;
        let out = resample_bicubic(&source, 9, 9, &scale(4.0), 36, 36);
        for (k, value) in out.iter().enumerate() {
            let (r, c) = scale(4.0).apply((k / 36) as f64, (k % 36) as f64);
            let near = (r - 4.0).abs() < 1.0 && (c - 4.0).abs() < 1.0;
            assert_eq!(value.is_nan(), near, "pixel {k} at ({r}, {c})");
        }
    }

    #[test]
    fn outside_is_invalid() {
        let out = resample_bicubic(&[1.0, 2.0, 3.0, 4.0], 2, 2, &PixelMap { row0: -2.0, ..scale(1.0) }, 5, 2);
        assert!(out[..4].iter().all(|v| v.is_nan()) && out[8..].iter().all(|v| v.is_nan() || v.is_finite()));
        assert_eq!(out[4..8], [1.0, 2.0, 3.0, 4.0]);
        assert!(resample_bicubic(&[], 0, 0, &scale(1.0), 1, 2).iter().all(|v| v.is_nan()));
        assert!(resample_bicubic(&[1.0], 1, 1, &scale(1.0), 0, 2).is_empty());
    }

    #[test]
    fn a_single_row_is_the_same_up_to_its_edges() {
        let out = resample_bicubic(&[1.0, 2.0, 3.0], 1, 3, &scale(2.0), 2, 6);
        assert_eq!(out, [0.75, 1.25, 1.75, 2.25, 2.75, 3.25].repeat(2));
    }

    #[test]
    fn maps_go_through_the_coordinates() {
        let image = [1000.0, 2.0, 0.0, -500.0, 0.0, -2.0];
        let coarse = [900.0, 59.0, 0.0, -300.0, 0.0, -59.0];
        let map = PixelMap::between(&image, &coarse).unwrap();
        let (row, col) = map.apply(10.0, 20.0);
        // Centre of image pixel (10, 20): x = 1041, y = -521.
        assert!((col - ((1041.0 - 900.0) / 59.0 - 0.5)).abs() < 1e-9);
        assert!((row - ((521.0 - 300.0) / 59.0 - 0.5)).abs() < 1e-9);
        assert_eq!(map.window(10, 20).apply(0.0, 0.0), (row, col));
        assert!(PixelMap::between(&image, &[0.0; 6]).is_none());
        assert!(PixelMap::between(&image, &[0.0, 1e200, 0.0, 0.0, 0.0, 1e200]).is_none());
    }
}
