//! Random fields with a given spectrum, for the ground between the craters and its albedo.
//!
//! A field is a sum of plane waves with Gaussian coefficients, made by one inverse FFT. The FFT has no waves longer than its period, but
//! terrain has (regional slope). [`LongWaves`] adds waves of up to [`LONGEST_M`], with the variance of the same spectrum there.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlannerScalar};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Longest wave in any terrain, metres (our choice). Longer ones would only tilt a scene slightly more.
const LONGEST_M: f64 = 10_000.0;
/// Number of long waves per scene.
const LONG_WAVES: usize = 12;

/// An isotropic spectrum with two Hurst exponents. Height variance per e-fold of wavenumber falls as `k^(-2H)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spectrum {
    /// RMS height per e-fold of wavenumber at the corner wavelength, metres.
    pub corner_rms_m: f64,
    /// Wavelength at which the exponent changes, metres.
    pub corner_m: f64,
    /// Hurst exponent of waves longer than the corner.
    pub hurst_long: f64,
    /// Hurst exponent of waves shorter than the corner.
    pub hurst_short: f64,
}

impl Spectrum {
    /// Returns the height variance per e-fold of wavenumber (`k·P(k)`) at `k` radians per metre, m².
    fn variance_per_efold(&self, k: f64) -> f64 {
        let ratio = k * self.corner_m / TAU;
        let hurst = if ratio < 1.0 { self.hurst_long } else { self.hurst_short };
        self.corner_rms_m * self.corner_rms_m * libm::pow(ratio, -2.0 * hurst)
    }
}

/// FFT plans for one grid. [`FieldPlan::amplitudes`] computes amplitudes per spectrum.
pub(super) struct FieldPlan {
    rows: usize,
    cols: usize,
    pixel_m: f64,
    along_rows: Arc<dyn Fft<f32>>,
    along_cols: Arc<dyn Fft<f32>>,
}

/// Root-mean-square size of each wave of a [`FieldPlan`]'s grid, for one quarter of the plane. The rest is symmetric.
pub(super) struct Amplitudes(Vec<f32>);

impl FieldPlan {
    /// Makes a plan for fields of at least `rows` × `cols` pixels of `pixel_m` metres; see [`FieldPlan::shape`].
    pub(super) fn new(rows: usize, cols: usize, pixel_m: f64) -> Self {
        let (rows, cols) = (fft_size(rows), fft_size(cols));
        // The plans for AVX, SSE and NEON round differently: fields would depend on the processor.
        let mut planner = FftPlannerScalar::new();
        Self {
            rows,
            cols,
            pixel_m,
            along_rows: planner.plan_fft_inverse(rows),
            along_cols: planner.plan_fft_inverse(cols),
        }
    }

    /// Returns rows and columns of the fields. They are even, and at least the requested numbers.
    pub(super) fn shape(&self) -> (usize, usize) {
        (self.rows, self.cols)
    }

    /// Returns the wavenumber steps between neighbouring waves, radians per metre: rows, columns.
    fn step(&self) -> (f64, f64) {
        (TAU / (self.rows as f64 * self.pixel_m), TAU / (self.cols as f64 * self.pixel_m))
    }

    /// Returns the amplitudes that give fields of this plan the `spectrum`.
    pub(super) fn amplitudes(&self, spectrum: &Spectrum) -> Amplitudes {
        let (dr, dc) = self.step();
        let quarter = self.cols / 2 + 1;
        let mut amplitudes = vec![0.0; (self.rows / 2 + 1) * quarter];
        for (at, amplitude) in amplitudes.iter_mut().enumerate().skip(1) {
            let k = libm::hypot((at / quarter) as f64 * dr, (at % quarter) as f64 * dc);
            // k·P(k) is spread over the ring 2πk, per unit of k: the density per area of the wavenumber plane.
            *amplitude = (spectrum.variance_per_efold(k) / (TAU * k * k) * dr * dc).sqrt() as f32;
        }
        Amplitudes(amplitudes)
    }

    /// Draws two independent real fields with zero mean, row-major, one per spectrum. One complex FFT makes both: its real part is the
    /// first field, its imaginary part is the second.
    pub(super) fn draw(&self, rng: &mut ChaCha8Rng, first: &Amplitudes, second: &Amplitudes) -> (Vec<f32>, Vec<f32>) {
        let (rows, cols, quarter) = (self.rows, self.cols, self.cols / 2 + 1);
        // [cols, rows] in wavenumbers, so that one transposition ends in row-major pixels.
        let mut waves: Vec<Complex32> =
            (0..rows * cols).map(|_| Complex32::new(StandardNormal.sample(rng), StandardNormal.sample(rng))).collect();
        for c in 0..=cols / 2 {
            for r in 0..rows {
                let (at, mirror) = (c * rows + r, (cols - c) % cols * rows + (rows - r) % rows);
                if mirror < at && (c == 0 || c == cols / 2) {
                    continue; // On these two lines the mirror image lies on the same line and has already been set.
                }
                let (w, m) = (waves[at], waves[mirror]);
                let q = r.min(rows - r) * quarter + c;
                // Hermitian and anti-Hermitian halves of white noise are independent; |w|² averages 2, hence the ½.
                let (a, b) = (0.5 * first.0[q], 0.5 * second.0[q]);
                let (even, odd) = (w + m.conj(), w - m.conj());
                waves[at] = even * a + odd * b;
                waves[mirror] = even.conj() * a - odd.conj() * b;
            }
        }
        self.along_rows.process(&mut waves);
        let mut pixels = transpose(&waves, cols, rows);
        self.along_cols.process(&mut pixels);
        pixels.iter().map(|p| (p.re, p.im)).unzip()
    }

    /// Draws the waves that are longer than this plan's grid.
    pub(super) fn long_waves(&self, rng: &mut ChaCha8Rng, spectrum: &Spectrum) -> LongWaves {
        let (dr, dc) = self.step();
        // The lattice leaves out one cell of area dr·dc around zero: a disc of this radius.
        let longest = TAU / LONGEST_M;
        let efolds = libm::log((dr * dc / std::f64::consts::PI).sqrt() / longest).max(0.0);
        let waves = (0..LONG_WAVES).map(|n| {
            // Stratified over the e-folds, so that every scene has waves of every octave.
            let k = longest * libm::exp((n as f64 + rng.random::<f64>()) / LONG_WAVES as f64 * efolds);
            let (direction, phase) = (rng.random::<f64>() * TAU, rng.random::<f64>() * TAU);
            let size: f64 = StandardNormal.sample(rng);
            let rms = (spectrum.variance_per_efold(k) * efolds / LONG_WAVES as f64).sqrt();
            Wave {
                amplitude: size * rms * std::f64::consts::SQRT_2,
                per_row: k * libm::sin(direction) * self.pixel_m,
                per_col: k * libm::cos(direction) * self.pixel_m,
                phase,
            }
        });
        LongWaves(waves.collect())
    }
}

struct Wave {
    amplitude: f64,
    per_row: f64,
    per_col: f64,
    phase: f64,
}

/// Waves too long for the FFT.
pub(super) struct LongWaves(Vec<Wave>);

impl LongWaves {
    /// Adds `gain` times the waves to a row-major field of `cols` columns.
    pub(super) fn add_to(&self, field: &mut [f32], cols: usize, gain: f64) {
        for wave in &self.0 {
            let (cos, sin): (Vec<f32>, Vec<f32>) =
                (0..cols).map(|c| libm::sincos(wave.per_col * c as f64)).map(|(s, c)| (c as f32, s as f32)).unzip();
            for (row, line) in field.chunks_exact_mut(cols).enumerate() {
                let (s, c) = libm::sincos(wave.per_row * row as f64 + wave.phase);
                let (a, b) = ((gain * wave.amplitude * c) as f32, (gain * wave.amplitude * s) as f32);
                // cos(row part + column part) is expanded, so that the inner loop has no trigonometry.
                for ((value, cos), sin) in line.iter_mut().zip(&cos).zip(&sin) {
                    *value += a * cos - b * sin;
                }
            }
        }
    }
}

/// Returns the next even number with no prime factor above 5. FFTs of these sizes are fast.
fn fft_size(at_least: usize) -> usize {
    let smooth = |mut n: usize| {
        for factor in [2, 3, 5] {
            while n.is_multiple_of(factor) {
                n /= factor;
            }
        }
        n == 1
    };
    (at_least.max(2)..).find(|n| n.is_multiple_of(2) && smooth(*n)).unwrap_or(at_least)
}

/// Transposes `[rows, cols]` to `[cols, rows]`, in blocks that stay in the cache.
fn transpose(source: &[Complex32], rows: usize, cols: usize) -> Vec<Complex32> {
    const BLOCK: usize = 16;
    let mut out = vec![Complex32::default(); source.len()];
    for r0 in (0..rows).step_by(BLOCK) {
        for c0 in (0..cols).step_by(BLOCK) {
            for r in r0..(r0 + BLOCK).min(rows) {
                for c in c0..(c0 + BLOCK).min(cols) {
                    out[c * rows + r] = source[r * cols + c];
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    const SPECTRUM: Spectrum = Spectrum { corner_rms_m: 0.5, corner_m: 60.0, hurst_long: 0.6, hurst_short: 0.9 };

    #[test]
    fn fields_have_the_variance_of_their_spectrum_and_are_independent() {
        let plan = FieldPlan::new(60, 100, 2.0);
        assert_eq!(plan.shape(), (60, 100));
        let amplitudes = plan.amplitudes(&SPECTRUM);
        // Every wave of the plane by the definition: density k·P(k)/(2πk²) times the area of its cell.
        let mut expected = 0.0;
        for r in -29i32..=30 {
            for c in -49i32..=50 {
                let k = TAU * (f64::from(r) / 120.0).hypot(f64::from(c) / 200.0);
                if k > 0.0 {
                    expected += SPECTRUM.variance_per_efold(k) / (TAU * k * k) * TAU / 120.0 * TAU / 200.0;
                }
            }
        }
        let (mut first, mut second, mut both) = (0.0f64, 0.0f64, 0.0f64);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for _ in 0..200 {
            let (a, b) = plan.draw(&mut rng, &amplitudes, &amplitudes);
            let mean = |f: &mut dyn Iterator<Item = f32>| f.map(f64::from).sum::<f64>() / (200.0 * 6000.0);
            first += mean(&mut a.iter().map(|v| v * v));
            second += mean(&mut b.iter().map(|v| v * v));
            both += mean(&mut a.iter().zip(&b).map(|(a, b)| a * b));
        }
        for variance in [first, second] {
            assert!((variance / expected - 1.0).abs() < 0.1, "variance {variance}, expected {expected}");
        }
        assert!(both.abs() < 0.1 * expected, "covariance {both}");
    }

    #[test]
    fn long_waves_have_the_variance_that_the_grid_lacks() {
        let plan = FieldPlan::new(60, 100, 2.0);
        let (low, high) = (TAU / LONGEST_M, (TAU / 120.0 * TAU / 200.0 / std::f64::consts::PI).sqrt());
        // Integral of the spectrum over the logarithm of k, by the midpoint rule.
        let steps = 2000;
        let step = (high / low).ln() / f64::from(steps);
        let expected: f64 =
            (0..steps).map(|n| step * SPECTRUM.variance_per_efold(low * ((f64::from(n) + 0.5) * step).exp())).sum();
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut square = 0.0;
        for _ in 0..3000 {
            let mut field = vec![0.0f32; 4];
            plan.long_waves(&mut rng, &SPECTRUM).add_to(&mut field, 2, 1.0);
            square += f64::from(field[3]).powi(2) / 3000.0;
        }
        assert!((square / expected - 1.0).abs() < 0.15, "variance {square}, expected {expected}");
    }

    #[test]
    fn sizes_suit_the_fft() {
        assert_eq!([1, 2, 7, 97, 450, 511].map(fft_size), [2, 2, 8, 100, 450, 512]);
    }
}
