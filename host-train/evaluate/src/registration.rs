//! Horizontal offset of a candidate from the truth. It is measured and never applied.

use super::cross_spectrum::{CrossSpectrum, Wave, transform};
use elunar_core::terrain::PixelSize;
use rustfft::FftDirection;
use rustfft::num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Waves shorter than this many pixels do not count: interpolation onto the truth's grid lowers them (our choice).
const SHORTEST_PX: f64 = 4.0;
/// The offset is searched up to this share of either side.
const SEARCH: f64 = 0.125;
/// A Hann window along rows and columns makes this many neighbouring coefficients alike: (35/128)² / (9/64)⁴.
const ALIKE: f64 = 3.781;
/// Steps of Newton's method from the best whole pixel.
const STEPS: usize = 12;

/// Where a candidate lies, seen from the truth, by the waves that it resolves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Registration {
    /// Offset of the candidate down, pixels of the truth.
    pub down_px: f64,
    /// Offset to the right, pixels of the truth.
    pub right_px: f64,
    /// Offset down, metres.
    pub down_m: f64,
    /// Offset to the right, metres.
    pub right_m: f64,
    /// Standard deviation of the offset down, pixels, from the candidate's waves that are not the truth's.
    #[serde(default)]
    pub down_sd_px: f64,
    /// Standard deviation of the offset to the right, pixels.
    #[serde(default)]
    pub right_sd_px: f64,
    /// Correlation of the slope vectors of these waves at this offset, [-1, 1].
    pub correlation: f64,
}

/// Returns the offset at which the slope vectors of truth and candidate correlate best, to a fraction of a pixel: the maximum over d of
/// Σ k² Re(T* C exp(2πi k·d)) over all waves of 4 pixels and of `resolved_m` and more. Shorter waves that a candidate does not resolve, such as
/// the aliases of a coarse DTM, would only disturb. `None` without a maximum within an eighth of the sides.
pub(super) fn registration(spectrum: &CrossSpectrum, pixel: PixelSize, resolved_m: f64) -> Option<Registration> {
    let (rows, cols) = (spectrum.rows, spectrum.cols);
    let weight = |wave: &Wave| {
        let slope = (wave.frequency.0 / pixel.row_m).hypot(wave.frequency.1 / pixel.col_m);
        let counts = wave.frequency.0.hypot(wave.frequency.1) <= 1.0 / SHORTEST_PX && slope * resolved_m <= 1.0;
        if counts { slope * slope } else { 0.0 }
    };
    let mut surface = vec![Complex64::default()];
    surface.extend(spectrum.waves().map(|wave| wave.cross * weight(&wave)));
    transform(&mut surface, rows, cols, FftDirection::Inverse);
    let reach = [rows, cols].map(|n| (SEARCH * n as f64) as isize);
    let at = |row: isize, col: isize| {
        surface[row.rem_euclid(rows as isize) as usize * cols + col.rem_euclid(cols as isize) as usize].re
    };
    let all = (-reach[0]..=reach[0]).flat_map(|row| (-reach[1]..=reach[1]).map(move |col| (row, col)));
    let best = all.max_by(|a, b| at(a.0, a.1).total_cmp(&at(b.0, b.1)))?;
    if at(best.0, best.1) <= 0.0 || best.0.abs() == reach[0] || best.1.abs() == reach[1] {
        return None;
    }
    drop(surface);
    let (down_px, right_px) = refined(spectrum, &weight, (best.0 as f64, best.1 as f64));
    let (mut product, mut truth, mut candidate) = (0.0, 0.0, 0.0);
    for wave in spectrum.waves() {
        let w = weight(&wave);
        product += w * turned(&wave, (down_px, right_px)).re;
        truth += w * wave.truth;
        candidate += w * wave.candidate;
    }
    let [down_sd_px, right_sd_px] = deviations(spectrum, &weight, (down_px, right_px))?;
    Some(Registration {
        down_sd_px,
        right_sd_px,
        down_px,
        right_px,
        down_m: down_px * pixel.row_m,
        right_m: right_px * pixel.col_m,
        correlation: product / (truth * candidate).sqrt(),
    })
}

/// Returns the cross-spectrum's value after the candidate is moved back by `offset`, pixels.
fn turned(wave: &Wave, offset: (f64, f64)) -> Complex64 {
    wave.cross * Complex64::from_polar(1.0, TAU * (wave.frequency.0 * offset.0 + wave.frequency.1 * offset.1))
}

/// Returns the maximum near a whole pixel, by Newton's method; the whole pixel if that leads away from it.
fn refined(spectrum: &CrossSpectrum, weight: &dyn Fn(&Wave) -> f64, start: (f64, f64)) -> (f64, f64) {
    let (mut down, mut right) = start;
    for _ in 0..STEPS {
        let (mut gradient, mut curvature) = ([0.0; 2], [0.0; 3]);
        for (w, wave) in spectrum.waves().map(|wave| (weight(&wave), wave)).filter(|(w, _)| *w > 0.0) {
            let (k, l) = (TAU * wave.frequency.0, TAU * wave.frequency.1);
            let value = turned(&wave, (down, right)) * w;
            gradient[0] -= k * value.im;
            gradient[1] -= l * value.im;
            [k * k, k * l, l * l].iter().zip(&mut curvature).for_each(|(kl, c)| *c -= kl * value.re);
        }
        let [a, b, c] = curvature;
        let determinant = a * c - b * b;
        if !(a < 0.0 && determinant > 0.0) {
            return start;
        }
        let step =
            ((b * gradient[1] - c * gradient[0]) / determinant, (b * gradient[0] - a * gradient[1]) / determinant);
        (down, right) = (down + step.0, right + step.1);
        if !((down - start.0).abs() <= 1.0 && (right - start.1).abs() <= 1.0) {
            return start;
        }
        if step.0.hypot(step.1) < 1e-5 {
            break;
        }
    }
    (down, right)
}

/// Returns the standard deviations of an offset down and right, pixels; `None` if the waves do not determine it. The candidate, moved back, is
/// taken as g t + n: the truth t with a gain g for each octave, and a rest n. To first order, the rest moves the maximum of Σ w Re(t* z) by
/// Σ w k Im(t* n) / Σ w g k² |t|², with w the weights.
fn deviations(spectrum: &CrossSpectrum, weight: &dyn Fn(&Wave) -> f64, offset: (f64, f64)) -> Option<[f64; 2]> {
    let octave = |wave: &Wave| (-wave.frequency.0.hypot(wave.frequency.1).log2()).clamp(0.0, 31.0) as usize;
    let mut sums = [(0.0, 0.0); 32];
    for wave in spectrum.waves() {
        let sum = &mut sums[octave(&wave)];
        *sum = (sum.0 + turned(&wave, offset).re, sum.1 + wave.truth);
    }
    let gains = sums.map(|(cross, truth)| if truth > 0.0 { cross / truth } else { 0.0 });
    let (mut squares, mut curvatures) = ([0.0; 2], [0.0; 2]);
    for wave in spectrum.waves() {
        let (w, gain) = (weight(&wave), gains[octave(&wave)]);
        // |z - g t|², which rounding may take below 0.
        let cross = turned(&wave, offset).re;
        let rest = (wave.candidate + gain * (gain * wave.truth - 2.0 * cross)).max(0.0);
        for (axis, k) in [TAU * wave.frequency.0, TAU * wave.frequency.1].into_iter().enumerate() {
            // Both powers are sums over the blocks; the product of two blocks counts for nothing.
            squares[axis] += (w * k).powi(2) * wave.truth * rest / spectrum.blocks as f64;
            curvatures[axis] += w * gain * k * k * wave.truth;
        }
    }
    let found = [0, 1].map(|axis: usize| (ALIKE * squares[axis]).sqrt() / curvatures[axis]);
    found.iter().all(|sd| sd.is_finite() && *sd >= 0.0).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_raster::Raster;

    const PIXEL: PixelSize = PixelSize { row_m: 2.0, col_m: 3.0 };

    /// Hills with waves of 10 to 200 pixels, moved by (down, right) pixels.
    fn hills(down: f64, right: f64, scale: f64) -> Raster {
        let (rows, cols) = (160, 190);
        let waves: Vec<(f64, f64, f64)> = (1..40)
            .map(|k| {
                let (k, turn) = (f64::from(k), f64::from(k) * 2.4);
                let frequency = 0.005 + 0.0023 * k;
                (TAU * frequency * turn.cos(), TAU * frequency * turn.sin(), turn * 3.7)
            })
            .collect();
        let height = |r: f64, c: f64| {
            waves.iter().map(|(k, l, phase)| (k * r + l * c + phase).sin() * 0.1 / k.hypot(*l)).sum::<f64>()
        };
        let samples = (0..rows * cols)
            .map(|i| (scale * height((i / cols) as f64 - down, (i % cols) as f64 - right) - 1900.0) as f32);
        Raster { rows, cols, samples: samples.collect(), georef: None }
    }

    fn of(truth: &Raster, candidate: &Raster) -> Option<Registration> {
        registration(&CrossSpectrum::of(truth, candidate)?, PIXEL, 0.0)
    }

    #[test]
    fn a_known_offset_is_measured_to_a_fraction_of_a_pixel() {
        for (down, right) in [(0.0, 0.0), (0.3, -0.45), (-3.6, 7.2)] {
            let mut dtm = hills(down, right, 0.7);
            dtm.samples[70 * 190 + 20..][..12].fill(f32::NAN);
            let found = of(&hills(0.0, 0.0, 1.0), &dtm).unwrap();
            // The window stays in place and lets a part of the border in and out.
            let off = (found.down_px - down).hypot(found.right_px - right);
            assert!(off < 0.02 + 0.02 * down.hypot(right), "{down} {right}: {found:?}");
            assert_eq!((found.down_m, found.right_m), (2.0 * found.down_px, 3.0 * found.right_px));
            assert!(found.correlation > 0.9, "{found:?}");
        }
    }

    /// White noise moves the offset by as much as its standard deviation says.
    #[test]
    fn the_standard_deviation_is_that_of_offsets_under_noise() {
        use rand::{Rng, SeedableRng};
        let truth = hills(0.0, 0.0, 1.0);
        let (mut squares, mut variances) = ([0.0; 2], [0.0; 2]);
        for seed in 0..24 {
            let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let mut dtm = hills(0.3, -0.2, 0.8);
            dtm.samples.iter_mut().for_each(|z| *z += random.random_range(-1.5..1.5_f32));
            let found = of(&truth, &dtm).unwrap();
            let (errors, sds) = ([found.down_px - 0.3, found.right_px + 0.2], [found.down_sd_px, found.right_sd_px]);
            for axis in [0, 1] {
                squares[axis] += errors[axis].powi(2);
                variances[axis] += sds[axis].powi(2);
            }
        }
        for axis in [0, 1] {
            let (ratio, sd) = ((squares[axis] / variances[axis]).sqrt(), (variances[axis] / 24.0).sqrt());
            // 24 errors give their standard deviation to 15 %.
            assert!((0.6..1.6).contains(&ratio), "{ratio} of {sd}");
            assert!(sd > 0.01, "the noise moves the offset: {sd}");
        }
    }

    #[test]
    fn there_is_no_offset_beyond_the_search_or_of_a_plane() {
        let plane = Raster { samples: (0..160 * 190).map(|i| (i % 190) as f32).collect(), ..hills(0.0, 0.0, 1.0) };
        assert_eq!(of(&hills(0.0, 0.0, 1.0), &plane).filter(|found| found.correlation > 0.5), None);
        let away = of(&hills(0.0, 0.0, 1.0), &hills(90.0, 0.0, 1.0));
        assert!(away.is_none_or(|found| found.correlation < 0.7), "{away:?}");
    }
}
