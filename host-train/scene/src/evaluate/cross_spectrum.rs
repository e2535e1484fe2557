//! Spectra of truth and candidate, and their cross-spectrum.
//!
//! Both maps are cut to the box of their valid pixels; voids are filled smoothly ([`super::fill`]); the least-squares plane is subtracted; a
//! Hann window lowers both to 0 at the edges, so that edges make no short waves. Then both are transformed by one FFT.

use super::fill::fill;
use elunar_raster::Raster;
use rustfft::num_complex::Complex64;
use rustfft::{FftDirection, FftPlanner};
use std::f64::consts::TAU;

/// Largest box, pixels. Its transform takes 3.2 GB.
const LARGEST_PX: usize = 100_000_000;
/// Shortest side of a box, pixels.
const SHORTEST_SIDE_PX: usize = 16;
/// Least share of valid pixels in the box.
const LEAST_VALID: f64 = 0.5;

/// One wave: frequencies and powers.
pub(super) struct Wave {
    /// Frequency down and across, cycles per pixel, [-1/2, 1/2].
    pub frequency: (f64, f64),
    /// Power of the truth.
    pub truth: f64,
    /// Power of the candidate.
    pub candidate: f64,
    /// Conjugate of the truth's coefficient times the candidate's.
    pub cross: Complex64,
}

/// Fourier coefficients of truth and candidate: the transform of truth + i · candidate.
pub(super) struct CrossSpectrum {
    pub rows: usize,
    pub cols: usize,
    packed: Vec<Complex64>,
}

impl CrossSpectrum {
    /// Transforms two maps of one size and the same voids. `None` if the box of their valid pixels is narrower than 16 pixels, larger than
    /// 100 million, or not half valid.
    pub(super) fn of(truth: &Raster, candidate: &Raster) -> Option<Self> {
        let valid = |i: usize| truth.samples[i].is_finite() && candidate.samples[i].is_finite();
        let (mut top, mut bottom, mut left, mut right, mut count) = (truth.rows, 0, truth.cols, 0, 0);
        for i in (0..truth.samples.len()).filter(|i| valid(*i)) {
            let (row, col) = (i / truth.cols, i % truth.cols);
            (top, bottom, left, right) = (top.min(row), bottom.max(row + 1), left.min(col), right.max(col + 1));
            count += 1;
        }
        let (rows, cols) = (bottom.checked_sub(top)?, right.checked_sub(left)?);
        let area = rows * cols;
        if rows.min(cols) < SHORTEST_SIDE_PX || area > LARGEST_PX || (count as f64) < LEAST_VALID * area as f64 {
            return None;
        }
        let prepared = |map: &Raster| {
            let at = |k: usize| (top + k / cols) * map.cols + left + k % cols;
            let value = |k: usize| if valid(at(k)) { f64::from(map.samples[at(k)]) } else { f64::NAN };
            let mut values: Vec<f64> = (0..area).map(value).collect();
            fill(&mut values, rows, cols);
            window(&mut values, rows, cols);
            values
        };
        let mut packed: Vec<Complex64> =
            prepared(truth).into_iter().zip(prepared(candidate)).map(|(re, im)| Complex64 { re, im }).collect();
        transform(&mut packed, rows, cols, FftDirection::Forward);
        Some(Self { rows, cols, packed })
    }

    /// Returns all waves but the mean.
    pub(super) fn waves(&self) -> impl Iterator<Item = Wave> + '_ {
        (1..self.packed.len()).map(|k| {
            let (row, col) = (k / self.cols, k % self.cols);
            let mirrored = (self.rows - row) % self.rows * self.cols + (self.cols - col) % self.cols;
            let (z, m) = (self.packed[k], self.packed[mirrored].conj());
            // The transform of a real map equals its mirrored conjugate: truth = (z + m) / 2, candidate = (z - m) / 2i.
            let (truth, candidate) = ((z + m) * 0.5, (z - m) * Complex64 { re: 0.0, im: -0.5 });
            let signed = |at: usize, n: usize| (if 2 * at > n { at as f64 - n as f64 } else { at as f64 }) / n as f64;
            Wave {
                frequency: (signed(row, self.rows), signed(col, self.cols)),
                truth: truth.norm_sqr(),
                candidate: candidate.norm_sqr(),
                cross: truth.conj() * candidate,
            }
        })
    }
}

/// Subtracts the least-squares plane and applies the Hann window, after which the sum is 0.
pub(super) fn window(map: &mut [f64], rows: usize, cols: usize) {
    let hann =
        |n: usize| -> Vec<f64> { (0..n).map(|k| 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / n as f64).cos()).collect() };
    let centred = |at: usize, n: usize| at as f64 - 0.5 * (n - 1) as f64;
    let (mut mean, mut down, mut across) = (0.0, 0.0, 0.0);
    for (i, v) in map.iter().enumerate() {
        mean += v;
        down += v * centred(i / cols, rows);
        across += v * centred(i % cols, cols);
    }
    let square = |n: usize| (n as f64).mul_add(n as f64, -1.0) / 12.0;
    let area = (rows * cols) as f64;
    let (mean, down, across) = (mean / area, down / area / square(rows), across / area / square(cols));
    let (of_row, of_col) = (hann(rows), hann(cols));
    let (mut sum, mut weights) = (0.0, 0.0);
    for (i, v) in map.iter_mut().enumerate() {
        *v -= mean + down * centred(i / cols, rows) + across * centred(i % cols, cols);
        let weight = of_row[i / cols] * of_col[i % cols];
        sum += *v * weight;
        weights += weight;
    }
    let offset = sum / weights;
    map.iter_mut().enumerate().for_each(|(i, v)| *v = (*v - offset) * of_row[i / cols] * of_col[i % cols]);
}

/// Transforms in place, without a factor.
pub(super) fn transform(map: &mut Vec<Complex64>, rows: usize, cols: usize, direction: FftDirection) {
    let mut planner = FftPlanner::new();
    planner.plan_fft(cols, direction).process(map);
    let mut turned = turn(map, rows, cols);
    planner.plan_fft(rows, direction).process(&mut turned);
    *map = turn(&turned, cols, rows);
}

/// Returns the transposed map, block by block.
fn turn(map: &[Complex64], rows: usize, cols: usize) -> Vec<Complex64> {
    const BLOCK: usize = 16;
    let mut out = vec![Complex64::default(); map.len()];
    for (top, left) in (0..rows).step_by(BLOCK).flat_map(|r| (0..cols).step_by(BLOCK).map(move |c| (r, c))) {
        for row in top..rows.min(top + BLOCK) {
            for col in left..cols.min(left + BLOCK) {
                out[col * rows + row] = map[row * cols + col];
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficients_are_those_of_the_definition() {
        let (rows, cols) = (16, 18);
        let map = |f: fn(f64) -> f64| Raster {
            rows,
            cols,
            samples: (0..rows * cols).map(|i| f(i as f64) as f32).collect(),
            georef: None,
        };
        let (truth, candidate) = (map(|i| (i * 0.37).sin() * 3.0 + i * 0.01), map(|i| (i * i * 0.013).cos() + 5.0));
        let found = CrossSpectrum::of(&truth, &candidate).unwrap();
        let coefficient = |map: &Raster, (down, across): (f64, f64)| {
            let mut values: Vec<f64> = map.samples.iter().map(|v| f64::from(*v)).collect();
            window(&mut values, rows, cols);
            let wave = |(i, v): (usize, &f64)| {
                Complex64::from_polar(*v, -TAU * (down * (i / cols) as f64 + across * (i % cols) as f64))
            };
            values.iter().enumerate().map(wave).sum::<Complex64>()
        };
        assert_eq!(found.waves().count(), rows * cols - 1);
        for wave in found.waves().step_by(7) {
            let (t, c) = (coefficient(&truth, wave.frequency), coefficient(&candidate, wave.frequency));
            assert!((wave.truth - t.norm_sqr()).abs() < 1e-8 && (wave.candidate - c.norm_sqr()).abs() < 1e-8);
            assert!((wave.cross - t.conj() * c).norm() < 1e-8);
        }
    }

    #[test]
    fn planes_have_no_waves_and_small_or_void_maps_no_spectrum() {
        let plane = |rows: usize, cols: usize| Raster {
            rows,
            cols,
            samples: (0..rows * cols).map(|i| 7.0 + (i / cols) as f32 - 0.5 * (i % cols) as f32).collect(),
            georef: None,
        };
        let mut map = plane(30, 20);
        assert!(CrossSpectrum::of(&map, &map).unwrap().waves().all(|wave| wave.truth < 1e-12));
        assert!(CrossSpectrum::of(&plane(15, 40), &plane(15, 40)).is_none());
        (0..600).filter(|i| i % 5 > 1 && *i > 20 && *i < 580).for_each(|i| map.samples[i] = f32::NAN);
        assert!(CrossSpectrum::of(&map, &map).is_none());
        map.samples.fill(f32::NAN);
        assert!(CrossSpectrum::of(&map, &map).is_none());
    }
}
