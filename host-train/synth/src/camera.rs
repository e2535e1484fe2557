//! A camera like the LROC NAC. It converts radiance to DN.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Read noise, electrons (LROC NAC calibration: 71 and 74 for the two cameras).
const READ_NOISE_E: f32 = 72.0;
/// Full well, electrons (LROC NAC calibration: 248.5 and 262.5 thousand).
const FULL_WELL_E: f32 = 255_000.0;
/// Largest DN of the 12-bit converter.
const DN_MAX: f32 = 4095.0;
/// Standard deviation of the blur, pixels. A modulation transfer of 28 % at the Nyquist frequency is a Gaussian of 0.51 px. The upper end
/// includes our allowance for the resampling of an orthoimage.
pub(super) const BLUR_PX: (f64, f64) = (0.5, 0.7);
/// Mean signal, electrons, drawn log-uniformly: from a signal-to-noise ratio of about 49 (near the terminator) to 250.
const MEAN_SIGNAL_E: std::ops::Range<f32> = 5_000.0..80_000.0;

/// The exposure of one image.
pub(super) struct Exposure {
    blur_px: f32,
    mean_signal_e: f32,
}

impl Exposure {
    /// Draws blur, in pixels between these ends, and exposure.
    pub(super) fn draw(rng: &mut ChaCha8Rng, (low, high): (f64, f64)) -> Self {
        let (low, high) = (low as f32, high as f32);
        Self {
            blur_px: if low < high { rng.random_range(low..high) } else { low },
            mean_signal_e: libm::expf(rng.random_range(libm::logf(MEAN_SIGNAL_E.start)..libm::logf(MEAN_SIGNAL_E.end))),
        }
    }

    /// Takes the image: blur, exposure, shot and read noise, 12-bit quantisation. DN are integers from 0 to 4095.
    pub(super) fn take(&self, rng: &mut ChaCha8Rng, radiance: &[f32], rows: usize, cols: usize) -> Vec<f32> {
        let mut image = blur(radiance, rows, cols, self.blur_px);
        let mean = (image.iter().map(|v| f64::from(*v)).sum::<f64>() / image.len() as f64) as f32;
        let gain = self.mean_signal_e / mean.max(f32::MIN_POSITIVE);
        for value in &mut image {
            let signal = *value * gain;
            let noise: f32 = StandardNormal.sample(rng);
            let electrons = signal + noise * (signal + READ_NOISE_E * READ_NOISE_E).sqrt();
            *value = (electrons * (DN_MAX / FULL_WELL_E)).round().clamp(0.0, DN_MAX);
        }
        image
    }
}

/// Relation of DN to radiance. In a calibrated image DN are proportional to radiance; a picture for viewing is stretched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Response {
    /// Exponent of the DN as a power of the radiance.
    pub exponent: f32,
    /// Added to all DN, as a share of their mean: stray light, or a stretch that does not begin at black.
    pub pedestal: f32,
}

impl Response {
    /// Applies this response to a calibrated image, in DN. A pixel of the mean DN keeps its value, apart from the pedestal. DN are integers
    /// from 0 to 4095.
    pub(super) fn apply(&self, image: &mut [f32]) {
        if *self == (Self { exponent: 1.0, pedestal: 0.0 }) {
            return;
        }
        let mean = (image.iter().map(|v| f64::from(*v)).sum::<f64>() / image.len() as f64) as f32;
        if mean > 0.0 {
            for value in image {
                let share = libm::powf(*value / mean, self.exponent) + self.pedestal;
                *value = (share * mean).round().clamp(0.0, DN_MAX);
            }
        }
    }
}

/// Blurs with a Gaussian of five taps. Pixels at the edge repeat beyond it.
///
/// A Gaussian this narrow cannot be sampled directly: at 0.51 px, 55 % would pass at the Nyquist frequency. The taps are chosen so that
/// their response equals the Gaussian's at zero, half and full Nyquist frequency. The outer taps are slightly negative.
fn blur(image: &[f32], rows: usize, cols: usize, sigma_px: f32) -> Vec<f32> {
    // Response of a Gaussian at frequency f (cycles per pixel).
    let response = |f: f32| libm::expf(-2.0 * (std::f32::consts::PI * sigma_px * f).powi(2));
    let (full, half) = (response(0.5), response(0.25));
    let taps = [0.25 * (1.0 + full) + 0.5 * half, 0.25 * (1.0 - full), 0.125 * (1.0 + full) - 0.25 * half];
    let mut across = vec![0.0; image.len()];
    for (line, out) in image.chunks_exact(cols).zip(across.chunks_exact_mut(cols)) {
        for (col, value) in out.iter_mut().enumerate() {
            let at = |d: isize| line[(col as isize + d).clamp(0, cols as isize - 1) as usize];
            *value = taps[0] * at(0) + taps[1] * (at(-1) + at(1)) + taps[2] * (at(-2) + at(2));
        }
    }
    let mut out = vec![0.0; image.len()];
    for (row, line) in out.chunks_exact_mut(cols).enumerate() {
        let at = |d: isize| &across[(row as isize + d).clamp(0, rows as isize - 1) as usize * cols..][..cols];
        let sources = [at(0), at(-1), at(1), at(-2), at(2)];
        for (col, value) in line.iter_mut().enumerate() {
            *value = taps[0] * sources[0][col]
                + taps[1] * (sources[1][col] + sources[2][col])
                + taps[2] * (sources[3][col] + sources[4][col]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn noise_is_shot_noise_and_read_noise() {
        for mean_signal_e in [5_000.0, 80_000.0f32] {
            let exposure = Exposure { blur_px: 0.5, mean_signal_e };
            let image = exposure.take(&mut ChaCha8Rng::seed_from_u64(1), &vec![0.3; 200 * 200], 200, 200);
            let mean = image.iter().sum::<f32>() / 40_000.0;
            let deviation = (image.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / 40_000.0).sqrt();
            let per_dn = FULL_WELL_E / DN_MAX;
            let expected = ((mean_signal_e + READ_NOISE_E.powi(2)) / per_dn.powi(2) + 1.0 / 12.0).sqrt();
            assert!((mean * per_dn / mean_signal_e - 1.0).abs() < 0.01, "mean {mean} DN");
            assert!((deviation / expected - 1.0).abs() < 0.03, "{deviation} DN of noise, expected {expected}");
        }
    }

    #[test]
    fn a_response_bends_and_lifts() {
        let plain = vec![100.0, 200.0, 300.0, 400.0];
        let respond = |exponent, pedestal| {
            let mut image = plain.clone();
            Response { exponent, pedestal }.apply(&mut image);
            image
        };
        assert_eq!(respond(1.0, 0.0), plain);
        assert_eq!(respond(1.0, 0.2), [150.0, 250.0, 350.0, 450.0]);
        assert_eq!(respond(2.0, 0.0), [40.0, 160.0, 360.0, 640.0]);
        assert_eq!(respond(1.0, 20.0), [4095.0; 4], "saturated");
        let mut dark = vec![0.0; 4];
        Response { exponent: 0.5, pedestal: 0.1 }.apply(&mut dark);
        assert_eq!(dark, [0.0; 4]);
    }

    #[test]
    fn the_blur_has_the_modulation_of_the_camera() {
        // The finest pattern on a pixel grid: MTF 28 % at Nyquist for the sharpest blur.
        let stripes: Vec<f32> = (0..64 * 64).map(|k| if k % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let contrast = blur(&stripes, 64, 64, 0.51)[32 * 64 + 32];
        assert!((contrast - 0.28).abs() < 0.01, "{contrast}");
        assert!(blur(&[0.7; 64 * 64], 64, 64, 0.6).iter().all(|v| (v - 0.7).abs() < 1e-6));
    }
}
