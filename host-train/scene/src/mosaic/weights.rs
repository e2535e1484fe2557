//! The weight of a tile at each of its pixels.

use elunar_core::overlap;

/// Rules by which `dem_mosaic` computes weights from the distance to the nearest gap or edge. The default is that of `dem_mosaic`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WeightRules {
    /// Number of pixels removed at every edge and gap (`--erode-length`).
    pub erode_px: u32,
    /// Standard deviation of the Gaussian blur of the weights, pixels; 0 for none (`--weights-blur-sigma`).
    pub blur_sigma_px: f64,
    /// Exponent of the weights, at least 1 (`--weights-exponent`).
    pub exponent: i32,
}

impl Default for WeightRules {
    fn default() -> Self {
        Self { erode_px: 0, blur_sigma_px: overlap::SIGMA_PX, exponent: 2 }
    }
}

impl WeightRules {
    /// Returns the weights of a tile, row-major `rows` x `cols`: 0 where `valid` is false or eroded, positive elsewhere.
    ///
    /// # Panics
    /// If `valid` does not hold `rows * cols` values.
    #[must_use]
    pub fn weights(&self, valid: &[bool], rows: usize, cols: usize) -> Vec<f64> {
        self.of_distance(grassfire(valid, rows, cols), rows, cols, self.erode_px)
    }

    /// Returns the weights of a tile that has already been eroded.
    pub(super) fn weights_of_eroded(&self, valid: &[bool], rows: usize, cols: usize) -> Vec<f64> {
        self.of_distance(grassfire(valid, rows, cols), rows, cols, 0)
    }

    fn of_distance(&self, distance: Vec<u32>, rows: usize, cols: usize, erode_px: u32) -> Vec<f64> {
        let clamped = |d: u32| f64::from(d.min(self.farthest_px()).saturating_sub(erode_px));
        let distance: Vec<f64> = distance.into_iter().map(clamped).collect();
        let blurred =
            if self.blur_sigma_px > 0.0 { blur(&distance, rows, cols, &self.kernel()) } else { distance.clone() };
        let weight = |(blurred, distance): (f64, f64)| if distance > 0.0 { blurred.powi(self.exponent) } else { 0.0 };
        blurred.into_iter().zip(distance).map(weight).collect()
    }

    /// Returns the distance beyond which weights do not change, pixels: erosion plus [`overlap::farthest_px`]. It is 271 by default. No
    /// pixel of a 256 x 320 tile is that far from an edge.
    #[must_use]
    pub fn farthest_px(&self) -> u32 {
        self.erode_px + overlap::farthest_px(self.taps())
    }

    /// Returns the number of taps of the blur.
    pub(super) fn taps(&self) -> usize {
        overlap::taps(self.blur_sigma_px)
    }

    /// Returns one side of the blur's symmetric kernel, centre first.
    fn kernel(&self) -> Vec<f64> {
        let mut kernel = vec![0.0; self.taps() / 2 + 1];
        overlap::half_kernel(self.blur_sigma_px, &mut kernel);
        kernel
    }
}

/// Returns the Manhattan distance (steps over 4 neighbours) to the nearest invalid pixel. Pixels beyond the border are invalid, so a valid
/// pixel at the edge has 1.
pub(super) fn grassfire(valid: &[bool], rows: usize, cols: usize) -> Vec<u32> {
    assert_eq!(valid.len(), rows * cols, "a mask of {rows} x {cols}");
    let mut distance = vec![0; rows * cols];
    // A forward pass from the upper and left neighbours, then a backward pass from the lower and right ones. This is exact for the
    // Manhattan distance.
    for row in 0..rows {
        for col in 0..cols {
            let i = row * cols + col;
            if valid[i] {
                let up = if row > 0 { distance[i - cols] } else { 0 };
                let left = if col > 0 { distance[i - 1] } else { 0 };
                distance[i] = 1 + up.min(left);
            }
        }
    }
    for row in (0..rows).rev() {
        for col in (0..cols).rev() {
            let i = row * cols + col;
            if valid[i] {
                let down = if row + 1 < rows { distance[i + cols] } else { 0 };
                let right = if col + 1 < cols { distance[i + 1] } else { 0 };
                distance[i] = distance[i].min(1 + down.min(right));
            }
        }
    }
    distance
}

/// Applies a separable Gaussian blur with zeros beyond the border.
fn blur(values: &[f64], rows: usize, cols: usize, kernel: &[f64]) -> Vec<f64> {
    // Columns of the transpose are rows of the original, so one routine does both directions.
    let along_rows = transpose(&blur_down(values, rows, cols, kernel), rows, cols);
    transpose(&blur_down(&along_rows, cols, rows, kernel), cols, rows)
}

fn blur_down(values: &[f64], rows: usize, cols: usize, kernel: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; rows * cols];
    for row in 0..rows {
        let target = &mut out[row * cols..][..cols];
        let first = row.saturating_sub(kernel.len() - 1);
        for source in first..rows.min(row + kernel.len()) {
            let weight = kernel[row.abs_diff(source)];
            target.iter_mut().zip(&values[source * cols..][..cols]).for_each(|(t, v)| *t += weight * v);
        }
    }
    out
}

fn transpose(values: &[f64], rows: usize, cols: usize) -> Vec<f64> {
    let mut out = vec![0.0; rows * cols];
    for row in 0..rows {
        for col in 0..cols {
            out[col * rows + row] = values[row * cols + col];
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Computes the distance by its definition, over all pairs.
    fn naive_grassfire(valid: &[bool], rows: usize, cols: usize) -> Vec<u32> {
        let outside = |r: i64, c: i64| r < 0 || c < 0 || r >= rows as i64 || c >= cols as i64;
        let nearest = |row: i64, col: i64| {
            let mut nearest = u32::MAX;
            for r in -1..=rows as i64 {
                for c in -1..=cols as i64 {
                    if outside(r, c) || !valid[r as usize * cols + c as usize] {
                        nearest = nearest.min(((r - row).abs() + (c - col).abs()) as u32);
                    }
                }
            }
            nearest
        };
        (0..rows * cols).map(|i| nearest((i / cols) as i64, (i % cols) as i64)).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn two_passes_are_the_distance(rows in 1_usize..14, cols in 1_usize..14, seed in any::<u64>(), share in 0.0..1.0_f64) {
            let mut state = seed;
            let mut next = || { state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407); (state >> 33) as f64 / 2f64.powi(31) };
            let valid: Vec<bool> = (0..rows * cols).map(|_| next() < share).collect();
            prop_assert_eq!(grassfire(&valid, rows, cols), naive_grassfire(&valid, rows, cols));
            let weights = WeightRules::default().weights(&valid, rows, cols);
            for (weight, valid) in weights.iter().zip(&valid) {
                prop_assert_eq!(*weight > 0.0, *valid);
            }
        }
    }

    #[test]
    fn blur_is_the_two_dimensional_sum() {
        let (rows, cols) = (23, 40);
        let values: Vec<f64> = (0..rows * cols).map(|i| ((i * 37) % 101) as f64).collect();
        let kernel = WeightRules::default().kernel();
        let blurred = blur(&values, rows, cols, &kernel);
        assert_eq!(kernel.len(), 18);
        for (i, found) in blurred.iter().enumerate() {
            let mut expected = 0.0;
            for r in 0..rows {
                for c in 0..cols {
                    let (dr, dc) = ((i / cols).abs_diff(r), (i % cols).abs_diff(c));
                    if dr < kernel.len() && dc < kernel.len() {
                        expected += kernel[dr] * kernel[dc] * values[r * cols + c];
                    }
                }
            }
            assert!((found - expected).abs() < 1e-10, "{i}: {found} {expected}");
        }
    }

    #[test]
    fn erosion_and_exponent_are_those_asked_for() {
        let rules = WeightRules { erode_px: 2, blur_sigma_px: 0.0, exponent: 3 };
        let weights = rules.weights(&[true; 49], 7, 7);
        assert_eq!((weights[8], weights[16], weights[24]), (0.0, 1.0, 8.0));
        let far = rules.weights(&vec![true; 601 * 601], 601, 601);
        assert_eq!(far[300 * 601 + 300], f64::from(rules.farthest_px() - 2).powi(3));
        assert_eq!(WeightRules::default().farthest_px(), 271);
    }
}
