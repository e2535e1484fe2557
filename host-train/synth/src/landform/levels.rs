//! Forms along the contours of a random field: terraces and scarps, or ridges and rilles.

use super::{Canvas, smooth_step};
use rand::Rng;

/// Draws heights in pixels.
pub(super) fn draw(canvas: &mut Canvas) -> Vec<f32> {
    let wave_px = canvas.length(24.0, 200.0);
    let noise = canvas.noise(wave_px);
    // The field changes by about four in a wave.
    let per_px = 4.0 / wave_px;
    let (width_px, slope) = (canvas.length(1.5, 10.0), canvas.within(0.15, 0.7));
    let width = width_px * per_px;
    let tall = slope * width_px;
    if canvas.rng.random_bool(0.5) {
        let levels: Vec<f32> = (0..canvas.rng.random_range(1..=4)).map(|_| canvas.within(-1.2, 1.2)).collect();
        let height = |n: f32| levels.iter().map(|level| tall * smooth_step((n - level) / width)).sum();
        return noise.values().map(height).collect();
    }
    let tall = if canvas.rng.random() { tall } else { -tall };
    let mask = canvas.patches(0.5);
    noise.values().zip(mask).map(|(n, mask)| mask * tall * libm::expf(-(n / width).powi(2))).collect()
}
