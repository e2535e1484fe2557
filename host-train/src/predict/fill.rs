//! Closing gaps, so that the network never meets a hole: it sees plausible ground, and the result is masked again afterwards.

use std::collections::VecDeque;

/// Gives every invalid (not finite) sample the value of the valid sample nearest to it in steps over 4 neighbours; the earlier in
/// reading order where several are as near. Without a valid sample nothing changes.
pub(super) fn fill_gaps(samples: &mut [f32], rows: usize, cols: usize) {
    // Only valid samples beside a gap can spread, which keeps the queue short.
    let beside_gap = |samples: &[f32], i: usize| neighbours(i, rows, cols).any(|n| !samples[n].is_finite());
    let mut queue: VecDeque<usize> =
        (0..samples.len()).filter(|&i| samples[i].is_finite() && beside_gap(samples, i)).collect();
    while let Some(i) = queue.pop_front() {
        for n in neighbours(i, rows, cols) {
            if !samples[n].is_finite() {
                samples[n] = samples[i];
                queue.push_back(n);
            }
        }
    }
}

fn neighbours(i: usize, rows: usize, cols: usize) -> impl Iterator<Item = usize> {
    let (row, col) = (i / cols, i % cols);
    let near = [
        (row > 0).then(|| i - cols),
        (col > 0).then(|| i - 1),
        (col + 1 < cols).then_some(i + 1),
        (row + 1 < rows).then_some(i + cols),
    ];
    near.into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_take_the_nearest_value() {
        let gap = f32::NAN;
        let mut samples = [1.0, gap, gap, gap, 5.0, gap, gap, gap, gap, 9.0];
        fill_gaps(&mut samples, 2, 5);
        assert_eq!(samples, [1.0, 1.0, 1.0, 5.0, 5.0, 1.0, 1.0, 9.0, 9.0, 9.0]);
        let mut nothing = [gap; 4];
        fill_gaps(&mut nothing, 2, 2);
        assert!(nothing.iter().all(|v| v.is_nan()));
    }
}
