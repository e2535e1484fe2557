//! Medians and percentiles.

/// The value below which `share` (0–1) of all lie, linear between neighbours in order (numpy's default); reorders `values`.
/// `None` if there are none.
pub fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let position = share.clamp(0.0, 1.0) * last as f64;
    let (_, &mut lower, above) = values.select_nth_unstable_by(position.floor() as usize, f64::total_cmp);
    let upper = above.iter().copied().fold(f64::INFINITY, f64::min);
    let fraction = position.fract();
    Some(if fraction == 0.0 { lower } else { lower + fraction * (upper - lower) })
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
}
