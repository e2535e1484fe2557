//! One level of the pyramid: its maps, the cost of a departure from them, and the derivatives of the cost.

use super::reflectance::SfsLight;

/// Image and coarse DTM at one resolution, row-major.
#[derive(Debug, Clone)]
pub(super) struct Level {
    /// Rows; at least 3.
    pub(super) rows: usize,
    /// Columns; at least 3.
    pub(super) cols: usize,
    /// Distance from one row to the next, metres.
    pub(super) row_m: f64,
    /// Distance from one column to the next, metres.
    pub(super) col_m: f64,
    /// Brightness, relative to its mean.
    pub(super) image: Vec<f64>,
    /// Weight of each pixel's brightness, 0 to 1. It is 0 on the outermost ring, where slopes would need pixels beyond the level.
    pub(super) weight: Vec<f64>,
    /// Heights of the coarse DTM, metres.
    pub(super) coarse_m: Vec<f64>,
}

/// The function of the heights z that is minimised:
///
/// Σ w (I − A R)² + Σ smoothness² (z_xx² + 2 z_xy² + z_yy²) + Σ dem² (z − coarse)²
///
/// This is the form of the Ames Stereo Pipeline's `sfs`. I is relative to its mean, A is the best scalar for each z, and R uses central
/// differences. Only second differences that lie within the grid count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Objective {
    pub(super) light: SfsLight,
    /// Weight of the second derivatives, metres (second derivatives are per metre).
    pub(super) smoothness_m: f64,
    /// Weight of the departure from the coarse DTM, per metre.
    pub(super) dem_per_m: f64,
}

/// The terms of the cost at given heights, sums over all pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Cost {
    pub(super) brightness: f64,
    pub(super) smoothness: f64,
    pub(super) dem: f64,
    /// The best A.
    pub(super) exposure: f64,
}

impl Cost {
    pub(super) fn total(&self) -> f64 {
        self.brightness + self.smoothness + self.dem
    }
}

/// The quadratic model of the cost around given heights (Gauss–Newton).
pub(super) struct LevelModel {
    rows: usize,
    cols: usize,
    /// √w A ∂R/∂z across and down, for differences over two pixels.
    across: Vec<f64>,
    down: Vec<f64>,
    /// √w R as a unit vector, and its product with the transposed derivative. A absorbs this part of any change.
    unit: Vec<f64>,
    unit_back: Vec<f64>,
    bends: Bends,
    dem: f64,
    /// Half the cost's gradient.
    pub(super) gradient: Vec<f64>,
    /// Diagonal of the model's matrix. The smoothness term is exact only away from the edges.
    pub(super) diagonal: Vec<f64>,
}

/// Squared weights of the three second differences.
#[derive(Debug, Clone, Copy)]
struct Bends {
    across: f64,
    mixed: f64,
    down: f64,
}

impl Objective {
    fn bends(&self, level: &Level) -> Bends {
        let weight = self.smoothness_m.powi(2);
        let (x, y) = (level.col_m, level.row_m);
        Bends { across: weight / x.powi(4), mixed: 2.0 * weight / (4.0 * x * y).powi(2), down: weight / y.powi(4) }
    }

    /// Calls `at(index, shade)` for every pixel with weight.
    fn shades(&self, level: &Level, heights_m: &[f64], mut at: impl FnMut(usize, super::reflectance::Shade)) {
        let cols = level.cols;
        let (per_col, per_row) = (0.5 / level.col_m, 0.5 / level.row_m);
        for i in cols..(level.rows - 1) * cols {
            if level.weight[i] > 0.0 {
                let east = (heights_m[i + 1] - heights_m[i - 1]) * per_col;
                let south = (heights_m[i + cols] - heights_m[i - cols]) * per_row;
                at(i, self.light.shade(east, south));
            }
        }
    }

    /// Returns the cost of given heights.
    pub(super) fn cost(&self, level: &Level, heights_m: &[f64]) -> Cost {
        let (mut ii, mut ir, mut rr) = (0.0, 0.0, 0.0);
        self.shades(level, heights_m, |i, shade| {
            let (weight, image) = (level.weight[i], level.image[i]);
            ii += weight * image * image;
            ir += weight * image * shade.value;
            rr += weight * shade.value * shade.value;
        });
        let exposure = if rr > 0.0 { ir / rr } else { 0.0 };
        let departure = heights_m.iter().zip(&level.coarse_m).map(|(z, coarse)| (z - coarse).powi(2)).sum::<f64>();
        Cost {
            // The part of I that is not along R.
            brightness: (ii - exposure * ir).max(0.0),
            smoothness: bending(heights_m, level.rows, level.cols, self.bends(level)),
            dem: self.dem_per_m.powi(2) * departure,
            exposure,
        }
    }

    /// Returns the quadratic model around given heights. A is eliminated (variable projection, Kaufman's form): a change of R along R
    /// itself has no cost.
    pub(super) fn model(&self, level: &Level, heights_m: &[f64], exposure: f64) -> LevelModel {
        let (rows, cols, count) = (level.rows, level.cols, level.rows * level.cols);
        let (per_col, per_row) = (0.5 / level.col_m, 0.5 / level.row_m);
        let zeros = || vec![0.0; count];
        let (mut across, mut down, mut unit, mut residual) = (zeros(), zeros(), zeros(), zeros());
        self.shades(level, heights_m, |i, shade| {
            let root = level.weight[i].sqrt();
            across[i] = root * exposure * shade.by_east * per_col;
            down[i] = root * exposure * shade.by_south * per_row;
            unit[i] = root * shade.value;
            residual[i] = root * (exposure * shade.value - level.image[i]);
        });
        let length = dot(&unit, &unit).sqrt();
        if length > 0.0 {
            unit.iter_mut().for_each(|u| *u /= length);
        }
        let (bends, dem) = (self.bends(level), self.dem_per_m.powi(2));
        let mut model = LevelModel {
            rows,
            cols,
            across,
            down,
            unit,
            unit_back: zeros(),
            bends,
            dem,
            gradient: zeros(),
            diagonal: zeros(),
        };
        let mut back = zeros();
        model.scatter(&model.unit, &mut back);
        model.unit_back = back;
        let mut gradient = zeros();
        model.scatter(&residual, &mut gradient);
        add_bends(heights_m, rows, cols, bends, &mut gradient);
        for ((g, z), coarse) in gradient.iter_mut().zip(heights_m).zip(&level.coarse_m) {
            *g += dem * (z - coarse);
        }
        model.gradient = gradient;
        model.diagonal = model.diagonal();
        model
    }
}

impl LevelModel {
    /// Adds the transposed derivative of brightness times `values` to `out`. `values` are 0 on the outermost ring.
    fn scatter(&self, values: &[f64], out: &mut [f64]) {
        let cols = self.cols;
        for row in 1..self.rows - 1 {
            let here = row * cols..(row + 1) * cols;
            let (a, d, v) = (&self.across[here.clone()], &self.down[here.clone()], &values[here]);
            scatter_row(a, d, v, &mut out[(row - 1) * cols..(row + 2) * cols], cols);
        }
    }

    /// Sets `out` to the matrix times `p`.
    pub(super) fn apply(&self, p: &[f64], out: &mut [f64]) {
        let cols = self.cols;
        for (out, p) in out.iter_mut().zip(p) {
            *out = self.dem * p;
        }
        add_bends(p, self.rows, cols, self.bends, out);
        let mut change = vec![0.0; cols];
        let mut along = 0.0;
        for row in 1..self.rows - 1 {
            let here = row * cols..(row + 1) * cols;
            let (a, d) = (&self.across[here.clone()], &self.down[here.clone()]);
            let (above, middle, below) = three(p, row, cols);
            let inner = cols - 2;
            let (left, right) = (&middle[..inner], &middle[2..][..inner]);
            let (up, low) = (&above[1..][..inner], &below[1..][..inner]);
            let (a1, d1, change1) = (&a[1..][..inner], &d[1..][..inner], &mut change[1..][..inner]);
            for i in 0..inner {
                change1[i] = a1[i] * (right[i] - left[i]) + d1[i] * (low[i] - up[i]);
            }
            along += dot(&change, &self.unit[here]);
            scatter_row(a, d, &change, &mut out[(row - 1) * cols..(row + 2) * cols], cols);
        }
        for (out, back) in out.iter_mut().zip(&self.unit_back) {
            *out -= along * back;
        }
    }

    fn diagonal(&self) -> Vec<f64> {
        let cols = self.cols;
        let Bends { across, mixed, down } = self.bends;
        let mut out = vec![self.dem + 6.0 * across + 4.0 * mixed + 6.0 * down; self.rows * cols];
        for i in cols..(self.rows - 1) * cols {
            let (a, d) = (self.across[i].powi(2), self.down[i].powi(2));
            out[i - 1] += a;
            out[i + 1] += a;
            out[i - cols] += d;
            out[i + cols] += d;
        }
        out
    }
}

/// Computes one row of [`LevelModel::scatter`]. `out` holds the row above, the row itself and the row below.
fn scatter_row(across: &[f64], down: &[f64], values: &[f64], out: &mut [f64], cols: usize) {
    let (above, rest) = out.split_at_mut(cols);
    let (middle, below) = rest.split_at_mut(cols);
    let (across, down, values) = (&across[..cols], &down[..cols], &values[..cols]);
    for i in 0..cols {
        let step = down[i] * values[i];
        above[i] -= step;
        below[i] += step;
    }
    // The sum is gathered per output pixel. Values on the ring are 0, so only inner values contribute.
    let inner = cols - 2;
    let (al, vl, ar, vr) = (&across[..inner], &values[..inner], &across[2..][..inner], &values[2..][..inner]);
    let here = &mut middle[1..][..inner];
    for i in 0..inner {
        here[i] += al[i] * vl[i] - ar[i] * vr[i];
    }
    middle[0] -= across[1] * values[1];
    middle[cols - 1] += across[cols - 2] * values[cols - 2];
}

fn three(p: &[f64], row: usize, cols: usize) -> (&[f64], &[f64], &[f64]) {
    (&p[(row - 1) * cols..][..cols], &p[row * cols..][..cols], &p[(row + 1) * cols..][..cols])
}

/// Computes second differences along a row, 0 at its ends.
fn bend_across(line: &[f64], out: &mut [f64]) {
    let inner = line.len() - 2;
    let (l, m, r) = (&line[..inner], &line[1..][..inner], &line[2..][..inner]);
    let out = &mut out[1..][..inner];
    for i in 0..inner {
        out[i] = l[i] - 2.0 * m[i] + r[i];
    }
}

/// Returns the weighted sum of squared second differences.
fn bending(p: &[f64], rows: usize, cols: usize, bends: Bends) -> f64 {
    let mut line = vec![0.0; cols];
    let (mut across, mut mixed, mut down) = (0.0, 0.0, 0.0);
    for row in 0..rows {
        bend_across(&p[row * cols..][..cols], &mut line);
        across += dot(&line, &line);
        if row > 0 && row + 1 < rows {
            let (above, middle, below) = three(p, row, cols);
            for i in 0..cols {
                down += (above[i] - 2.0 * middle[i] + below[i]).powi(2);
            }
            for i in 1..cols - 1 {
                mixed += (below[i + 1] - below[i - 1] - above[i + 1] + above[i - 1]).powi(2);
            }
        }
    }
    bends.across * across + bends.mixed * mixed + bends.down * down
}

/// Adds half the gradient of [`bending`] at `p` to `out`.
fn add_bends(p: &[f64], rows: usize, cols: usize, bends: Bends, out: &mut [f64]) {
    let inner = cols - 2;
    let mut line = vec![0.0; cols];
    let mut mixed = vec![0.0; cols];
    for row in 0..rows {
        bend_across(&p[row * cols..][..cols], &mut line);
        let here = &mut out[row * cols..][..cols];
        here[0] += bends.across * line[1];
        here[cols - 1] += bends.across * line[cols - 2];
        let (l, m, r) = (&line[..inner], &line[1..][..inner], &line[2..][..inner]);
        let here = &mut here[1..][..inner];
        for i in 0..inner {
            here[i] += bends.across * (l[i] - 2.0 * m[i] + r[i]);
        }
        if row == 0 || row + 1 == rows {
            continue;
        }
        let (above, middle, below) = three(p, row, cols);
        mixed[1..cols - 1]
            .iter_mut()
            .zip(below[2..].iter().zip(below))
            .zip(above[2..].iter().zip(above))
            .for_each(|((mixed, (br, bl)), (ar, al))| *mixed = bends.mixed * (br - bl - ar + al));
        let (out_above, rest) = out[(row - 1) * cols..(row + 2) * cols].split_at_mut(cols);
        let (out_middle, out_below) = rest.split_at_mut(cols);
        for i in 0..cols {
            let bend = bends.down * (above[i] - 2.0 * middle[i] + below[i]);
            out_above[i] += bend;
            out_middle[i] -= 2.0 * bend;
            out_below[i] += bend;
        }
        // The operator equals its transpose up to the sign: here a column gets the values of its neighbours.
        out_below[0] -= mixed[1];
        out_above[0] += mixed[1];
        out_below[cols - 1] += mixed[cols - 2];
        out_above[cols - 1] -= mixed[cols - 2];
        let (left, right) = (&mixed[..inner], &mixed[2..][..inner]);
        let (out_above, out_below) = (&mut out_above[1..][..inner], &mut out_below[1..][..inner]);
        for i in 0..inner {
            let bend = left[i] - right[i];
            out_below[i] += bend;
            out_above[i] -= bend;
        }
    }
}

/// Returns the sum of products. Eight running sums make it fast; the order of additions is always the same.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (a, b) in a8.iter().zip(b8) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 9;
    const COLS: usize = 11;

    /// Returns irregular values in [-1, 1].
    fn rough(seed: usize) -> Vec<f64> {
        let value = |i: usize| ((i * 7919 + seed * 104_729 + i * i * 31) % 2003) as f64 / 1001.0 - 1.0;
        (0..ROWS * COLS).map(value).collect()
    }

    fn level() -> Level {
        let inner = |i: usize| (1..ROWS - 1).contains(&(i / COLS)) && (1..COLS - 1).contains(&(i % COLS));
        let weight = (0..ROWS * COLS).map(|i| if inner(i) { [1.0, 0.0, 0.4, 1.0][i % 4] } else { 0.0 });
        Level {
            rows: ROWS,
            cols: COLS,
            row_m: 2.0,
            col_m: 1.5,
            image: rough(1).iter().map(|v| 1.0 + 0.3 * v).collect(),
            weight: weight.collect(),
            coarse_m: rough(2),
        }
    }

    fn objective() -> Objective {
        Objective { light: SfsLight::new(200.0, 35.0).unwrap(), smoothness_m: 0.7, dem_per_m: 0.2 }
    }

    #[test]
    fn the_gradient_is_that_of_finite_differences() {
        let (level, objective, heights_m) = (level(), objective(), rough(3));
        let model = objective.model(&level, &heights_m, objective.cost(&level, &heights_m).exposure);
        let largest = model.gradient.iter().fold(0.0, |m: f64, g| m.max(g.abs()));
        let step = 1e-5;
        for i in 0..ROWS * COLS {
            let at = |change: f64| {
                let mut moved = heights_m.clone();
                moved[i] += change;
                objective.cost(&level, &moved).total()
            };
            let expected = 0.5 * (at(step) - at(-step)) / (2.0 * step);
            assert!((model.gradient[i] - expected).abs() < 1e-7 * largest, "{i}: {} {expected}", model.gradient[i]);
        }
    }

    #[test]
    fn the_matrix_is_gauss_and_newtons() {
        let (level, objective, heights_m, p) = (level(), objective(), rough(3), rough(4));
        let exposure = objective.cost(&level, &heights_m).exposure;
        let model = objective.model(&level, &heights_m, exposure);
        // Change of A R along p by finite differences, minus its part along R.
        let at = |change: f64| {
            let moved: Vec<f64> = heights_m.iter().zip(&p).map(|(z, p)| z + change * p).collect();
            let mut values = vec![0.0; p.len()];
            objective.shades(&level, &moved, |i, shade| values[i] = level.weight[i].sqrt() * shade.value);
            values
        };
        let step = 1e-5;
        let mut change: Vec<f64> =
            at(step).iter().zip(at(-step)).map(|(a, b)| exposure * (a - b) / (2.0 * step)).collect();
        let now = at(0.0);
        let share = dot(&change, &now) / dot(&now, &now);
        change.iter_mut().zip(&now).for_each(|(c, n)| *c -= share * n);
        let expected = dot(&change, &change) + bending(&p, ROWS, COLS, objective.bends(&level)) + 0.04 * dot(&p, &p);
        let mut image = vec![0.0; p.len()];
        model.apply(&p, &mut image);
        let found = dot(&p, &image);
        assert!((found - expected).abs() < 1e-8 * expected, "{found} {expected}");
        // The matrix is symmetric.
        let (q, mut other) = (rough(5), vec![0.0; p.len()]);
        model.apply(&q, &mut other);
        assert!((dot(&q, &image) - dot(&p, &other)).abs() < 1e-10 * expected);
        // The preconditioner's diagonal away from the edges, without the part that A absorbs.
        let i = 4 * COLS + 5;
        let mut one = vec![0.0; p.len()];
        one[i] = 1.0;
        model.apply(&one, &mut image);
        let expected = image[i] + model.unit_back[i].powi(2);
        assert!((model.diagonal[i] - expected).abs() < 1e-12, "{} {expected}", model.diagonal[i]);
    }

    #[test]
    fn planes_bend_nowhere_and_parabolas_as_computed() {
        let height = |f: fn(f64, f64) -> f64| -> Vec<f64> {
            (0..ROWS * COLS).map(|i| f(2.0 * (i / COLS) as f64, 1.5 * (i % COLS) as f64)).collect()
        };
        let level = level();
        let bends = Objective { smoothness_m: 1.0, ..objective() }.bends(&level);
        assert!(bending(&height(|y, x| 3.0 * x - y), ROWS, COLS, bends) < 1e-20);
        // z_xx = 2 on all rows except at their ends, z_xy = 3 inside, z_yy = -4.
        let expected = 4.0 * (ROWS * (COLS - 2)) as f64
            + 2.0 * 9.0 * ((ROWS - 2) * (COLS - 2)) as f64
            + 16.0 * ((ROWS - 2) * COLS) as f64;
        let found = bending(&height(|y, x| x * x + 3.0 * x * y - 2.0 * y * y), ROWS, COLS, bends);
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
    }
}
