//! Dunes and ripples: warped waves with a gentle and a steep side.

use super::Canvas;
use std::f32::consts::TAU;

/// Draws heights in pixels.
pub(super) fn draw(canvas: &mut Canvas) -> Vec<f32> {
    let wave_px = canvas.length(7.0, 60.0);
    let (sin, cos) = libm::sincosf(canvas.within(0.0, f64::from(TAU)));
    // Share of the gentle side; slope of the steep one.
    let (gentle, steep) = (canvas.within(0.5, 0.85), canvas.within(0.1, 0.6));
    let tall = steep * (1.0 - gentle) * wave_px;
    let (warp, warp_px) = (canvas.within(0.1, 0.8), canvas.within(3.0, 8.0) * wave_px);
    let warps = canvas.noise(warp_px);
    let mask = canvas.patches(0.8);
    let height = |(pixel, mask): (usize, f32)| {
        let (row, col) = ((pixel / canvas.cols) as f32, (pixel % canvas.cols) as f32);
        let phase = ((row * sin + col * cos) / wave_px + warp * warps.at(pixel)).rem_euclid(1.0);
        mask * tall * if phase < gentle { phase / gentle } else { (1.0 - phase) / (1.0 - gentle) }
    };
    mask.into_iter().enumerate().map(height).collect()
}
