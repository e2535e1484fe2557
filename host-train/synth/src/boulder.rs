//! Boulders around fresh craters. Weathering removes them with time.

use super::crater::Crater;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Poisson};
use std::f64::consts::TAU;

/// Craters older than this (κt/R²) have no boulders (our choice: boulders last tens to hundreds of millions of years).
const OLDEST_TAU: f64 = 0.01;
/// Smallest radius of craters with boulders, metres. Smaller craters do not reach below the regolith (our choice).
const SMALLEST_CRATER_M: f64 = 12.0;
/// Smallest boulder diameter, metres. The cumulative number falls with the cube of the diameter (our choice; published exponents: 3 to 5).
const SMALLEST_M: f64 = 1.0;
/// Number of boulders per metre of crater radius around the youngest craters (our choice, by visual comparison).
const PER_RADIUS_M: f64 = 1.0;

/// Adds boulders around `crater`, if it is fresh. `heights_m` is row-major, `cols` wide.
pub(super) fn strew(rng: &mut ChaCha8Rng, crater: &Crater, pixel_m: f64, heights_m: &mut [f32], cols: usize) {
    if crater.tau > OLDEST_TAU || crater.radius_m < SMALLEST_CRATER_M {
        return;
    }
    let expected = PER_RADIUS_M * crater.radius_m * (1.0 - crater.tau / OLDEST_TAU);
    let count = Poisson::new(expected).map_or(0, |poisson| poisson.sample(rng) as usize);
    let largest_m = crater.radius_m / 6.0;
    for _ in 0..count {
        let diameter_m = (SMALLEST_M * libm::pow(1.0 - rng.random::<f64>(), -1.0 / 3.0)).min(largest_m);
        // The density is greatest at the rim and falls to zero at three radii.
        let distance_px = (0.9 + 2.1 * rng.random::<f64>().powi(2)) * crater.radius_m / pixel_m;
        let (south, east) = libm::sincos(rng.random::<f64>() * TAU);
        drop_one(
            crater.row + south * distance_px,
            crater.col + east * distance_px,
            diameter_m,
            pixel_m,
            heights_m,
            cols,
        );
    }
}

/// Adds a rounded block, half as high as wide. A block smaller than a pixel keeps its volume, spread over the pixel.
fn drop_one(row: f64, col: f64, diameter_m: f64, pixel_m: f64, heights_m: &mut [f32], cols: usize) {
    let true_px = 0.5 * diameter_m / pixel_m;
    let radius_px = true_px.max(0.6);
    let height_m = 0.5 * diameter_m * (true_px / radius_px).powi(2);
    let rows = heights_m.len() / cols;
    let reach = 2.0 * radius_px;
    let clip =
        |from: f64, to: f64, n: usize| from.ceil().max(0.0) as usize..(to.floor() + 1.0).clamp(0.0, n as f64) as usize;
    for r in clip(row - reach, row + reach, rows) {
        for c in clip(col - reach, col + reach, cols) {
            let (dr, dc) = ((r as f64 - row) / radius_px, (c as f64 - col) / radius_px);
            heights_m[r * cols + c] += (height_m * libm::exp(-(dr * dr + dc * dc))) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn only_fresh_craters_have_boulders() {
        let crater = Crater { row: 50.0, col: 50.0, radius_m: 30.0, tau: 0.0, depth_ratio: 0.2, stretch: (1.0, 0.0) };
        let strewn = |crater: Crater| {
            let mut heights_m = vec![0.0f32; 100 * 100];
            strew(&mut ChaCha8Rng::seed_from_u64(1), &crater, 2.0, &mut heights_m, 100);
            heights_m.iter().copied().fold(0.0, f32::max)
        };
        assert!((0.3..5.0).contains(&strewn(crater)));
        assert_eq!(strewn(Crater { tau: 0.02, ..crater }), 0.0);
        assert_eq!(strewn(Crater { radius_m: 8.0, ..crater }), 0.0);
        assert_eq!(strewn(Crater { row: -500.0, ..crater }), 0.0);
    }
}
