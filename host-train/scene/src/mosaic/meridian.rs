//! Maps around the whole body: there a meridian has several values of x, a period apart.

use elunar_raster::{Crs, Projection};

/// Ranges of x, west and east limit.
pub(super) type Range = [f64; 2];

/// Returns the period of x in map units; `None` if a meridian has one x.
pub(super) fn period(crs: &Crs) -> Option<f64> {
    match Projection::of(crs) {
        Some(projection) => projection.period(),
        // Longitudes of a body that is unknown, or no sphere.
        None => (!crs.is_empty() && !crs.is_projected()).then_some(360.0),
    }
}

/// Returns the places of `range` that meet `within`, as numbers of periods to add to x. A range of more than two periods stays where it is.
pub(super) fn turns(range: Range, within: Range, period: Option<f64>) -> Vec<f64> {
    let Some(period) = period.filter(|period| range[1] - range[0] <= 2.0 * period) else { return vec![0.0] };
    let first = ((within[0] - range[1]) / period).ceil();
    let last = ((within[1] - range[0]) / period).floor();
    // A bounded number: neither range is much wider than a period.
    (0..8).map(|k| first + f64::from(k)).take_while(|k| *k <= last).collect()
}

/// Returns the narrowest range that holds all `ranges`, each moved by whole periods; not wider than a period, unless one of them is. Among
/// equal ones that in which the first keeps its x, or its x plus a period if the range would otherwise begin more than half a period west
/// of 0. `slack` is what counts as nothing.
pub(super) fn narrowest(ranges: &[Range], period: f64, slack: f64) -> Option<Range> {
    let widest = ranges.iter().map(|[west, east]| east - west).fold(0.0, f64::max);
    // From a start, how far east the others end.
    let width_from = |start: f64| {
        let ends = ranges.iter().map(|[west, east]| after(west - start, period, slack) + (east - west));
        ends.fold(0.0, f64::max).min(period.max(widest))
    };
    let starts = ranges.iter().map(|[west, _]| (*west, width_from(*west)));
    let (start, width) = starts.reduce(|best, next| if next.1 < best.1 - slack { next } else { best })?;
    let first = ranges.first()?[0];
    let west = first - after(first - start, period, slack);
    let west = if west < -0.5 * period - slack { west + period } else { west };
    Some([west, west + width])
}

/// Returns how far east of a start a place lies, 0 to a period; slightly west of it counts as at it.
fn after(offset: f64, period: f64, slack: f64) -> f64 {
    let east = offset.rem_euclid(period);
    if period - east < slack { east - period } else { east }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(ranges: &[Range]) -> Range {
        narrowest(ranges, 360.0, 0.01).unwrap()
    }

    #[test]
    fn the_narrowest_range_crosses_the_meridian_where_that_is_shorter() {
        assert_eq!(of(&[[178.0, 180.0], [-180.0, -178.0]]), [178.0, 182.0]);
        assert_eq!(of(&[[-180.0, -178.0], [178.0, 180.0]]), [178.0, 182.0], "not -182 to -178");
        assert_eq!(of(&[[350.0, 360.0], [-5.0, 5.0], [3.0, 9.0]]), [350.0, 369.0]);
        assert_eq!(of(&[[-10.0, 5.0], [350.0, 360.0]]), [-10.0, 5.0]);
        assert_eq!(of(&[[10.0, 20.0], [15.0, 40.0]]), [10.0, 40.0]);
        assert_eq!(of(&[[200.0, 210.0], [-155.0, -140.0]]), [200.0, 220.0]);
    }

    #[test]
    fn a_whole_body_is_a_period_wide() {
        assert_eq!(of(&[[0.0, 360.0], [-180.0, 180.0]]), [0.0, 360.0]);
        assert_eq!(of(&[[-180.0, 180.0], [0.0, 360.0]]), [-180.0, 180.0]);
        assert_eq!(of(&[[-180.0, 180.0], [170.0, 190.0]]), [-180.0, 180.0]);
        assert_eq!(of(&[[0.0, 364.0]]), [0.0, 364.0], "unless it was wider before");
    }

    #[test]
    fn a_range_meets_another_at_all_its_places() {
        assert_eq!(turns([-180.0, 180.0], [0.0, 360.0], Some(360.0)), [0.0, 1.0]);
        assert_eq!(turns([-180.0, -178.0], [178.0, 182.0], Some(360.0)), [1.0]);
        assert_eq!(turns([0.0, 1.0], [178.0, 182.0], Some(360.0)), [0.0; 0]);
        assert_eq!(turns([0.0, 1.0], [178.0, 182.0], None), [0.0]);
        assert_eq!(turns([-1e300, 1e300], [178.0, 182.0], Some(360.0)), [0.0]);
    }
}
