//! Weighing of a network's shortest waves by what the image shows there.
//!
//! Noise and albedo have short waves, too, and a network follows them: on rendered images with noise its corrections at 2 to 4 pixels had several
//! times the true amplitude and hardly any correlation with the ground. The directional share of an octave ([`Share`]) tells how much
//! of the contrast's power is relief. So the amplitude of what a tile adds to its coarse DTM is kept by the share's square root (our choice).

use crate::error::{LengthError, same_length};
use crate::part::{few, item, put, put_few};
use crate::photoclinometry::Share;
use crate::words::Words;

/// The parts that are kept of what a tile adds to its coarse DTM, in waves of 2 to 4 and of 4 to 8 pixels. Longer waves are kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FineWaves {
    kept: [f32; 2],
}

impl FineWaves {
    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        self.kept.iter_mut().for_each(|v| words.f32(v));
    }

    /// All waves are kept.
    pub const WHOLE: Self = Self { kept: [1.0; 2] };

    /// Returns what the shares of a tile's image leave.
    #[must_use]
    pub fn of_share(share: &Share) -> Self {
        Self { kept: [0, 1].map(|octave| libm::sqrtf(share.octave(octave))) }
    }

    /// Number of `f64` values that [`apply`](Self::apply) needs beside a map of the tile's size.
    #[must_use]
    pub const fn line_len(rows: usize, cols: usize) -> usize {
        if rows > cols { rows } else { cols }
    }

    /// Weighs the short waves of `heights_m` minus `coarse_m`. Both are finite, row-major, `cols` wide, metres. `added` is scratch memory of the
    /// same length, `line` of at least [`line_len`](Self::line_len).
    ///
    /// An octave is the difference of two means: over 1, 2, 1 pixels, and over the same weights two pixels apart. Beyond an edge the pixel at it
    /// counts.
    ///
    /// # Errors
    /// [`LengthError`] if a buffer has another length, or `heights_m` does not consist of whole rows; nothing is changed then.
    pub fn apply(
        self,
        heights_m: &mut [f32],
        coarse_m: &[f32],
        cols: usize,
        added: &mut [f32],
        line: &mut [f64],
    ) -> Result<(), LengthError> {
        (0..Self::UNITS).try_for_each(|unit| self.unit(unit, heights_m, coarse_m, cols, added, line))
    }

    /// Number of units of work of [`apply`](Self::apply).
    pub(crate) const UNITS: usize = 9;

    /// Does one unit of the work. All are done in order, with unchanged buffers.
    pub(crate) fn unit(
        self,
        unit: usize,
        heights_m: &mut [f32],
        coarse_m: &[f32],
        cols: usize,
        added: &mut [f32],
        line: &mut [f64],
    ) -> Result<(), LengthError> {
        same_length(heights_m.len(), coarse_m.len())?;
        same_length(heights_m.len(), added.len())?;
        let rows = heights_m.len().checked_div(cols).unwrap_or(0);
        same_length(rows * cols, heights_m.len())?;
        let (expected, found) = (Self::line_len(rows, cols), line.len());
        if found < expected {
            return Err(LengthError { expected, found });
        }
        if self == Self::WHOLE {
            return Ok(());
        }
        let Some(pass) = unit.checked_sub(1) else {
            for ((a, z), coarse) in added.iter_mut().zip(heights_m.iter()).zip(coarse_m) {
                *a = z - coarse;
            }
            return Ok(());
        };
        let (removed, apart) = (1.0 - item(&self.kept, pass / 4), 1 + pass / 4);
        match pass % 4 {
            0 => heights_m.iter_mut().zip(added.iter()).for_each(|(z, a)| *z -= removed * a),
            1 => (0..rows).for_each(|row| smooth::<1>(added, (row * cols, 1), (cols, apart), line)),
            2 => {
                // Columns side by side, where the line has room for them.
                let mut col = 0;
                while line.len() >= COLUMNS * rows && col + COLUMNS <= cols {
                    smooth::<COLUMNS>(added, (col, cols), (rows, apart), line);
                    col += COLUMNS;
                }
                (col..cols).for_each(|col| smooth::<1>(added, (col, cols), (rows, apart), line));
            }
            _ => heights_m.iter_mut().zip(added.iter()).for_each(|(z, a)| *z += removed * a),
        }
        Ok(())
    }
}

/// Number of columns that are smoothed side by side.
const COLUMNS: usize = 8;

/// Replaces the values of `N` lines of `map` side by side by means over three of them, `apart` values from each other, with the weights 1, 2, 1. The
/// first line begins at `first`; each has `len` values, `stride` apart.
fn smooth<const N: usize>(
    map: &mut [f32],
    (first, stride): (usize, usize),
    (len, apart): (usize, usize),
    line: &mut [f64],
) {
    let line = line.as_chunks_mut::<N>().0;
    for i in 0..len {
        put(line, i, few(map, first + i * stride).map(f64::from));
    }
    let last = len.saturating_sub(1);
    let value = |i: usize| line.get(i).copied().unwrap_or([0.0; N]);
    for i in 0..len {
        let (before, here, after) =
            (value(i.saturating_sub(apart)), value(i), value(i.saturating_add(apart).min(last)));
        let mean = |n: usize| (0.25 * (before[n] + 2.0 * here[n] + after[n])) as f32;
        put_few(map, first + i * stride, core::array::from_fn::<f32, N, _>(mean));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLS: usize = 96;

    fn applied(waves: FineWaves, heights: &[f32], coarse: &[f32]) -> Vec<f32> {
        let mut out = heights.to_vec();
        let (mut added, mut line) = (vec![0.0; out.len()], [0.0; COLS]);
        waves.apply(&mut out, coarse, COLS, &mut added, &mut line).unwrap();
        out
    }

    /// The amplitude that is left of a wave along rows, or along columns, away from the edges.
    fn left(waves: FineWaves, length_px: f32, along_rows: bool) -> f32 {
        let place = |i: usize| if along_rows { i % COLS } else { i / COLS };
        let wave: Vec<f32> =
            (0..64 * COLS).map(|i| (core::f32::consts::TAU * (place(i) as f32 + 0.25) / length_px).sin()).collect();
        let out = applied(waves, &wave, &vec![0.0; wave.len()]);
        let inner = (16 * COLS..48 * COLS).filter(|i| (16..80).contains(&(i % COLS)));
        let (square, whole) = inner.fold((0.0, 0.0), |(a, b), i| (a + out[i] * out[i], b + wave[i] * wave[i]));
        (square / whole).sqrt()
    }

    #[test]
    fn short_waves_are_kept_by_their_part_and_long_ones_whole() {
        for along_rows in [true, false] {
            let shortest = FineWaves { kept: [0.2, 1.0] };
            let left = |waves, length_px| left(waves, length_px, along_rows);
            assert!((left(shortest, 2.0) - 0.2).abs() < 1e-3, "{}", left(shortest, 2.0));
            assert!((left(shortest, 4.0) - 0.6).abs() < 0.02, "{}", left(shortest, 4.0));
            assert!(left(shortest, 16.0) > 0.95);
            let both = FineWaves { kept: [0.2; 2] };
            assert!(left(both, 4.0) < 0.25 && left(both, 6.0) < 0.5, "{} {}", left(both, 4.0), left(both, 6.0));
            assert!(left(both, 32.0) > 0.95);
        }
    }

    #[test]
    fn what_the_coarse_dtm_shows_is_not_touched() {
        let coarse: Vec<f32> = (0..8 * COLS).map(|i| ((i * 7) % 5) as f32).collect();
        assert_eq!(applied(FineWaves { kept: [0.0; 2] }, &coarse, &coarse), coarse);
        let heights: Vec<f32> = coarse.iter().map(|z| z + 3.0).collect();
        let out = applied(FineWaves { kept: [0.0; 2] }, &heights, &coarse);
        assert!(out.iter().zip(&heights).all(|(a, b)| (a - b).abs() < 1e-5));
        assert_eq!(applied(FineWaves::WHOLE, &[1.0; COLS], &[0.0; COLS]), [1.0; COLS]);
    }

    #[test]
    fn columns_side_by_side_have_the_same_bits() {
        // The second map has fewer columns than are smoothed side by side.
        for (rows, cols) in [(37, 29), (37, 5)] {
            let heights: Vec<f32> = (0..rows * cols).map(|i| ((i * 7919) % 613) as f32 * 0.37).collect();
            let (coarse, waves) = (vec![40.0; heights.len()], FineWaves { kept: [0.3, 0.7] });
            let made = |len: usize| {
                let (mut out, mut added, mut line) = (heights.clone(), vec![0.0; heights.len()], vec![0.0; len]);
                waves.apply(&mut out, &coarse, cols, &mut added, &mut line).unwrap();
                out.into_iter().map(f32::to_bits).collect::<Vec<_>>()
            };
            assert_eq!(made(rows), made(COLUMNS * rows));
        }
    }

    #[test]
    fn shares_decide() {
        assert_eq!(FineWaves::of_share(&Share::WHOLE), FineWaves::WHOLE);
    }

    #[test]
    fn wrong_lengths_are_refused() {
        let waves = FineWaves { kept: [0.5; 2] };
        let (mut heights, mut added, mut line) = ([1.0_f32; 6], [0.0_f32; 6], [0.0_f64; 3]);
        let mut refused = |coarse: usize, cols, line: &mut [f64]| {
            waves.apply(&mut heights, &[0.0; 6][..coarse], cols, &mut added, line).is_err()
        };
        assert!(refused(5, 3, &mut line) && refused(6, 4, &mut line) && refused(6, 0, &mut line));
        assert!(refused(6, 3, &mut line[..2]));
        assert_eq!(heights, [1.0; 6]);
        assert!(waves.apply(&mut heights, &[0.0; 6], 3, &mut added[..5], &mut line).is_err());
    }
}
