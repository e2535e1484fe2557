//! Geometry of shifted windows: padding, shift, partition, mask, relative position index. It has no weights.

use burn::tensor::{Device, Int, Tensor, TensorData};

/// Arrangement of one block's windows on a token map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WindowPlan {
    /// Window side.
    pub window: usize,
    /// Token rows and columns padded (right and bottom) to whole windows.
    pub padded: [usize; 2],
    /// Cyclic shift per axis; 0 along an axis that one window covers.
    pub shift: [usize; 2],
}

impl WindowPlan {
    /// Returns the plan for `rows` x `cols` tokens.
    pub fn new(rows: usize, cols: usize, window: usize, shift: usize) -> Self {
        let padded = [rows.next_multiple_of(window), cols.next_multiple_of(window)];
        Self { window, padded, shift: padded.map(|n| if n > window { shift } else { 0 }) }
    }

    /// Returns whether there is a shift along any axis.
    pub fn shifted(&self) -> bool {
        self.shift != [0, 0]
    }

    /// Returns the region (of up to nine) of a shifted token. Tokens of different regions were not neighbours before the shift and must not
    /// attend to each other.
    pub fn region(&self, row: usize, col: usize) -> usize {
        let band = |i: usize, n: usize, shift: usize| match i {
            _ if i < n - self.window => 0,
            _ if i < n - shift => 1,
            _ => 2,
        };
        3 * band(row, self.padded[0], self.shift[0]) + band(col, self.padded[1], self.shift[1])
    }

    /// Returns the additive attention mask `[windows, 1, n, n]` (n = window²): 0 within a region, -100 across; `None` without a shift.
    pub fn mask(&self, device: &Device) -> Option<Tensor<4>> {
        if !self.shifted() {
            return None;
        }
        let (k, [rows, cols]) = (self.window, self.padded);
        let n = k * k;
        let mut data = Vec::with_capacity(rows * cols * n);
        for top in (0..rows).step_by(k) {
            for left in (0..cols).step_by(k) {
                let region: Vec<usize> = (0..n).map(|i| self.region(top + i / k, left + i % k)).collect();
                for a in &region {
                    data.extend(region.iter().map(|b| if a == b { 0.0f32 } else { -100.0 }));
                }
            }
        }
        Some(Tensor::from_data(TensorData::new(data, [rows * cols / n, 1, n, n]), device))
    }
}

/// Converts `[B, H, W, C]` to `[B * windows, k², C]`.
pub fn partition(x: Tensor<4>, k: usize) -> Tensor<3> {
    let [b, h, w, c] = x.dims();
    let x: Tensor<6> = x.reshape([b, h / k, k, w / k, k, c]);
    x.permute([0, 1, 3, 2, 4, 5]).reshape([b * (h / k) * (w / k), k * k, c])
}

/// Inverts [`partition`] for a `[B, H, W, C]` map.
pub fn merge(x: Tensor<3>, k: usize, [b, h, w]: [usize; 3]) -> Tensor<4> {
    let c = x.dims()[2];
    let x: Tensor<6> = x.reshape([b, h / k, w / k, k, k, c]);
    x.permute([0, 1, 3, 2, 4, 5]).reshape([b, h, w, c])
}

/// Returns the row of the relative position bias table for each (query, key) pair of a window: `[n * n]`.
pub fn relative_index(k: usize, device: &Device) -> Tensor<1, Int> {
    let n = k * k;
    let row = |p: usize| {
        let (q, key) = (p / n, p % n);
        let dy = q / k + k - 1 - key / k;
        let dx = q % k + k - 1 - key % k;
        (dy * (2 * k - 1) + dx) as i32
    };
    Tensor::from_data(TensorData::new((0..n * n).map(row).collect::<Vec<i32>>(), [n * n]), device)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_window_along_an_axis_is_not_shifted_there() {
        let plan = WindowPlan::new(7, 20, 7, 3);
        assert_eq!((plan.padded, plan.shift), ([7, 21], [0, 3]));
    }

    #[test]
    fn regions_split_where_the_shift_wraps() {
        let plan = WindowPlan::new(8, 8, 4, 2);
        let rows: Vec<usize> = (0..8).map(|r| plan.region(r, 0)).collect();
        assert_eq!(rows, [0, 0, 0, 0, 3, 3, 6, 6]);
    }
}
