//! Fills voids smoothly, so that a map with voids has a spectrum.

/// Relaxation sweeps at each level.
const SWEEPS: usize = 8;

/// Fills the values of a `rows` x `cols` map that are not finite, from coarse to fine: means over 2 x 2 pixels are filled first, spread into
/// the voids of the next finer level, and relaxed towards the mean of their neighbours.
///
/// The result is linear in the valid values. Maps of the same voids are therefore filled alike: a multiple of a map is filled by the same
/// multiple. Without any valid value the result is 0.
pub(super) fn fill(map: &mut [f64], rows: usize, cols: usize) {
    let voids: Vec<usize> = (0..map.len()).filter(|i| !map[*i].is_finite()).collect();
    if voids.is_empty() {
        return;
    }
    if voids.len() == map.len() {
        map.fill(0.0);
        return;
    }
    let (half_rows, half_cols) = (rows.div_ceil(2), cols.div_ceil(2));
    let mut sums = vec![(0.0, 0.0); half_rows * half_cols];
    for (i, v) in map.iter().enumerate().filter(|(_, v)| v.is_finite()) {
        let (sum, count) = &mut sums[i / cols / 2 * half_cols + i % cols / 2];
        (*sum, *count) = (*sum + v, *count + 1.0);
    }
    let mut half: Vec<f64> = sums.iter().map(|(sum, count)| sum / count).collect();
    fill(&mut half, half_rows, half_cols);
    voids.iter().for_each(|i| map[*i] = half[i / cols / 2 * half_cols + i % cols / 2]);
    for _ in 0..SWEEPS {
        for &i in &voids {
            let (row, col) = (i / cols, i % cols);
            let near = [
                (row > 0).then(|| i - cols),
                (row + 1 < rows).then_some(i + cols),
                (col > 0).then(|| i - 1),
                (col + 1 < cols).then_some(i + 1),
            ];
            let (sum, count) = near.iter().flatten().fold((0.0, 0.0), |(sum, count), &j| (sum + map[j], count + 1.0));
            map[i] = sum / count;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voids_are_filled_smoothly_linearly_and_alone() {
        let (rows, cols) = (40, 57);
        let hill = |i: usize| 30.0 + (i / cols) as f64 * 0.5 + ((i % cols) as f64 * 0.1).sin() * 4.0;
        let hole = |i: usize| (12..20).contains(&(i / cols)) && (20..31).contains(&(i % cols)) || i % cols > 54;
        let holed = |factor: f64| -> Vec<f64> {
            (0..rows * cols).map(|i| if hole(i) { f64::NAN } else { factor * hill(i) }).collect()
        };
        let (mut once, mut thrice) = (holed(1.0), holed(3.0));
        fill(&mut once, rows, cols);
        fill(&mut thrice, rows, cols);
        for i in 0..rows * cols {
            assert!((3.0 * once[i] - thrice[i]).abs() < 1e-9);
            // A plane is filled exactly in the limit; the hole's curvature is missed.
            assert!((once[i] - hill(i)).abs() < if hole(i) { 1.5 } else { 1e-12 }, "{i}: {} {}", once[i], hill(i));
        }
        let mut nothing = vec![f64::NAN; 12];
        fill(&mut nothing, 3, 4);
        assert_eq!(nothing, [0.0; 12]);
    }
}
