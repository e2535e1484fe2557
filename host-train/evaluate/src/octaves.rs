//! How well a candidate follows the truth, octave by octave of wavelength, and the wavelength down to which it does.

use super::cross_spectrum::CrossSpectrum;
use elunar_core::terrain::PixelSize;
use serde::{Deserialize, Serialize};

/// Waves of one octave: longer than 1/√2 and up to √2 of a wavelength.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Octave {
    /// Shortest wave, metres.
    pub shortest_m: f64,
    /// Longest wave, twice the shortest, metres.
    pub longest_m: f64,
    /// Fourier coefficients; a wave has two. Octaves of few coefficients are uncertain.
    pub coefficients: u64,
    /// Correlation of candidate and truth, [-1, 1].
    pub correlation: f64,
    /// Factor of the regression of the candidate on the truth: 1 if the truth's relief is there in full.
    pub gain: f64,
    /// Standard deviation of the candidate over the truth's.
    pub amplitude: f64,
}

impl Octave {
    /// Returns the geometric mean of shortest and longest wave, metres.
    #[must_use]
    pub fn centre_m(&self) -> f64 {
        (self.shortest_m * self.longest_m).sqrt()
    }

    /// Returns the squared correlation, 0 for a negative correlation.
    fn coherence(&self) -> f64 {
        self.correlation.max(0.0).powi(2)
    }
}

/// Shortest wavelength down to which the squared correlation of all octaves is 0.5 or more.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HalfCoherence {
    /// The wavelength, metres, interpolated between the centres of octaves, linearly in its logarithm.
    pub wavelength_m: f64,
    /// Whether no octave falls below 0.5. The wavelength is then the centre of the shortest octave, and the true one may be shorter.
    pub at_most: bool,
}

/// Returns the octaves of two maps, from short to long: from twice the wider side of a pixel up to the shorter side of the valid ground. An
/// octave in which a map has no waves has no correlation and is left out.
///
/// Maps that were smoothed to a resolution begin at half of it. A wave half as long is lowered to a sixteenth; the truth resolves none that is
/// shorter.
pub(super) fn octaves(spectrum: &CrossSpectrum, pixel: PixelSize, resolution_m: Option<f64>) -> Vec<Octave> {
    let shortest_m = (2.0 * pixel.row_m.max(pixel.col_m)).max(0.5 * resolution_m.unwrap_or(0.0));
    let scene_m = (spectrum.rows as f64 * pixel.row_m).min(spectrum.cols as f64 * pixel.col_m);
    let count = (scene_m / shortest_m).log2().floor().max(0.0) as usize;
    // Rounding of a wave that is exactly as long as two pixels.
    let short = |wavelength_m: f64| (wavelength_m / shortest_m * (1.0 + 1e-9)).log2();
    let mut sums = vec![(0_u64, 0.0, 0.0, 0.0); count];
    for wave in spectrum.waves() {
        let wavelength_m = 1.0 / (wave.frequency.0 / pixel.row_m).hypot(wave.frequency.1 / pixel.col_m);
        let octave = short(wavelength_m);
        if octave >= 0.0 && (octave as usize) < count {
            let (n, truth, candidate, cross) = &mut sums[octave as usize];
            *n += spectrum.blocks;
            *truth += wave.truth;
            *candidate += wave.candidate;
            *cross += wave.cross.re;
        }
    }
    let octave = |(k, (coefficients, truth, candidate, cross)): (usize, (u64, f64, f64, f64))| {
        let shortest_m = shortest_m * 2.0_f64.powi(k as i32);
        (truth > 0.0 && candidate > 0.0).then(|| Octave {
            shortest_m,
            longest_m: 2.0 * shortest_m,
            coefficients,
            correlation: cross / (truth * candidate).sqrt(),
            gain: cross / truth,
            amplitude: (candidate / truth).sqrt(),
        })
    };
    sums.into_iter().enumerate().filter_map(octave).collect()
}

/// Returns the half-coherence wavelength of octaves from short to long; `None` if the longest is already below 0.5, or there is none.
#[must_use]
pub fn half_coherence(octaves: &[Octave]) -> Option<HalfCoherence> {
    let mut longer = octaves.last().filter(|longest| longest.coherence() >= 0.5)?;
    for octave in octaves.iter().rev().skip(1) {
        if octave.coherence() < 0.5 {
            let (above, below) = (longer.coherence(), octave.coherence());
            let share = (above - 0.5) / (above - below);
            let (long, short) = (longer.centre_m().ln(), octave.centre_m().ln());
            return Some(HalfCoherence { wavelength_m: (long + share * (short - long)).exp(), at_most: false });
        }
        longer = octave;
    }
    Some(HalfCoherence { wavelength_m: longer.centre_m(), at_most: true })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lowpass::LowPass;
    use elunar_raster::Raster;
    use rand::{Rng, SeedableRng};

    const ROWS: usize = 200;
    const COLS: usize = 260;
    const PIXEL: PixelSize = PixelSize { row_m: 2.0, col_m: 2.0 };

    fn noise(seed: u64) -> Raster {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let samples = (0..ROWS * COLS).map(|_| 4.0 * (random.random::<f32>() - 0.5)).collect();
        Raster { rows: ROWS, cols: COLS, samples, georef: None }
    }

    /// White noise, with a void in the middle.
    fn truth() -> Raster {
        let mut map = noise(1);
        (0..9).for_each(|row| map.samples[(90 + row) * COLS + 100..][..14].fill(f32::NAN));
        map
    }

    fn combined(a: &Raster, b: &Raster, f: impl Fn(f32, f32) -> f32) -> Raster {
        Raster { samples: a.samples.iter().zip(&b.samples).map(|(a, b)| f(*a, *b)).collect(), ..a.clone() }
    }

    fn of(truth: &Raster, candidate: &Raster) -> Vec<Octave> {
        octaves(&CrossSpectrum::of(truth, candidate).unwrap(), PIXEL, None)
    }

    #[test]
    fn the_truth_itself_has_correlation_and_gain_one() {
        let found = of(&truth(), &truth());
        assert_eq!(found.iter().map(|o| o.shortest_m).collect::<Vec<_>>(), [4.0, 8.0, 16.0, 32.0, 64.0, 128.0]);
        assert!(found[0].coefficients > 20_000 && found[5].coefficients > 20, "{found:?}");
        for octave in &found {
            for figure in [octave.correlation, octave.gain, octave.amplitude] {
                assert!((figure - 1.0).abs() < 1e-9, "{octave:?}");
            }
        }
        let half = half_coherence(&found).unwrap();
        assert!(half.at_most && (half.wavelength_m - 32.0_f64.sqrt()).abs() < 1e-9);
    }

    /// Half of what the truth has beyond a coarse DTM: gain 1 where the coarse DTM has all, 1/2 where it has nothing.
    #[test]
    fn half_the_relief_about_the_coarse_dtm_has_half_the_gain() {
        let truth = truth();
        let coarse = Raster { samples: LowPass::new(64.0, (2.0, 2.0)).apply(&truth).0, ..truth.clone() };
        let half = combined(&truth, &coarse, |t, c| c + 0.5 * (t - c));
        let (of_half, of_coarse) = (of(&truth, &half), of(&truth, &coarse));
        let (short, long) = (of_half[0], of_half[5]);
        assert!((short.gain - 0.5).abs() < 1e-3 && (short.amplitude - 0.5).abs() < 1e-3, "{short:?}");
        assert!(short.correlation > 0.999 && (long.gain - 1.0).abs() < 0.1, "{short:?} {long:?}");
        for (half, coarse) in of_half.iter().zip(&of_coarse) {
            // The gain is linear in the candidate.
            assert!((half.gain - 0.5 * (1.0 + coarse.gain)).abs() < 1e-6, "{half:?} {coarse:?}");
        }
    }

    #[test]
    fn unrelated_noise_has_no_correlation() {
        let found = of(&truth(), &noise(2));
        for octave in &found {
            // The window makes about four coefficients one independent value.
            let limit = 4.0 * (4.0 / octave.coefficients as f64).sqrt();
            assert!(octave.correlation.abs() < limit && (octave.amplitude - 1.0).abs() < limit, "{octave:?}");
        }
        assert!(found[0].correlation.abs() < 0.03 && half_coherence(&found).is_none(), "{found:?}");
    }

    /// Truth plus noise of the short waves, equally strong: the squared correlation is 0.5 there and nearly 1 at long waves.
    #[test]
    fn half_coherence_lies_where_noise_sets_in() {
        let (truth, other) = (truth(), noise(3));
        let long = Raster { samples: LowPass::new(24.0, (2.0, 2.0)).apply(&other).0, ..other.clone() };
        let noisy = |factor: f32| {
            let short = combined(&other, &long, |n, l| factor * (n - l));
            half_coherence(&of(&truth, &combined(&truth, &short, |t, n| t + n))).unwrap()
        };
        // The high-pass keeps 1 - 2^-(24 m / λ)² of a wave. Three times this is 1, and the squared correlation 1 / (1 + 1), at 31.4 m.
        let found = noisy(3.0);
        assert!(!found.at_most && (found.wavelength_m / 31.4).log2().abs() < 0.3, "{found:?}");
        assert!(noisy(0.5).at_most);
    }

    /// Hills in common, short waves unrelated, both smoothed to 60 m.
    #[test]
    fn smoothed_maps_begin_at_half_their_resolution() {
        let hill = |i: usize| 60.0 * ((i / COLS) as f32 * 0.02).sin() + 40.0 * ((i % COLS) as f32 * 0.017).cos();
        let smooth = LowPass::new(60.0, (2.0, 2.0));
        let [a, b] = [1, 4].map(|seed| {
            let rough = noise(seed);
            let samples = rough.samples.iter().enumerate().map(|(i, v)| 20.0 * v + hill(i)).collect();
            Raster { samples: smooth.apply(&Raster { samples, ..rough.clone() }).0, ..rough }
        });
        let found = octaves(&CrossSpectrum::of(&a, &b).unwrap(), PIXEL, Some(60.0));
        assert_eq!(found.iter().map(|o| o.shortest_m).collect::<Vec<_>>(), [30.0, 60.0, 120.0]);
        assert!(found[0].correlation.abs() < 0.4 && found[2].correlation > 0.7, "{found:?}");
        assert_eq!(octaves(&CrossSpectrum::of(&a, &b).unwrap(), PIXEL, Some(1.0))[0].shortest_m, 4.0);
    }

    #[test]
    fn half_coherence_is_interpolated_in_the_logarithm() {
        let octave = |k: i32, correlation: f64| Octave {
            shortest_m: 2.0_f64.powi(k),
            longest_m: 2.0_f64.powi(k + 1),
            coefficients: 9,
            correlation,
            gain: 1.0,
            amplitude: 1.0,
        };
        // Squared correlations 0.9, 0.3, 0.7, 0.9: the first fall, seen from long waves, is from 0.7 to 0.3, half-way.
        let found =
            [0.9_f64, 0.3, 0.7, 0.9].iter().enumerate().map(|(k, r)| octave(k as i32, r.sqrt())).collect::<Vec<_>>();
        let half = half_coherence(&found).unwrap();
        assert!((half.wavelength_m - 4.0).abs() < 1e-9 && !half.at_most, "{half:?}");
        assert_eq!(half_coherence(&[octave(0, 0.9), octave(1, -0.9)]), None);
        assert_eq!(half_coherence(&[]), None);
    }
}
