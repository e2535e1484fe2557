//! Halving and doubling of maps.

use super::level::Level;

/// Smallest side of a level, pixels.
const SMALLEST_PX: usize = 16;

/// Returns the levels of a tile, finest first. There are fewer than `levels` if a level would become too small.
pub(super) fn pyramid(finest: Level, levels: usize) -> Vec<Level> {
    let mut all = vec![finest];
    while all.len() < levels {
        let Some(next) = all.last().and_then(halved) else { break };
        all.push(next);
    }
    all
}

/// Returns the level at half the resolution: means of 2 x 2 pixels, of fewer at an odd end. Brightness is the weighted mean.
fn halved(fine: &Level) -> Option<Level> {
    let (rows, cols) = (fine.rows.div_ceil(2), fine.cols.div_ceil(2));
    if rows < SMALLEST_PX || cols < SMALLEST_PX {
        return None;
    }
    let count = rows * cols;
    let (mut image, mut weight, mut coarse_m, mut pixels) =
        (vec![0.0; count], vec![0.0; count], vec![0.0; count], vec![0.0; count]);
    for row in 0..fine.rows {
        for col in 0..fine.cols {
            let (from, to) = (row * fine.cols + col, row / 2 * cols + col / 2);
            image[to] += fine.weight[from] * fine.image[from];
            weight[to] += fine.weight[from];
            coarse_m[to] += fine.coarse_m[from];
            pixels[to] += 1.0;
        }
    }
    for i in 0..count {
        let (row, col) = (i / cols, i % cols);
        let ring = row == 0 || col == 0 || row + 1 == rows || col + 1 == cols;
        image[i] = if weight[i] > 0.0 { image[i] / weight[i] } else { 0.0 };
        weight[i] = if ring { 0.0 } else { weight[i] / pixels[i] };
        coarse_m[i] /= pixels[i];
    }
    Some(Level { rows, cols, row_m: 2.0 * fine.row_m, col_m: 2.0 * fine.col_m, image, weight, coarse_m })
}

/// Interpolates a map of half the resolution bilinearly. Beyond the outermost pixel centres it extrapolates linearly.
pub(super) fn doubled(half: &[f64], half_cols: usize, rows: usize, cols: usize) -> Vec<f64> {
    let half_rows = half.len() / half_cols;
    // Centres of fine pixels lie a quarter of a coarse pixel before and behind the centres of coarse pixels.
    let at = |i: usize, count: usize| {
        let position = 0.5 * i as f64 - 0.25;
        let first = (position.floor().max(0.0) as usize).min(count - 2);
        (first, position - first as f64)
    };
    let mut out = Vec::with_capacity(rows * cols);
    for row in 0..rows {
        let (top, down) = at(row, half_rows);
        for col in 0..cols {
            let (left, right) = at(col, half_cols);
            let line = |r: usize| {
                let [a, b] = [half[r * half_cols + left], half[r * half_cols + left + 1]];
                a + right * (b - a)
            };
            let (a, b) = (line(top), line(top + 1));
            out.push(a + down * (b - a));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(rows: usize, cols: usize) -> Level {
        let value = |i: usize| 3.0 * (i / cols) as f64 - 2.0 * (i % cols) as f64;
        let heights: Vec<f64> = (0..rows * cols).map(value).collect();
        let weight = vec![1.0; rows * cols];
        Level { rows, cols, row_m: 2.0, col_m: 1.5, image: heights.clone(), weight, coarse_m: heights }
    }

    #[test]
    fn planes_survive_the_way_up_and_down() {
        let levels = pyramid(plane(64, 80), 9);
        let sizes: Vec<_> = levels.iter().map(|level| (level.rows, level.cols, level.row_m, level.col_m)).collect();
        assert_eq!(sizes, [(64, 80, 2.0, 1.5), (32, 40, 4.0, 3.0), (16, 20, 8.0, 6.0)]);
        let back = doubled(&levels[1].coarse_m, 40, 64, 80);
        for (found, expected) in back.iter().zip(&levels[0].coarse_m) {
            assert!((found - expected).abs() < 1e-9);
        }
    }

    #[test]
    fn odd_sizes_keep_every_pixel_and_shadows_do_not_darken() {
        let mut fine = plane(35, 41);
        fine.image = (0..35 * 41).map(|i| if i % 3 == 0 { 0.0 } else { 5.0 }).collect();
        fine.weight = fine.image.iter().map(|v| v / 5.0).collect();
        let half = halved(&fine).unwrap();
        assert_eq!((half.rows, half.cols), (18, 21));
        let inner = |i: &usize| (1..17).contains(&(i / 21)) && (1..20).contains(&(i % 21));
        for i in (0..18 * 21).filter(inner) {
            assert_eq!(half.image[i], 5.0);
            assert!(half.weight[i] > 0.4 && half.weight[i] < 1.0);
        }
        assert!((0..18 * 21).filter(|i| !inner(i)).all(|i| half.weight[i] == 0.0));
        assert_eq!(half.coarse_m[20], fine.coarse_m[40] + 1.5);
    }
}
