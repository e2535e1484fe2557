//! The derivative of both terrain terms: 3 x 3 Sobel divided by 8, so that a ramp of 1 per pixel has derivative 1. The border is
//! replicated, so that a constant offset has derivative 0 (divisor and border: our choice).

use super::Pair;

/// Weights of ∂/∂x; ∂/∂y is the transpose.
const KERNEL: [[f64; 3]; 3] = [[-0.125, 0.0, 0.125], [-0.25, 0.0, 0.25], [-0.125, 0.0, 0.125]];

/// Derivatives at one pixel, per pixel step.
pub(super) struct Derivatives {
    pub(super) truth_x: f64,
    pub(super) truth_y: f64,
    pub(super) predicted_x: f64,
    pub(super) predicted_y: f64,
}

/// Returns row, column and derivatives of every pixel whose nine (replicated) neighbours are all valid.
pub(super) fn each<'p>(pair: &'p Pair<'_>) -> impl Iterator<Item = (usize, usize, Derivatives)> + 'p {
    (0..pair.truth.len()).filter_map(move |i| {
        let (row, col) = (i / pair.cols, i % pair.cols);
        let mut d = Derivatives { truth_x: 0.0, truth_y: 0.0, predicted_x: 0.0, predicted_y: 0.0 };
        for (index, kx, ky) in taps(pair, row, col) {
            if !pair.counts(index) {
                return None;
            }
            let (t, p) = (f64::from(pair.truth[index]), f64::from(pair.predicted[index]));
            d.truth_x += kx * t;
            d.truth_y += ky * t;
            d.predicted_x += kx * p;
            d.predicted_y += ky * p;
        }
        Some((row, col, d))
    })
}

/// Adds x · ∂(∂z*/∂x)/∂z* + y · ∂(∂z*/∂y)/∂z* of one pixel to `gradient`: the transpose of the stencil.
pub(super) fn scatter(pair: &Pair<'_>, (row, col): (usize, usize), x: f64, y: f64, gradient: &mut [f32]) {
    for (index, kx, ky) in taps(pair, row, col) {
        gradient[index] += (kx * x + ky * y) as f32;
    }
}

/// Returns (index, weight in x, weight in y) of the nine taps around a pixel.
fn taps(pair: &Pair<'_>, row: usize, col: usize) -> impl Iterator<Item = (usize, f64, f64)> {
    let (rows, cols) = (pair.rows, pair.cols);
    (0..9).map(move |k| {
        let (i, j) = (k / 3, k % 3);
        let near = |at: usize, offset: usize, end: usize| (at + offset).saturating_sub(1).min(end - 1);
        (near(row, i, rows) * cols + near(col, j, cols), KERNEL[i][j], KERNEL[j][i])
    })
}
