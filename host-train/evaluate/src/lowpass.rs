//! Separates long and short waves of a map with voids. The coarse DTM has the long waves; only an image can add the short ones.

use elunar_raster::Raster;
use rayon::prelude::*;

/// Standard deviation of a Gaussian over the wavelength that it halves: exp(-2 π² σ² / λ²) = 1/2.
const SIGMA_PER_WAVELENGTH: f64 = 0.187_390_625_129_277_6; // √(ln 2 / 2) / π

/// The kernel ends at this many standard deviations. 0.3 % of its weight lies beyond.
const REACH_SIGMAS: f64 = 3.0;

/// For a short wave to count, at least this share of the kernel's weight must lie on valid samples ([`high_pass`]).
const LEAST_WEIGHT: f64 = 0.9;

/// A Gaussian low-pass. It halves the amplitude of waves of one wavelength.
#[derive(Debug, Clone, PartialEq)]
pub struct LowPass {
    /// Half kernels down and across. The first value is the centre.
    down: Vec<f64>,
    across: Vec<f64>,
}

impl LowPass {
    /// Returns the low-pass that halves waves of `wavelength_m`, for pixels of (row, column) metres.
    #[must_use]
    pub fn new(wavelength_m: f64, (row_m, col_m): (f64, f64)) -> Self {
        let kernel = |pixel_m: f64| {
            let sigma_px = SIGMA_PER_WAVELENGTH * wavelength_m / pixel_m;
            let reach = (REACH_SIGMAS * sigma_px).ceil() as usize;
            let tap = |k: usize| (-0.5 * (k as f64 / sigma_px).powi(2)).exp();
            let half: Vec<f64> = (0..=reach).map(|k| if k == 0 { 1.0 } else { tap(k) }).collect();
            let sum = half[0] + 2.0 * half[1..].iter().sum::<f64>();
            half.iter().map(|tap| tap / sum).collect()
        };
        Self { down: kernel(row_m), across: kernel(col_m) }
    }

    /// Returns the smoothed map and, for every pixel, the share of the kernel's weight on valid samples. The mean is taken over valid
    /// samples. Where a sample is not finite, the result is NaN.
    #[must_use]
    pub fn apply(&self, map: &Raster) -> (Vec<f32>, Vec<f64>) {
        let base = map.samples.iter().find(|v| v.is_finite()).copied().map_or(0.0, f64::from);
        self.smooth(&map.samples, (map.rows, map.cols), base)
    }

    /// Does what [`Self::apply`] does. Heights may be thousands of metres: sums of differences from `base` keep their precision.
    pub(super) fn smooth(&self, map: &[f32], (rows, cols): (usize, usize), base: f64) -> (Vec<f32>, Vec<f64>) {
        let valid: Vec<f64> = map.iter().map(|v| f64::from(u8::from(v.is_finite()))).collect();
        let value = |v: &f32| if v.is_finite() { f64::from(*v) - base } else { 0.0 };
        let values: Vec<f64> = map.iter().map(value).collect();
        let [sum, weight] =
            [values, valid].map(|field| down(&self.down, &across(&self.across, &field, cols), rows, cols));
        let smooth = |i: usize| if map[i].is_finite() { (base + sum[i] / weight[i]) as f32 } else { f32::NAN };
        ((0..map.len()).map(smooth).collect(), weight)
    }

    /// Returns how many rows and columns away a sample still counts.
    pub(super) fn reach(&self) -> (usize, usize) {
        (self.down.len() - 1, self.across.len() - 1)
    }
}

/// Returns the waves of `map` that are shorter than about `wavelength_m`: the map minus its [`LowPass`]. The result is NaN where the map is
/// NaN, and within about one standard deviation (a fifth of the wavelength) of edges and voids, where the low-pass is one-sided.
#[must_use]
pub fn high_pass(map: &Raster, wavelength_m: f64, pixel_m: (f64, f64)) -> Vec<f32> {
    let (smooth, weight) = LowPass::new(wavelength_m, pixel_m).apply(map);
    let short = |i: usize| if weight[i] >= LEAST_WEIGHT { map.samples[i] - smooth[i] } else { f32::NAN };
    (0..map.samples.len()).map(short).collect()
}

fn across(kernel: &[f64], field: &[f64], cols: usize) -> Vec<f64> {
    let mut out = vec![0.0; field.len()];
    field.par_chunks_exact(cols).zip(out.par_chunks_exact_mut(cols)).for_each(|(line, out)| {
        for (k, tap) in kernel.iter().enumerate().take(cols) {
            out[k..].iter_mut().zip(line).for_each(|(o, v)| *o += tap * v);
            if k > 0 {
                out.iter_mut().zip(&line[k..]).for_each(|(o, v)| *o += tap * v);
            }
        }
    });
    out
}

fn down(kernel: &[f64], field: &[f64], rows: usize, cols: usize) -> Vec<f64> {
    let mut out = vec![0.0; field.len()];
    out.par_chunks_exact_mut(cols).enumerate().for_each(|(row, out)| {
        for (k, tap) in kernel.iter().enumerate().take(rows) {
            let mut add = |from: usize| out.iter_mut().zip(&field[from * cols..]).for_each(|(o, v)| *o += tap * v);
            if row + k < rows {
                add(row + k);
            }
            if k > 0 && row >= k {
                add(row - k);
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(rows: usize, cols: usize, value: impl Fn(f64, f64) -> f64) -> Raster {
        let samples = (0..rows * cols).map(|i| value((i / cols) as f64, (i % cols) as f64) as f32).collect();
        Raster { rows, cols, samples, georef: None }
    }

    /// Returns the root mean square over the inner pixels.
    fn amplitude(samples: &[f32], rows: usize, cols: usize) -> f64 {
        let inner = (0..samples.len())
            .filter(|i| (rows / 4..3 * rows / 4).contains(&(i / cols)) && (40..cols - 40).contains(&(i % cols)));
        let squares: Vec<f64> = inner.map(|i| f64::from(samples[i]).powi(2)).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }

    #[test]
    fn waves_of_the_wavelength_are_halved_shorter_ones_pass_and_longer_ones_go() {
        let (rows, cols, pixel_m) = (120, 200, 2.0);
        for (wavelength_m, expected) in [(20.0, 0.998), (60.0, 0.5), (240.0, 0.042)] {
            for turned in [false, true] {
                let wave = |r: f64, c: f64| {
                    let at = if turned { r } else { c };
                    -1900.0 + (std::f64::consts::TAU * at * pixel_m / wavelength_m).sin()
                };
                let waves = map(rows, cols, wave);
                let level: Vec<f32> = waves.samples.iter().map(|v| v + 1900.0).collect();
                let short = high_pass(&waves, 60.0, (pixel_m, pixel_m));
                let passed = amplitude(&short, rows, cols) / amplitude(&level, rows, cols);
                assert!((passed - expected).abs() < 0.02, "{wavelength_m} m, turned {turned}: {passed}");
            }
        }
    }

    #[test]
    fn smoothing_is_the_weighted_mean_over_what_is_valid() {
        let (rows, cols) = (9, 11);
        let mut bumps = map(rows, cols, |r, c| (r * 1.7).sin() * 5.0 + (c * 0.9).cos() * 3.0 + 100.0);
        bumps.samples[4 * cols + 5] = f32::NAN;
        let filter = LowPass::new(12.0, (1.0, 2.0));
        let (smooth, weight) = filter.apply(&bumps);
        for i in 0..rows * cols {
            let tap = |kernel: &[f64], d: usize| kernel.get(d).copied().unwrap_or(0.0);
            let (mut sum, mut all) = (0.0, 0.0);
            for j in (0..rows * cols).filter(|j| bumps.samples[*j].is_finite()) {
                let w = tap(&filter.down, (i / cols).abs_diff(j / cols))
                    * tap(&filter.across, (i % cols).abs_diff(j % cols));
                sum += w * f64::from(bumps.samples[j]);
                all += w;
            }
            assert!((weight[i] - all).abs() < 1e-12);
            if bumps.samples[i].is_finite() {
                assert!((f64::from(smooth[i]) - sum / all).abs() < 1e-4, "{i}");
            }
        }
        assert!(smooth[4 * cols + 5].is_nan());
    }

    #[test]
    fn short_waves_beside_edges_and_voids_do_not_count() {
        let mut ramp = map(60, 60, |r, c| r + 2.0 * c);
        ramp.samples[30 * 60 + 30] = f32::NAN;
        let short = high_pass(&ramp, 40.0, (2.0, 2.0));
        assert!(short[0].is_nan() && short[30 * 60 + 1].is_nan() && short[30 * 60 + 30].is_nan());
        // Away from voids, a plane has no short waves. One missing sample does not drop its neighbours.
        assert!(short[20 * 60 + 20].abs() < 1e-3 && short[30 * 60 + 33].is_finite());
    }
}
