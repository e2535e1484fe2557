//! The standard deviation of a mean height: errors of neighbouring pixels are alike, so their mean errs more than that of independent ones.

use crate::cross_spectrum::transform;
use rustfft::FftDirection;
use rustfft::num_complex::Complex64;

/// Correlation length of the errors that the image leaves, in coarse pixels (our choice): longer waves are the coarse DTM's.
const IMAGE_CORRELATION_PX: f64 = 1.0;
/// Longest side of the map on which covariances are summed, in blocks of pixels (our choice): it bounds memory and time.
const SIDE: usize = 1024;

/// What is known of the errors of a DTM's heights.
#[derive(Debug, Clone, Copy)]
pub struct CorrelatedErrors {
    /// Size of a pixel, metres.
    pub pixel_m: f64,
    /// Size of a pixel of the coarse DTM, metres.
    pub coarse_pixel_m: f64,
    /// Standard deviation of the coarse DTM's own errors, metres.
    pub coarse_sigma_m: f64,
    /// Their correlation length, metres.
    pub coarse_correlation_m: f64,
}

impl CorrelatedErrors {
    /// Returns the standard deviation of the mean height over the pixels `inside`, metres; `None` if there are none. `sigma_m` has the standard
    /// deviation of each height, by rows of `cols` pixels, finite inside.
    ///
    /// The variance of a mean of n pixels is the sum of the covariances of all their pairs over n². Two pixels h metres apart have
    /// σ² exp(-h / length) of the coarse DTM's errors, and s₁ s₂ exp(-h / one coarse pixel) of the errors s that the image leaves: s² is `sigma_m`²
    /// without the coarse DTM's (the block variance of geostatistics: Journel and Huijbregts 1978; for DTMs Rolstad et al. 2009). Pairs are
    /// counted by their distance with the Fourier transform, so any shape will do. Sides beyond 1024 pixels are taken in blocks, whose pixels count
    /// as if they lay in one place.
    #[must_use]
    pub fn sigma_of_mean(&self, sigma_m: &[f32], inside: &[bool], cols: usize) -> Option<f64> {
        self.in_blocks(sigma_m, inside, cols, SIDE)
    }

    fn in_blocks(&self, sigma_m: &[f32], inside: &[bool], cols: usize, side: usize) -> Option<f64> {
        let all = || inside.iter().zip(sigma_m).enumerate().filter(|(_, (is_inside, _))| **is_inside);
        let places = || all().map(|(i, _)| (i / cols, i % cols));
        let (top, bottom) = (places().map(|(row, _)| row).min()?, places().map(|(row, _)| row).max()?);
        let (left, right) = (places().map(|(_, col)| col).min()?, places().map(|(_, col)| col).max()?);
        let block = (bottom - top).max(right - left) / side + 1;
        let shape = ((bottom - top) / block + 1, (right - left) / block + 1);
        let of_blocks = |weight: &dyn Fn(f64) -> f64| {
            let mut sums = Sums::new(shape, block as f64 * self.pixel_m);
            for ((row, col), (_, (_, sigma))) in places().zip(all()) {
                sums.add((row - top) / block, (col - left) / block, weight(f64::from(*sigma)));
            }
            sums
        };
        let image_sigma = |sigma: f64| (sigma * sigma - self.coarse_sigma_m.powi(2)).max(0.0).sqrt();
        let coarse = self.coarse_sigma_m.powi(2) * of_blocks(&|_| 1.0).pairs(self.coarse_correlation_m);
        let image = of_blocks(&image_sigma).pairs(IMAGE_CORRELATION_PX * self.coarse_pixel_m);
        Some((coarse + image).sqrt() / all().count() as f64)
    }
}

/// Sums of weights in blocks, with as much room to the right and below: shifts in a circle then meet no block twice.
struct Sums {
    map: Vec<Complex64>,
    rows: usize,
    cols: usize,
    block_m: f64,
}

impl Sums {
    fn new((rows, cols): (usize, usize), block_m: f64) -> Self {
        let (rows, cols) = (2 * rows, 2 * cols);
        Self { map: vec![Complex64::default(); rows * cols], rows, cols, block_m }
    }

    fn add(&mut self, row: usize, col: usize, weight: f64) {
        self.map[row * self.cols + col].re += weight;
    }

    /// Returns the sum over all pairs of the product of their weights and exp(-distance / length).
    fn pairs(mut self, length_m: f64) -> f64 {
        let Self { rows, cols, block_m, .. } = self;
        transform(&mut self.map, rows, cols, FftDirection::Forward);
        self.map.iter_mut().for_each(|wave| *wave = Complex64::from(wave.norm_sqr()));
        transform(&mut self.map, rows, cols, FftDirection::Inverse);
        let shift = |at: usize, n: usize| at.min(n - at) as f64;
        let near = |i: usize| (-block_m * shift(i / cols, rows).hypot(shift(i % cols, cols)) / length_m).exp();
        self.map.iter().enumerate().map(|(i, count)| count.re * near(i)).sum::<f64>() / (rows * cols) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ERRORS: CorrelatedErrors =
        CorrelatedErrors { pixel_m: 20.0, coarse_pixel_m: 60.0, coarse_sigma_m: 3.0, coarse_correlation_m: 500.0 };

    /// Returns a disc in a map of 90 columns.
    fn disc(rows: usize, (row, col): (f64, f64), radius: f64) -> Vec<bool> {
        let is_inside = |i: usize| ((i / 90) as f64 - row).hypot((i % 90) as f64 - col) <= radius;
        (0..rows * 90).map(is_inside).collect()
    }

    #[test]
    fn it_is_the_sum_over_all_pairs() {
        let sigma_m: Vec<f32> = (0..40 * 90).map(|i| 3.0 + (i * 37 % 11) as f32 * 0.2).collect();
        let inside = disc(40, (20.0, 50.0), 8.0);
        let places: Vec<usize> = (0..inside.len()).filter(|i| inside[*i]).collect();
        let image = |i: usize| f64::from(sigma_m[i]).mul_add(f64::from(sigma_m[i]), -9.0).sqrt();
        let pair = |a: usize, b: usize| {
            let apart = 20.0 * (a / 90).abs_diff(b / 90) as f64;
            let apart = apart.hypot(20.0 * (a % 90).abs_diff(b % 90) as f64);
            9.0 * (-apart / 500.0).exp() + image(a) * image(b) * (-apart / 60.0).exp()
        };
        let all: f64 = places.iter().flat_map(|a| places.iter().map(move |b| (*a, *b))).map(|(a, b)| pair(a, b)).sum();
        let expected = all.sqrt() / places.len() as f64;
        let found = ERRORS.sigma_of_mean(&sigma_m, &inside, 90).unwrap();
        assert!((found / expected - 1.0).abs() < 1e-10, "{found} {expected}");
        assert_eq!(ERRORS.sigma_of_mean(&sigma_m, &[false; 40 * 90], 90), None);
    }

    #[test]
    fn one_height_has_its_own_and_blocks_change_little() {
        let sigma_m = [3.2f32; 150 * 90];
        let one = ERRORS.sigma_of_mean(&sigma_m, &disc(150, (7.0, 9.0), 0.0), 90).unwrap();
        assert!((one - 3.2).abs() < 1e-6, "{one}");
        let inside = disc(150, (75.0, 45.0), 40.0);
        let [whole, blocks] = [SIDE, 30].map(|side| ERRORS.in_blocks(&sigma_m, &inside, 90, side).unwrap());
        // Blocks of 60 m against 60 m and 500 m over which errors are alike.
        assert!(whole != blocks && (blocks / whole - 1.0).abs() < 0.002, "{whole} {blocks}");
    }
}
