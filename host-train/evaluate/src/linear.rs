//! The best linear filter from an image's contrast and a coarse DTM to the truth, as scenes with a truth teach it.
//!
//! Every wave of the truth minus the coarse DTM is taken as a · (wave of the contrast) + b · (wave of the coarse DTM). The complex gains a and
//! b are least squares over many scenes and over neighbouring waves.

use super::cross_spectrum::{transform, window};
use super::fill::fill;
use elunar_base::{Error, Result};
use rayon::prelude::*;
use rustfft::FftDirection;
use rustfft::num_complex::Complex64;
use std::f64::consts::PI;

/// Sums are taken over waves whose frequencies down and across differ by no more than this share of the wave's frequency, and over the nearest
/// waves at least: few scenes do not tell the gains of a single wave, and gains change slowly (our choice).
const NEIGHBOURS: f64 = 0.2;
/// Contrast and coarse DTM whose waves agree this far (1 minus their squared coherence) are one: the coarse DTM is then left out.
const INDEPENDENT: f64 = 1e-9;
/// A map is extended at its edges by this many coarse pixels before it is filtered, and falls to its mean there.
const MARGIN_COARSE_PX: f32 = 4.0;

/// Three maps of one ground, row-major, of one size.
#[derive(Debug, Clone)]
pub struct Lesson {
    /// Brightness over its mean, minus 1 ([`contrast`]).
    pub contrast: Vec<f64>,
    /// Coarse DTM on the image's grid, pixels.
    pub coarse: Vec<f64>,
    /// True DTM, pixels.
    pub truth: Vec<f64>,
}

/// Returns brightness over its mean, minus 1. Voids are filled smoothly.
#[must_use]
pub fn contrast(image: &[f32], (rows, cols): (usize, usize)) -> Vec<f64> {
    let valid = || image.iter().filter(|v| v.is_finite()).map(|v| f64::from(*v));
    let mean = valid().sum::<f64>() / valid().count().max(1) as f64;
    let mut map: Vec<f64> = image.iter().map(|v| f64::from(*v) / mean - 1.0).collect();
    fill(&mut map, rows, cols);
    map
}

/// Returns heights in pixels of `pixel_m` metres. Voids are filled smoothly.
#[must_use]
pub fn in_pixels(heights_m: &[f32], pixel_m: f64, (rows, cols): (usize, usize)) -> Vec<f64> {
    let mut map: Vec<f64> = heights_m.iter().map(|z| f64::from(*z) / pixel_m).collect();
    fill(&mut map, rows, cols);
    map
}

/// Powers and cross powers of contrast (k), coarse DTM (c) and truth minus coarse DTM (d) in one wave.
#[derive(Debug, Clone, Copy, Default)]
struct Powers {
    kk: f64,
    cc: f64,
    kc: Complex64,
    kd: Complex64,
    cd: Complex64,
}

impl Powers {
    /// Adds `weight` times other powers.
    fn add(&mut self, other: &Self, weight: f64) {
        self.kk += weight * other.kk;
        self.cc += weight * other.cc;
        self.kc += other.kc * weight;
        self.kd += other.kd * weight;
        self.cd += other.cd * weight;
    }

    /// Returns the gains of contrast and coarse DTM that estimate the rest with least error.
    fn gains(&self, with_coarse: bool) -> [Complex64; 2] {
        let determinant = self.kk * self.cc - self.kc.norm_sqr();
        if with_coarse && determinant > INDEPENDENT * self.kk * self.cc {
            let contrast = (self.kd * self.cc - self.kc * self.cd) / determinant;
            let coarse = (self.cd * self.kk - self.kc.conj() * self.kd) / determinant;
            return [contrast, coarse];
        }
        let contrast = if self.kk > 0.0 { self.kd / self.kk } else { Complex64::default() };
        [contrast, Complex64::default()]
    }
}

/// A pair of gains for every wave of a grid.
#[derive(Debug, Clone)]
pub struct LinearFilter {
    rows: usize,
    cols: usize,
    coarse_px: f32,
    gains: Vec<[Complex64; 2]>,
}

impl LinearFilter {
    /// Finds the gains over `count` lessons of `rows` x `cols` pixels. `coarse_px` is the side of a coarse pixel, in pixels. The coarse DTM
    /// counts in waves longer than that; interpolation alone made its shorter ones.
    ///
    /// # Errors
    /// Errors of `lesson`, the first in order; [`Error::Input`] if a map has another size.
    pub fn fit(
        (rows, cols): (usize, usize),
        coarse_px: f32,
        count: usize,
        lesson: impl Fn(usize) -> Result<Lesson> + Sync,
    ) -> Result<Self> {
        let one = |index: usize| -> Result<Vec<Powers>> {
            let Lesson { contrast, coarse, truth } = lesson(index)?;
            let lengths = [contrast.len(), coarse.len(), truth.len()];
            if lengths != [rows * cols; 3] {
                let what = format!("expected maps of {rows} x {cols} pixels, found {lengths:?} pixels");
                return Err(Error::input(format!("linear filter: {what}")));
            }
            let rest = truth.iter().zip(&coarse).map(|(z, c)| z - c).collect();
            let [k, c, d] = [contrast, coarse, rest].map(|map: Vec<f64>| spectrum(map, rows, cols));
            let powers = |((k, c), d): ((&Complex64, &Complex64), &Complex64)| Powers {
                kk: k.norm_sqr(),
                cc: c.norm_sqr(),
                kc: k.conj() * c,
                kd: k.conj() * d,
                cd: c.conj() * d,
            };
            // Every lesson counts alike. Otherwise the roughest ground, where brightness is least linear, would decide.
            let power: f64 = d.iter().map(|z| z.norm_sqr()).sum();
            let weighed = |found: Powers| {
                let mut powers = Powers::default();
                powers.add(&found, if power > 0.0 { 1.0 / power } else { 0.0 });
                powers
            };
            Ok(k.iter().zip(&c).zip(&d).map(powers).map(weighed).collect())
        };
        let mut sums = vec![Powers::default(); rows * cols];
        // Added in the order of the lessons, so that threads do not change the sums.
        let together = rayon::current_num_threads();
        for first in (0..count).step_by(together) {
            let made: Vec<_> = (first..count.min(first + together)).into_par_iter().map(one).collect();
            for powers in made {
                sums.iter_mut().zip(&powers?).for_each(|(sum, more)| sum.add(more, 1.0));
            }
        }
        let areas = Areas::of(&sums, (rows, cols));
        let gains = (0..rows * cols).map(|i| {
            let frequency = signed(i / cols, rows).hypot(signed(i % cols, cols));
            areas.around(i).gains(frequency * f64::from(coarse_px) <= 1.0)
        });
        let gains = gains.collect();
        Ok(Self { rows, cols, coarse_px, gains })
    }

    /// Returns the heights, pixels, of a map of any size: its coarse DTM plus the filtered contrast and coarse DTM.
    #[must_use]
    pub fn apply(&self, contrast: &[f64], coarse: &[f64], (rows, cols): (usize, usize)) -> Vec<f64> {
        let margin = ((MARGIN_COARSE_PX * self.coarse_px).ceil() as usize).min(rows.min(cols).saturating_sub(1));
        let (high, wide) = (rows + 2 * margin, cols + 2 * margin);
        let waves = |map: &[f64], odd: bool| {
            let mean = map.iter().sum::<f64>() / map.len().max(1) as f64;
            let centred: Vec<f64> = map.iter().map(|v| v - mean).collect();
            // Along the columns, then along the rows of what that gives, turned.
            let once = turned(&extended(&centred, cols, margin, odd), wide);
            let both = turned(&extended(&once, rows, margin, odd), high);
            let mut packed = both.into_iter().map(|re| Complex64::new(re, 0.0)).collect();
            transform(&mut packed, high, wide, FftDirection::Forward);
            packed
        };
        let (k, mut c): (Vec<Complex64>, Vec<Complex64>) = (waves(contrast, false), waves(coarse, true));
        c.par_iter_mut().enumerate().for_each(|(i, c)| {
            let frequency = [signed(i / wide, high), signed(i % wide, wide)];
            let [of_contrast, of_coarse] = self.gains_at(frequency);
            // Full for waves of two coarse pixels, 0 for waves of one: an end at once would ring.
            let share = 2.0 - 2.0 * frequency[0].hypot(frequency[1]) * f64::from(self.coarse_px);
            *c = of_contrast * k[i] + of_coarse * *c * share.clamp(0.0, 1.0);
        });
        transform(&mut c, high, wide, FftDirection::Inverse);
        let share = 1.0 / (high * wide) as f64;
        let rest = |i: usize| c[(margin + i / cols) * wide + margin + i % cols].re * share;
        coarse.iter().enumerate().map(|(i, z)| z + rest(i)).collect()
    }

    /// Returns the gains at a frequency in cycles per pixel down and across, interpolated between the waves of the lessons.
    fn gains_at(&self, [down, across]: [f64; 2]) -> [Complex64; 2] {
        let (row, col) = (down * self.rows as f64, across * self.cols as f64);
        let (top, left) = (row.floor(), col.floor());
        let (below, right) = (row - top, col - left);
        let at = |row: f64, col: f64| {
            let row = (row as isize).rem_euclid(self.rows as isize) as usize;
            self.gains[row * self.cols + (col as isize).rem_euclid(self.cols as isize) as usize]
        };
        let corners = [
            (at(top, left), (1.0 - below) * (1.0 - right)),
            (at(top, left + 1.0), (1.0 - below) * right),
            (at(top + 1.0, left), below * (1.0 - right)),
            (at(top + 1.0, left + 1.0), below * right),
        ];
        std::array::from_fn(|which| corners.iter().map(|(gains, weight)| gains[which] * *weight).sum())
    }
}

/// Returns rows of `cols` values, extended by `margin` values at both ends, which fall to 0. They mirror the values at the end; with `odd`,
/// through its value, so that slopes go on.
fn extended(map: &[f64], cols: usize, margin: usize, odd: bool) -> Vec<f64> {
    let mut out = Vec::with_capacity(map.len() / cols.max(1) * (cols + 2 * margin));
    for row in map.chunks_exact(cols.max(1)) {
        let beyond = |end: usize, step: usize, inner: usize| {
            let fall = 0.5 + 0.5 * (PI * step as f64 / (margin + 1) as f64).cos();
            fall * if odd { 2.0 * row[end] - row[inner] } else { row[inner] }
        };
        out.extend((1..=margin).rev().map(|step| beyond(0, step, step)));
        out.extend_from_slice(row);
        out.extend((1..=margin).map(|step| beyond(cols - 1, step, cols - 1 - step)));
    }
    out
}

/// Returns the map with rows and columns exchanged.
fn turned(map: &[f64], cols: usize) -> Vec<f64> {
    let rows = map.len() / cols.max(1);
    (0..map.len()).map(|i| map[i % rows * cols + i / rows]).collect()
}

/// Returns the frequency of a coefficient of a transform over `n` pixels, cycles per pixel, [-1/2, 1/2].
fn signed(at: usize, n: usize) -> f64 {
    (if 2 * at > n { at as f64 - n as f64 } else { at as f64 }) / n as f64
}

/// Returns the Fourier coefficients of a map without its plane, lowered to 0 at the edges by a Hann window.
fn spectrum(mut map: Vec<f64>, rows: usize, cols: usize) -> Vec<Complex64> {
    window(&mut map, rows, cols);
    let mut packed = map.into_iter().map(|re| Complex64 { re, im: 0.0 }).collect();
    transform(&mut packed, rows, cols, FftDirection::Forward);
    packed
}

/// Sums over rectangles of waves.
struct Areas {
    rows: usize,
    cols: usize,
    /// Sums over all waves of lower frequency down and across, in order of frequency; one more row and column than waves.
    sums: Vec<Powers>,
}

impl Areas {
    /// Sums the powers of every wave, which are in the order of a transform.
    fn of(powers: &[Powers], (rows, cols): (usize, usize)) -> Self {
        let wide = cols + 1;
        let mut sums = vec![Powers::default(); (rows + 1) * wide];
        for row in 0..rows {
            let mut along = Powers::default();
            for col in 0..cols {
                // In order of frequency, from the most negative one.
                let wave = (row + rows / 2 + 1) % rows * cols + (col + cols / 2 + 1) % cols;
                along.add(&powers[wave], 1.0);
                let mut sum = sums[row * wide + col + 1];
                sum.add(&along, 1.0);
                sums[(row + 1) * wide + col + 1] = sum;
            }
        }
        Self { rows, cols, sums }
    }

    /// Returns the sum over wave `i` and its neighbours.
    fn around(&self, i: usize) -> Powers {
        let frequency = [signed(i / self.cols, self.rows), signed(i % self.cols, self.cols)];
        let reach = NEIGHBOURS * frequency[0].hypot(frequency[1]);
        let range = |frequency: f64, n: usize| {
            let (at, reach) =
                ((frequency * n as f64).round() as isize + ((n - 1) / 2) as isize, (reach * n as f64).ceil() as isize);
            let clamp = |at: isize| at.clamp(0, n as isize) as usize;
            (clamp(at - reach.max(1)), clamp(at + reach.max(1) + 1))
        };
        let ((top, bottom), (left, right)) = (range(frequency[0], self.rows), range(frequency[1], self.cols));
        let at = |row: usize, col: usize| &self.sums[row * (self.cols + 1) + col];
        let mut sum = *at(bottom, right);
        sum.add(at(top, right), -1.0);
        sum.add(at(bottom, left), -1.0);
        sum.add(at(top, left), 1.0);
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const SHAPE: (usize, usize) = (96, 120);
    const COARSE_PX: usize = 12;

    /// Returns a lesson whose contrast is `filter` of the truth, and whose coarse DTM is a mean of the truth.
    fn lesson(seed: u64, filter: impl Fn(&dyn Fn(usize, usize) -> f64, usize, usize) -> f64) -> Lesson {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (rows, cols) = (SHAPE.0 + 40, SHAPE.1 + 40);
        // White noise, smoothed twice: most of its power is in long waves, as on real ground.
        let mut map: Vec<f64> = (0..rows * cols).map(|_| rng.random_range(-1.0..1.0)).collect();
        let mean = |map: &[f64], side: usize| -> Vec<f64> {
            let at = |i: usize| {
                let (row, col) = (i / cols, i % cols);
                let (rows, cols_) = (row..(row + side).min(rows), col..(col + side).min(cols));
                let count = (rows.len() * cols_.len()) as f64;
                rows.flat_map(|r| cols_.clone().map(move |c| r * cols + c)).map(|i| map[i]).sum::<f64>() / count
            };
            (0..map.len()).map(at).collect()
        };
        let long = mean(&map, 9);
        map.iter_mut().zip(&long).for_each(|(v, long)| *v = 0.1 * *v + long);
        let coarse = mean(&map, COARSE_PX);
        let crop = |f: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
            (0..SHAPE.0 * SHAPE.1).map(|i| f(i / SHAPE.1 + 20, i % SHAPE.1 + 20)).collect()
        };
        let height = |r: usize, c: usize| map[r * cols + c];
        Lesson {
            contrast: crop(&|r, c| filter(&height, r, c)),
            // Centred on the pixel, as a coarse DTM without misregistration.
            coarse: crop(&|r, c| coarse[(r - COARSE_PX / 2) * cols + c - COARSE_PX / 2]),
            truth: crop(&height),
        }
    }

    /// Returns the rms of the heights' error over that of the coarse DTM, away from the edges, on a scene that was no lesson.
    fn error_ratio(filter: impl Fn(&dyn Fn(usize, usize) -> f64, usize, usize) -> f64 + Sync + Copy) -> f64 {
        let found = LinearFilter::fit(SHAPE, COARSE_PX as f32, 24, |seed| Ok(lesson(seed as u64, filter))).unwrap();
        let Lesson { contrast, coarse, truth } = lesson(1_000, filter);
        let heights = found.apply(&contrast, &coarse, SHAPE);
        let inside =
            |i: &usize| (16..SHAPE.0 - 16).contains(&(i / SHAPE.1)) && (16..SHAPE.1 - 16).contains(&(i % SHAPE.1));
        let rms = |map: &[f64]| {
            let errors: Vec<f64> = (0..truth.len()).filter(inside).map(|i| map[i] - truth[i]).collect();
            (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
        };
        rms(&heights) / rms(&coarse)
    }

    #[test]
    fn a_linear_image_is_inverted() {
        // Its response is nowhere 0 (at least 0.3), so that the truth is a linear filter of the image.
        let ratio = error_ratio(|z, r, c| z(r, c) - 0.5 * z(r, c - 1) - 0.2 * z(r - 1, c));
        // Gains are smoothed over neighbouring waves, and a window mixes waves.
        assert!(ratio < 0.1, "{ratio}");
    }

    #[test]
    fn an_image_without_relief_leaves_the_coarse_dtm_nearly_alone() {
        let noise = |z: &dyn Fn(usize, usize) -> f64, r: usize, c: usize| (1e4 * z(r, c)).sin();
        let ratio = error_ratio(noise);
        assert!((0.7..1.05).contains(&ratio), "{ratio}");
    }

    #[test]
    fn maps_of_another_size_are_refused() {
        let lesson = |_| Ok(Lesson { contrast: vec![0.0; 9], coarse: vec![0.0; 9], truth: vec![0.0; 8] });
        let refused = LinearFilter::fit((3, 3), 2.0, 1, lesson).unwrap_err().to_string();
        assert!(refused.contains("3 x 3") && refused.contains("[9, 9, 8]"), "{refused}");
    }
}
