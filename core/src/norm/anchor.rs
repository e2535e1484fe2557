//! The long waves of a DTM as an estimate from the DTM and the coarse DTM.
//!
//! One image shows slopes, not heights, and a coarse DTM has errors. So each long wave of the result is a weighted mean of the network's and the
//! coarse DTM's ([`Anchor`]), and the short waves are the network's (our choice; the paper leaves the network free at every wavelength).
//!
//! Like is compared with like: a coarse height is a mean over a coarse pixel, and so the DTM is averaged over one before it is compared. Without
//! that, the long waves that an average makes flatter are taken from the DTM, too. Near an edge the box is narrower instead of one-sided: a mean to
//! one side would take a slope for a difference.

use crate::error::{LengthError, same_length};
use crate::part::{copy, few, item, put, put_few};

/// Half the width of one box, in pixels of the coarse DTM. Three boxes, after the mean over a coarse pixel, make a low-pass of standard deviation 0.58
/// coarse pixels, which halves waves of three coarse pixels; a coarse DTM hardly contains shorter waves.
const RADIUS_COARSE_PX: f32 = 0.5;

/// Half the width of a coarse pixel, in its own size.
const HALF_COARSE_PX: f32 = 0.5;

/// Weight of the coarse DTM in the long waves (our choice).
const WEIGHT: f32 = 0.7;

/// Number of box means in a row; together they are nearly a Gaussian low-pass.
const BOXES: usize = 3;

/// Number of lines that are averaged side by side, if the sums have room for them.
const LINES: usize = 8;

/// A low-pass with the width of the coarse DTM's pixels.
///
/// ```
/// use elunar_core::norm::Anchor;
///
/// // The network added a crater and, wrongly, half a metre everywhere.
/// let coarse_m = [10.0; 64];
/// let mut heights_m = [10.5; 64];
/// heights_m[27] -= 2.0;
/// let (mut difference, mut sums) = ([0.0; 64], [0.0; 9]);
/// Anchor::new(4.0).apply(&mut heights_m, &coarse_m, 8, &mut difference, &mut sums)?;
/// let mean_m = heights_m.iter().sum::<f32>() / 64.0;
/// assert!((mean_m - 10.15).abs() < 0.05 && heights_m[27] < 8.5);
/// # Ok::<(), elunar_core::error::LengthError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Anchor {
    radius_px: usize,
    /// Half the width of a coarse pixel.
    half_px: usize,
    /// Weight of the coarse DTM.
    weight: f32,
}

impl Anchor {
    /// Makes an anchor for a coarse DTM whose pixels are `coarse_px` pixels of the image wide.
    #[must_use]
    pub fn new(coarse_px: f32) -> Self {
        // `as` turns NaN and negative numbers into 0: then every wave is a long one.
        let of = |part: f32| (part * coarse_px + 0.5) as usize;
        Self { radius_px: of(RADIUS_COARSE_PX), half_px: of(HALF_COARSE_PX), weight: WEIGHT }
    }

    /// Makes an anchor that believes the coarse DTM alone: for a truth that is taught, whose long waves are then the coarse DTM's with their errors,
    /// and for a DTM without long waves of its own.
    #[must_use]
    pub fn whole(coarse_px: f32) -> Self {
        Self { weight: 1.0, ..Self::new(coarse_px) }
    }

    /// Number of `f64` values that [`apply`](Self::apply) needs beside a map of the tile's size.
    #[must_use]
    pub const fn sums_len(rows: usize, cols: usize) -> usize {
        (if rows > cols { rows } else { cols }).saturating_add(1)
    }

    /// Draws the long waves of `heights_m` to those of `coarse_m`: subtracts the weighted low-pass of their difference, where the heights are
    /// means over coarse pixels. Both are finite, row-major, `cols` wide. Means near the edges are taken over pixels inside the map. `difference`
    /// is scratch memory of the same length, `sums` of at least [`sums_len`](Self::sums_len); with eight times as many it is faster, with the
    /// same result.
    ///
    /// # Errors
    /// [`LengthError`] if a buffer has another length, or `heights_m` does not consist of whole rows; nothing is changed then.
    pub fn apply(
        self,
        heights_m: &mut [f32],
        coarse_m: &[f32],
        cols: usize,
        difference: &mut [f32],
        sums: &mut [f64],
    ) -> Result<(), LengthError> {
        (0..Self::UNITS).try_for_each(|unit| self.unit(unit, heights_m, coarse_m, cols, difference, sums))
    }

    /// Number of units of work of [`apply`](Self::apply).
    pub(crate) const UNITS: usize = 3 + 2 * (1 + BOXES);

    /// Does one unit of the work. All are done in order, with unchanged buffers.
    pub(crate) fn unit(
        self,
        unit: usize,
        heights_m: &mut [f32],
        coarse_m: &[f32],
        cols: usize,
        difference: &mut [f32],
        sums: &mut [f64],
    ) -> Result<(), LengthError> {
        same_length(heights_m.len(), coarse_m.len())?;
        same_length(heights_m.len(), difference.len())?;
        let rows = heights_m.len().checked_div(cols).unwrap_or(0);
        same_length(rows * cols, heights_m.len())?;
        let (expected, found) = (Self::sums_len(rows, cols), sums.len());
        if found < expected {
            return Err(LengthError { expected, found });
        }
        let along_rows = Lines { apart: cols, count: rows, step: 1, len: cols };
        let along_cols = Lines { apart: 1, count: cols, step: cols, len: rows };
        match unit {
            0 => copy(difference, heights_m),
            1 => Self::means(Reach::Even(self.half_px), difference, along_rows, sums),
            2 => Self::means(Reach::Even(self.half_px), difference, along_cols, sums),
            3 => difference.iter_mut().zip(coarse_m).for_each(|(d, c)| *d -= c),
            _ if unit + 1 >= Self::UNITS => {
                for (z, d) in heights_m.iter_mut().zip(difference.iter()) {
                    *z -= self.weight * d;
                }
            }
            _ if unit.is_multiple_of(2) => Self::means(Reach::Cut(self.radius_px), difference, along_rows, sums),
            _ => Self::means(Reach::Cut(self.radius_px), difference, along_cols, sums),
        }
        Ok(())
    }

    /// Computes box means along all lines.
    fn means(reach: Reach, map: &mut [f32], lines: Lines, sums: &mut [f64]) {
        let mut line = 0;
        if sums.len() >= LINES * lines.len.saturating_add(1) {
            while line + LINES <= lines.count {
                Self::along::<LINES>(reach, map, lines, line, sums);
                line += LINES;
            }
        }
        (line..lines.count).for_each(|line| Self::along::<1>(reach, map, lines, line, sums));
    }

    /// Computes box means along `N` lines from one on.
    fn along<const N: usize>(reach: Reach, map: &mut [f32], lines: Lines, first: usize, sums: &mut [f64]) {
        let Lines { apart, step, len, .. } = lines;
        let (sums, first) = (sums.as_chunks_mut::<N>().0, first * apart);
        let mut sum = [0.0; N];
        put(sums, 0, sum);
        for i in 0..len {
            let at = first + i * step;
            // Lines side by side are contiguous.
            let values: [f32; N] =
                if apart == 1 { few(map, at) } else { core::array::from_fn(|n| item(map, at + n * apart)) };
            sum.iter_mut().zip(values).for_each(|(sum, v)| *sum += f64::from(v));
            put(sums, i + 1, sum);
        }
        for i in 0..len {
            let at = first + i * step;
            let (low, high) = reach.at(i, len);
            let [above, below] = [low, high].map(|i| sums.get(i).copied().unwrap_or([0.0; N]));
            let count = (high - low) as f64;
            let means: [f32; N] = core::array::from_fn(|n| ((below[n] - above[n]) / count) as f32);
            if apart == 1 {
                put_few(map, at, means);
            } else {
                means.into_iter().enumerate().for_each(|(n, mean)| put(map, at + n * apart, mean));
            }
        }
    }
}

/// How far a box reaches from its pixel, in pixels to either side.
#[derive(Debug, Clone, Copy)]
enum Reach {
    /// Near an edge as far to the one side as to the other.
    Even(usize),
    /// Near an edge to the edge.
    Cut(usize),
}

impl Reach {
    /// Returns the first pixel of a box about pixel `i` of a line of `len`, and that behind its last.
    fn at(self, i: usize, len: usize) -> (usize, usize) {
        let reach = match self {
            Self::Even(reach) => reach.min(i).min(len.saturating_sub(i + 1)),
            Self::Cut(reach) => reach,
        };
        (i.saturating_sub(reach), i.saturating_add(reach).saturating_add(1).min(len))
    }
}

/// Lines of a map: `count` of them, whose first values are `apart` from each other; each has `len` values, `step` from each other.
#[derive(Debug, Clone, Copy)]
struct Lines {
    apart: usize,
    count: usize,
    step: usize,
    len: usize,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn anchored(coarse_px: f32, heights_m: &[f32], coarse_m: &[f32], cols: usize) -> Vec<f32> {
        let mut out = heights_m.to_vec();
        let rows = heights_m.len() / cols;
        let (mut difference, mut sums) = (vec![0.0; out.len()], vec![0.0; Anchor::sums_len(rows, cols)]);
        Anchor::new(coarse_px).apply(&mut out, coarse_m, cols, &mut difference, &mut sums).unwrap();
        out
    }

    /// Returns the means over rectangles, by definition; `even`: as far to the one side as to the other.
    fn naive_box(map: &[f64], cols: usize, radius: usize, even: bool) -> Vec<f64> {
        let rows = map.len() / cols;
        let near = |a: usize, b: usize, len: usize| {
            a.abs_diff(b) <= if even { radius.min(a).min(len - 1 - a) } else { radius }
        };
        (0..map.len())
            .map(|i| {
                let inside =
                    (0..map.len()).filter(|j| near(i / cols, j / cols, rows) && near(i % cols, j % cols, cols));
                let (sum, n) = inside.fold((0.0, 0), |(sum, n), j| (sum + map[j], n + 1));
                assert!(n > 0 && rows > 0);
                sum / f64::from(n)
            })
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn boxes_by_definition(rows in 1_usize..9, cols in 1_usize..9, radius in 0_usize..5, seed in any::<u32>()) {
            let value = |i: usize| (seed.wrapping_mul(2654435761).wrapping_add(i as u32 * 40503) >> 16) as f32 / 64.0;
            let n = rows * cols;
            let (heights, coarse): (Vec<f32>, Vec<f32>) = ((0..n).map(value).collect(), (n..2 * n).map(value).collect());
            // Both widths are halves of a coarse pixel.
            let found = anchored(2.0 * radius as f32, &heights, &coarse, cols);
            let of_pixels = naive_box(&heights.iter().map(|z| f64::from(*z)).collect::<Vec<_>>(), cols, radius, true);
            let mut low: Vec<f64> = of_pixels.iter().zip(&coarse).map(|(z, c)| z - f64::from(*c)).collect();
            for _ in 0..BOXES {
                low = naive_box(&low, cols, radius, false);
            }
            for i in 0..n {
                // Four running sums in f32 of up to nine heights below 1024 m.
                prop_assert!((f64::from(found[i]) - (f64::from(heights[i]) - 0.7 * low[i])).abs() < 1e-2);
            }
        }
    }

    #[test]
    fn long_waves_are_weighed_and_short_ones_the_networks() {
        let (cols, coarse_px) = (320, 29.6);
        let wave = |length_px: f32| -> Vec<f32> {
            (0..256 * cols).map(|i| (core::f32::consts::TAU * (i % cols) as f32 / length_px).sin()).collect()
        };
        let kept = |length_px: f32| {
            let (heights, flat) = (wave(length_px), vec![0.0; 256 * cols]);
            let out = anchored(coarse_px, &heights, &flat, cols);
            // Columns away from the edges.
            (100..220).map(|c| out[c].abs()).fold(0.0, f32::max)
        };
        assert!(kept(20.0) > 0.98, "{}", kept(20.0));
        assert!((kept(320.0) - 0.3).abs() < 0.1, "{}", kept(320.0));
        // Half of the weight.
        assert!((kept(3.0 * coarse_px) - 0.65).abs() < 0.1, "{}", kept(3.0 * coarse_px));
    }

    #[test]
    fn a_slope_that_the_coarse_dtm_has_too_stays_up_to_the_edges() {
        let (rows, cols) = (40, 50);
        let slope: Vec<f32> = (0..rows * cols).map(|i| 0.3 * (i / cols) as f32 - 0.2 * (i % cols) as f32).collect();
        let out = anchored(16.0, &slope, &slope, cols);
        let off = out.iter().zip(&slope).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off < 1e-4, "{off}");
    }

    #[test]
    fn an_exact_coarse_dtm_changes_nothing() {
        // A wave of four coarse pixels, and its means over coarse pixels, as a coarse DTM has them: flatter by sin(x) / x.
        let (cols, coarse_px) = (320, 20.0_f32);
        let half = core::f32::consts::PI / 4.0;
        let wave: Vec<f32> = (0..64 * cols).map(|i| (half * (2.0 / coarse_px) * (i % cols) as f32).sin()).collect();
        let means: Vec<f32> = wave.iter().map(|z| z * half.sin() / half).collect();
        let out = anchored(coarse_px, &wave, &means, cols);
        let off = (100..220).map(|i| (out[i] - wave[i]).abs()).fold(0.0, f32::max);
        // The box has 21 pixels, not 20.
        assert!(off < 0.02, "{off}");
    }

    #[test]
    fn lines_side_by_side_have_the_same_bits() {
        for (rows, cols) in [(8, 16), (19, 37), (3, 40), (40, 3)] {
            let heights: Vec<f32> = (0..rows * cols).map(|i| ((i * 7919) % 613) as f32 * 0.37).collect();
            let coarse = vec![40.0; heights.len()];
            let one = anchored(5.0, &heights, &coarse, cols);
            let (mut many, mut difference) = (heights, vec![0.0; rows * cols]);
            let mut sums = vec![0.0; LINES * Anchor::sums_len(rows, cols)];
            Anchor::new(5.0).apply(&mut many, &coarse, cols, &mut difference, &mut sums).unwrap();
            assert!(one.iter().zip(&many).all(|(a, b)| a.to_bits() == b.to_bits()), "{rows} x {cols}");
        }
    }

    #[test]
    fn odd_sizes_and_buffers_are_refused_and_odd_ratios_harmless() {
        let anchor = Anchor::new(3.0);
        let (mut heights, coarse, mut scratch) = ([1.0_f32; 6], [0.0_f32; 6], [0.0_f32; 6]);
        assert!(anchor.apply(&mut heights, &coarse[..5], 3, &mut scratch, &mut [0.0; 4]).is_err());
        assert!(anchor.apply(&mut heights, &coarse, 4, &mut scratch, &mut [0.0; 9]).is_err());
        assert!(anchor.apply(&mut heights, &coarse, 0, &mut scratch, &mut [0.0; 9]).is_err());
        assert!(anchor.apply(&mut heights, &coarse, 3, &mut scratch, &mut [0.0; 3]).is_err());
        assert_eq!(heights, [1.0; 6]);
        let near = |found: Vec<f32>, expected: [f32; 2]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(near(anchored(f32::NAN, &[5.0, 7.0], &[1.0, 2.0], 2), [2.2, 3.5]));
        assert!(near(anchored(f32::MAX, &[5.0, 7.0], &[1.0, 2.0], 2), [1.85, 3.85]));
        anchor.apply(&mut heights, &coarse, 3, &mut scratch, &mut [0.0; 4]).unwrap();
        Anchor::whole(0.0).apply(&mut heights, &coarse, 3, &mut scratch, &mut [0.0; 4]).unwrap();
        assert_eq!(heights, [0.0; 6]);
    }
}
