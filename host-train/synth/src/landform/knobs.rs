//! Knobs, cones and domes of many sizes.

use super::Canvas;
use rand::Rng;

/// Smallest and largest radius, pixels.
const RADII_PX: (f64, f64) = (2.0, 40.0);

/// Draws heights in pixels.
pub(super) fn draw(canvas: &mut Canvas) -> Vec<f32> {
    let (rows, cols) = (canvas.rows, canvas.cols);
    let mut heights = vec![0.0f32; rows * cols];
    let largest = canvas.length(6.0, RADII_PX.1);
    // As many of each magnitude of area as cover this share of the ground.
    let cover = canvas.length(0.02, 0.4);
    let round = canvas.rng.random::<bool>();
    let steep = canvas.within(0.15, 0.7);
    let mut left = cover * (rows * cols) as f32;
    while left > 0.0 {
        let radius = canvas.length(RADII_PX.0, f64::from(largest));
        left -= std::f32::consts::PI * radius * radius;
        let (row, col) = (canvas.rng.random::<f32>() * rows as f32, canvas.rng.random::<f32>() * cols as f32);
        let tall = steep * (0.5 + 0.5 * canvas.rng.random::<f32>()) * radius;
        let reach = |at: f32, n: usize| (at - radius).max(0.0) as usize..((at + radius).ceil() as usize).min(n);
        for r in reach(row, rows) {
            for c in reach(col, cols) {
                let from = libm::hypotf(r as f32 - row, c as f32 - col) / radius;
                if from < 1.0 {
                    // The dome's greatest slope is 0.77 of its height over its radius.
                    let shape = if round { 1.3 * (1.0 - from * from).powi(2) } else { 1.0 - from };
                    heights[r * cols + c] = heights[r * cols + c].max(tall * shape * if round { 0.5 } else { 1.0 });
                }
            }
        }
    }
    heights
}
