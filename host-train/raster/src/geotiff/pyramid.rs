//! The levels of a file: full resolution and overviews. They are filled from top to bottom; each keeps a band of rows in memory.

use rayon::prelude::*;

/// One level: its size, and the rows that are not yet written.
#[derive(Debug)]
pub(super) struct Level {
    pub(super) rows: usize,
    pub(super) cols: usize,
    /// Whole rows, at most [`BLOCK_PX`].
    pub(super) band: Vec<f32>,
    /// Offset and length of each written block in the spill, row by row.
    pub(super) blocks: Vec<(u64, u64)>,
}

/// Block side, pixels: the default of GDAL's COG driver.
pub(super) const BLOCK_PX: usize = 512;

impl Level {
    fn new(rows: usize, cols: usize) -> Self {
        Self { rows, cols, band: vec![], blocks: vec![] }
    }

    /// Returns the rows and columns of a block. Sides must be multiples of 16. A raster smaller than a block has one that is just large
    /// enough.
    pub(super) fn block(&self) -> (usize, usize) {
        (BLOCK_PX.min(self.rows.next_multiple_of(16)), BLOCK_PX.min(self.cols.next_multiple_of(16)))
    }
}

/// Returns the levels: full resolution first, each further level half as large (rounded up), until both sides fit one block.
pub(super) fn levels(rows: usize, cols: usize) -> Vec<Level> {
    let mut levels = vec![Level::new(rows, cols)];
    while let Some(last) = levels.last().filter(|last| last.rows > BLOCK_PX || last.cols > BLOCK_PX) {
        levels.push(Level::new(last.rows.div_ceil(2), last.cols.div_ceil(2)));
    }
    levels
}

/// Returns the mean of the valid samples in each 2 x 2 samples of `band` (rows of `cols`); NaN without valid samples.
pub(super) fn halve(band: &[f32], cols: usize) -> Vec<f32> {
    let mut out = vec![f32::NAN; (band.len() / cols).div_ceil(2) * cols.div_ceil(2)];
    let lines = out.par_chunks_mut(cols.div_ceil(2)).zip(band.par_chunks(2 * cols));
    lines.for_each(|(line, pair)| {
        let (upper, lower) = pair.split_at(cols);
        for (mean, col) in line.iter_mut().zip((0..cols).step_by(2)) {
            let beside = col..(col + 2).min(cols);
            let both = upper[beside.clone()].iter().chain(lower.get(beside).unwrap_or(&[]));
            let (sum, count) =
                both.filter(|v| v.is_finite()).fold((0.0_f64, 0), |(sum, count), &v| (sum + f64::from(v), count + 1));
            *mean = if count == 0 { f32::NAN } else { (sum / f64::from(count)) as f32 };
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_shrink_to_one_block() {
        let sizes = |rows, cols| levels(rows, cols).iter().map(|l| (l.rows, l.cols)).collect::<Vec<_>>();
        assert_eq!(sizes(512, 512), [(512, 512)]);
        assert_eq!(sizes(513, 10), [(513, 10), (257, 5)]);
        assert_eq!(sizes(50_000, 5_000).last(), Some(&(391, 40)));
    }

    #[test]
    fn means_leave_gaps_out() {
        let nan = f32::NAN;
        let out = halve(&[1.0, 3.0, nan, 5.0, 7.0, nan, 2.0, nan, nan], 3);
        // Rows of three: (1 3 nan), (5 7 nan), (2 nan nan).
        assert_eq!(out[0], 4.0);
        assert_eq!(out[2], 2.0);
        assert!(out[1].is_nan() && out[3].is_nan() && out.len() == 4);
    }
}
