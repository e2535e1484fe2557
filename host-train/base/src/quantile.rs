//! Medians and percentiles.

/// Returns the value below which `share` (0–1) of the values lie, linear between neighbours in order (numpy's default). Reorders `values`.
/// Returns `None` if there are none.
pub fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let position = share.clamp(0.0, 1.0) * last as f64;
    let (_, &mut lower, above) = values.select_nth_unstable_by(position.floor() as usize, f64::total_cmp);
    let upper = above.iter().copied().fold(f64::INFINITY, f64::min);
    let fraction = position.fract();
    Some(if fraction == 0.0 { lower } else { lower + fraction * (upper - lower) })
}

/// Returns the value at the position nearest to `share` (0–1) in the order of the values. The result is always one of `values`, which are
/// reordered. Returns `None` if there are none.
pub fn nearest_rank(values: &mut [f32], share: f64) -> Option<f32> {
    let last = values.len().checked_sub(1)?;
    let rank = (share.clamp(0.0, 1.0) * last as f64).round() as usize;
    Some(*values.select_nth_unstable_by(rank, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_linear_between_neighbours() {
        let mut values = [3.0, -1.0, 2.0, 9.0];
        assert_eq!(quantile(&mut values, 0.5), Some(2.5));
        assert_eq!(quantile(&mut values, 0.0), Some(-1.0));
        assert_eq!(quantile(&mut values, 1.0), Some(9.0));
        assert!((quantile(&mut values, 0.9).unwrap() - (3.0 + 0.7 * 6.0)).abs() < 1e-12);
        assert_eq!(quantile(&mut [], 0.5), None);
    }

    #[test]
    fn nearest_ranks_are_values() {
        let mut values = [3.0, -1.0, 2.0, 9.0];
        let found = [0.0, 0.1, 0.3, 0.5, 0.9, 1.0].map(|share| nearest_rank(&mut values, share).unwrap());
        assert_eq!(found, [-1.0, -1.0, 2.0, 3.0, 9.0, 9.0]);
        assert_eq!(nearest_rank(&mut [], 0.5), None);
    }
}
