//! Interpolation on a grid.

use super::Interpolation;
use crate::resample::Padded;
use rayon::prelude::*;

/// A piece of a grid, ready for interpolation. Positions are relative to the piece: (0, 0) is the centre of its first sample.
pub(super) enum Sampler {
    Bicubic(Padded),
    Bilinear(Piece),
    CubicSpline(Piece),
}

/// Samples, row by row.
pub(super) struct Piece {
    pub(super) samples: Vec<f32>,
    pub(super) rows: usize,
    pub(super) cols: usize,
    /// Positions this close to a sample count as on the sample.
    pub(super) snap_px: f64,
    /// How far beyond the outermost centres the outermost sample holds, pixels; bilinear interpolation only.
    pub(super) edge_px: f64,
}

impl Sampler {
    pub(super) fn new(piece: Piece, interpolation: Interpolation) -> Self {
        match interpolation {
            Interpolation::Bicubic => Self::Bicubic(Padded::new(&piece.samples, piece.rows, piece.cols)),
            Interpolation::Bilinear => Self::Bilinear(piece),
            Interpolation::CubicSpline => Self::CubicSpline(piece),
        }
    }

    pub(super) fn at(&self, r: f64, c: f64) -> f32 {
        match self {
            Self::Bicubic(padded) => padded.sample(r, c),
            Self::Bilinear(piece) => piece.bilinear(r, c),
            Self::CubicSpline(piece) => piece.cubic_spline(r, c),
        }
    }

    /// Interpolates where each of `rows` crosses each of `cols`; `out` has a line for each row.
    pub(super) fn crossings(&self, rows: &[f64], cols: &[f64], out: &mut [f32]) {
        if let Self::Bicubic(padded) = self {
            return padded.crossings(rows, cols, out);
        }
        out.par_chunks_mut(cols.len().max(1)).zip(rows).for_each(|(line, &r)| {
            line.iter_mut().zip(cols).for_each(|(value, &c)| *value = self.at(r, c));
        });
    }
}

impl Piece {
    /// Interpolates bilinearly. NaN outside the outermost pixel centres (except for rounding, and up to the edge if wanted), and where a sample with weight is invalid.
    fn bilinear(&self, r: f64, c: f64) -> f32 {
        // Positions on the grid take their sample exactly, so that a shift by whole pixels loses no edge to rounding.
        let snap = |v: f64| if (v - v.round()).abs() <= self.snap_px { v.round() } else { v };
        let within = |v: f64, count: usize| {
            let (v, last) = (snap(v), count as f64 - 1.0);
            (v >= -self.edge_px && v <= last + self.edge_px).then(|| v.clamp(0.0, last))
        };
        let (Some(r), Some(c)) = (within(r, self.rows), within(c, self.cols)) else { return f32::NAN };
        let (row, col) = (r.floor(), c.floor());
        let (fr, fc) = (r - row, c - col);
        let (row, col) = (row as usize, col as usize);
        let corners =
            [((1.0 - fr) * (1.0 - fc), 0, 0), ((1.0 - fr) * fc, 0, 1), (fr * (1.0 - fc), 1, 0), (fr * fc, 1, 1)];
        let used = corners.into_iter().filter(|&(weight, ..)| weight > 0.0);
        used.map(|(weight, dr, dc)| weight * f64::from(self.samples[(row + dr) * self.cols + col + dc])).sum::<f64>()
            as f32
    }

    /// Evaluates the cubic B-spline with the samples as coefficients, as GDAL's `cubicspline`. Samples that are missing or beyond the edge
    /// are left out, and the weights of the others are scaled up. NaN where the pixel that contains the position is missing.
    fn cubic_spline(&self, r: f64, c: f64) -> f32 {
        let nearest = |v: f64, count: usize| {
            let v = (v + 0.5).floor();
            (v >= 0.0 && v < count as f64).then_some(v as usize)
        };
        let (Some(row), Some(col)) = (nearest(r, self.rows), nearest(c, self.cols)) else { return f32::NAN };
        if !self.samples[row * self.cols + col].is_finite() {
            return f32::NAN;
        }
        let (wr, wc) = (b_spline(r - r.floor()), b_spline(c - c.floor()));
        let (mut sum, mut weights) = (0.0, 0.0);
        for (i, wr) in wr.iter().enumerate() {
            let Some(row) = nearest(r.floor() + i as f64 - 1.0, self.rows) else { continue };
            for (j, wc) in wc.iter().enumerate() {
                let Some(col) = nearest(c.floor() + j as f64 - 1.0, self.cols) else { continue };
                let value = f64::from(self.samples[row * self.cols + col]);
                if value.is_finite() {
                    sum += wr * wc * value;
                    weights += wr * wc;
                }
            }
        }
        (sum / weights) as f32
    }
}

/// Returns the weights of the four samples around a point at fraction `t` after the second. Their sum is one.
fn b_spline(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [(1.0 - t).powi(3) / 6.0, (3.0 * t3 - 6.0 * t2 + 4.0) / 6.0, (-3.0 * t3 + 3.0 * t2 + 3.0 * t + 1.0) / 6.0, t3 / 6.0]
}
