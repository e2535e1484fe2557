//! Spectra of truth and candidate, and their cross-spectrum.
//!
//! Both maps are cut to the box of their valid pixels; voids are filled smoothly ([`super::fill`]); the least-squares plane is subtracted; a
//! Hann window lowers both to 0 at the edges, so that edges make no short waves. Then both are transformed by one FFT. A large box is cut into
//! blocks of one size, whose powers are added (Welch 1967).

use super::fill::fill;
use elunar_base::Result;
use elunar_core::tile::Window;
use elunar_raster::Raster;
use rustfft::num_complex::Complex64;
use rustfft::{FftDirection, FftPlanner};
use std::f64::consts::TAU;

/// Largest box that is transformed whole, pixels: 800 MB with the search for an offset.
const LARGEST_PX: usize = 1 << 24;
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

/// Spectra of truth and candidate over a box, or over its blocks.
pub(super) struct CrossSpectrum {
    /// Rows of the box, or of a block.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Blocks whose powers are added.
    pub blocks: u64,
    content: Content,
}

enum Content {
    /// Fourier coefficients of truth + i · candidate.
    Packed(Vec<Complex64>),
    /// Powers of truth and candidate, and their product, added over the blocks.
    Sums(Vec<(f64, f64, Complex64)>),
}

/// Reads truth and candidate in a window, with the same voids.
pub(super) type ReadPair<'a> = &'a mut dyn FnMut(Window) -> Result<[Vec<f32>; 2]>;

impl CrossSpectrum {
    /// Transforms two maps of one size. `None` if the box of their valid pixels is narrower than 16 pixels or not half valid.
    pub(super) fn of(truth: &Raster, candidate: &Raster) -> Option<Self> {
        let valid = |i: usize| truth.samples[i].is_finite() && candidate.samples[i].is_finite();
        let (mut top, mut bottom, mut left, mut right) = (truth.rows, 0, truth.cols, 0);
        for i in (0..truth.samples.len()).filter(|i| valid(*i)) {
            let (row, col) = (i / truth.cols, i % truth.cols);
            (top, bottom, left, right) = (top.min(row), bottom.max(row + 1), left.min(col), right.max(col + 1));
        }
        let (rows, cols) = (bottom.checked_sub(top)?, right.checked_sub(left)?);
        let mut read = |window: Window| {
            let at = |k: usize| (window.row + k / window.cols) * truth.cols + window.col + k % window.cols;
            let value = |map: &Raster, i: usize| if valid(i) { map.samples[i] } else { f32::NAN };
            let all = 0..window.rows * window.cols;
            Ok([truth, candidate].map(|map| all.clone().map(|k| value(map, at(k))).collect()))
        };
        Self::of_box(&mut read, Window { row: top, col: left, rows, cols }, LARGEST_PX).ok().flatten()
    }

    /// Transforms the maps in the box of their valid pixels. Boxes of more than `largest_px` are cut into blocks of at most half of that.
    /// `None` if the box, or every block, is narrower than 16 pixels or not half valid.
    ///
    /// # Errors
    /// Errors of `read` are passed on.
    pub(super) fn of_box(read: ReadPair, bounds: Window, largest_px: usize) -> Result<Option<Self>> {
        if bounds.rows.min(bounds.cols) < SHORTEST_SIDE_PX {
            return Ok(None);
        }
        if bounds.rows * bounds.cols <= largest_px {
            return Ok(packed(read(bounds)?, bounds.rows, bounds.cols).map(|packed| Self {
                rows: bounds.rows,
                cols: bounds.cols,
                blocks: 1,
                content: Content::Packed(packed),
            }));
        }
        let (down, across) = parts(bounds.rows, bounds.cols, largest_px / 2);
        let (rows, cols) = (bounds.rows.div_ceil(down), bounds.cols.div_ceil(across));
        // The last block ends with the box.
        let start = |k: usize, parts: usize, all: usize, part: usize| (all - part) * k / (parts - 1).max(1);
        let mut sums = vec![(0.0, 0.0, Complex64::default()); rows * cols];
        let mut blocks = 0;
        for (i, j) in (0..down).flat_map(|i| (0..across).map(move |j| (i, j))) {
            let row = bounds.row + start(i, down, bounds.rows, rows);
            let col = bounds.col + start(j, across, bounds.cols, cols);
            let Some(packed) = packed(read(Window { row, col, rows, cols })?, rows, cols) else { continue };
            for (k, sum) in sums.iter_mut().enumerate() {
                let (truth, candidate) = unpacked(&packed, k, rows, cols);
                let (power, other) = (truth.norm_sqr(), candidate.norm_sqr());
                *sum = (sum.0 + power, sum.1 + other, sum.2 + truth.conj() * candidate);
            }
            blocks += 1;
        }
        Ok((blocks > 0).then_some(Self { rows, cols, blocks, content: Content::Sums(sums) }))
    }

    /// Transforms the maps in the box of their valid pixels, with the usual blocks.
    ///
    /// # Errors
    /// As [`Self::of_box`].
    pub(super) fn read(read: ReadPair, bounds: Window) -> Result<Option<Self>> {
        Self::of_box(read, bounds, LARGEST_PX)
    }

    /// Returns all waves but the mean.
    pub(super) fn waves(&self) -> impl Iterator<Item = Wave> + '_ {
        let signed = |at: usize, n: usize| (if 2 * at > n { at as f64 - n as f64 } else { at as f64 }) / n as f64;
        (1..self.rows * self.cols).map(move |k| {
            let frequency = (signed(k / self.cols, self.rows), signed(k % self.cols, self.cols));
            let (truth, candidate, cross) = match &self.content {
                Content::Sums(sums) => sums[k],
                Content::Packed(packed) => {
                    let (truth, candidate) = unpacked(packed, k, self.rows, self.cols);
                    (truth.norm_sqr(), candidate.norm_sqr(), truth.conj() * candidate)
                }
            };
            Wave { frequency, truth, candidate, cross }
        })
    }
}

/// Returns into how many parts rows and columns are cut, so that a block has at most so many pixels.
fn parts(rows: usize, cols: usize, most_px: usize) -> (usize, usize) {
    let (mut down, mut across) = (1, 1);
    while rows.div_ceil(down) * cols.div_ceil(across) > most_px {
        if rows.div_ceil(down) >= cols.div_ceil(across) { down += 1 } else { across += 1 }
    }
    (down, across)
}

/// Returns the Fourier coefficients of truth + i · candidate; `None` if not half of the pixels are valid, or the map is too narrow.
fn packed([truth, candidate]: [Vec<f32>; 2], rows: usize, cols: usize) -> Option<Vec<Complex64>> {
    let count = truth.iter().filter(|z| z.is_finite()).count() as f64;
    if rows.min(cols) < SHORTEST_SIDE_PX || count < LEAST_VALID * truth.len() as f64 {
        return None;
    }
    let prepared = |map: Vec<f32>| {
        let mut values: Vec<f64> = map.into_iter().map(f64::from).collect();
        fill(&mut values, rows, cols);
        window(&mut values, rows, cols);
        values
    };
    let mut packed: Vec<Complex64> = prepared(truth).into_iter().map(|re| Complex64 { re, im: 0.0 }).collect();
    packed.iter_mut().zip(prepared(candidate)).for_each(|(z, im)| z.im = im);
    transform(&mut packed, rows, cols, FftDirection::Forward);
    Some(packed)
}

/// Returns coefficient `k` of truth and candidate.
fn unpacked(packed: &[Complex64], k: usize, rows: usize, cols: usize) -> (Complex64, Complex64) {
    let (row, col) = (k / cols, k % cols);
    let mirrored = (rows - row) % rows * cols + (cols - col) % cols;
    let (z, m) = (packed[k], packed[mirrored].conj());
    // The transform of a real map equals its mirrored conjugate: truth = (z + m) / 2, candidate = (z - m) / 2i.
    ((z + m) * 0.5, (z - m) * Complex64 { re: 0.0, im: -0.5 })
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

    /// Hills and noise: blocks show what the whole shows.
    #[test]
    fn blocks_show_the_octaves_and_the_offset_of_the_whole() {
        use super::super::octaves::octaves;
        use super::super::registration::registration;
        use elunar_core::terrain::PixelSize;
        let (rows, cols) = (230, 310);
        let height = |r: f64, c: f64| {
            let waves = (1..60).map(|k| {
                let (k, turn) = (f64::from(k), f64::from(k) * 2.4);
                let frequency = TAU * (0.02 + 0.003 * k);
                (frequency * (r * turn.cos() + c * turn.sin()) + turn * 3.7).sin() * 2.0 / k
            });
            waves.sum::<f64>()
        };
        let map = |down: f64, right: f64, scale: f64| -> Vec<f32> {
            (0..rows * cols)
                .map(|i| (scale * height((i / cols) as f64 - down, (i % cols) as f64 - right)) as f32)
                .collect()
        };
        let (truth, mut candidate) = (map(0.0, 0.0, 1.0), map(0.3, -0.4, 0.6));
        candidate[50 * cols..50 * cols + 20].fill(f32::NAN);
        let mut sizes = vec![];
        let mut of = |largest_px: usize| {
            let mut read = |window: Window| {
                sizes.push(window.rows * window.cols);
                let at = |k: usize| (window.row + k / window.cols) * cols + window.col + k % window.cols;
                let of = |map: &[f32]| {
                    (0..window.rows * window.cols)
                        .map(|k| if candidate[at(k)].is_finite() { map[at(k)] } else { f32::NAN })
                        .collect()
                };
                Ok([of(&truth), of(&candidate)])
            };
            CrossSpectrum::of_box(&mut read, Window { row: 0, col: 0, rows, cols }, largest_px).unwrap().unwrap()
        };
        let (whole, blocks) = (of(rows * cols), of(40_000));
        assert_eq!((whole.blocks, sizes.len()), (1, 1 + blocks.blocks as usize));
        assert!(sizes[1..].iter().all(|size| *size <= 20_000) && blocks.blocks >= 4, "{sizes:?}");
        let pixel = PixelSize::square(2.0);
        let (a, b) = (octaves(&whole, pixel, None), octaves(&blocks, pixel, None));
        for (a, b) in a.iter().zip(&b).filter(|(a, _)| a.longest_m <= 64.0) {
            for (a, b) in [(a.correlation, b.correlation), (a.gain, b.gain), (a.amplitude, b.amplitude)] {
                assert!((a - b).abs() < 0.02, "{a} {b}");
            }
        }
        let (a, b) = (registration(&whole, pixel, 0.0).unwrap(), registration(&blocks, pixel, 0.0).unwrap());
        assert!((a.down_px - 0.3).abs() < 0.02 && (b.down_px - 0.3).abs() < 0.02 && (b.right_px + 0.4).abs() < 0.02);
        assert!(b.down_sd_px < 4.0 * a.down_sd_px && a.down_sd_px < 4.0 * b.down_sd_px, "{a:?} {b:?}");
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
