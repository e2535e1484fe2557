//! How far apart a coarse DTM's own heights err alike: assumed, or found along laser altimeter tracks.
//!
//! The covariance of two errors is taken as the variance times exp(-distance / length), without direction. Of the errors that imitate SLDEM2015's
//! an exponential is nearer to the covariance than a Gaussian is (`host-train/suites/estimates.py OUT fields`). It gives the standard deviation
//! of a mean height (`host-train/evaluate/src/mean.rs`).

use serde::Serialize;
use std::collections::BTreeMap;

/// Assumed correlation length of a coarse DTM's own errors, in its own pixels (our choice): that of the exponential nearest to the covariance of
/// SLDEM2015's errors as `sldem_errors` of `host-train/suites/external.py` has them (`host-train/suites/estimates.py OUT fields`). No source
/// gives one; Barker et al. 2016 have the size of the errors, and the seams and tracks in them.
const ASSUMED_PX: f32 = 9.0;
/// Tracks tell a length if they are so many times longer (our choice): on shorter ones an error is hardly seen to change.
const TRACK_LENGTHS: f64 = 2.0;
/// Largest distance at which errors are compared, coarse pixels (our choice): it bounds the work.
const LONGEST_PX: usize = 100;
/// Lengths that are tried: the first in coarse pixels, shorter than errors of single coarse pixels have, and the ratio of neighbours.
const TRIED: (f64, f64) = (0.25, 1.02);

/// Returns the correlation length that the errors of a coarse DTM are taken to have, metres, for the size of its pixels: 9 pixels (our choice).
#[must_use]
pub fn assumed_correlation_m(coarse_pixel_m: f32) -> f32 {
    ASSUMED_PX * coarse_pixel_m
}

/// A correlation length that was found along tracks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TrackLength {
    /// The length, coarse pixels.
    pub length_px: f64,
    /// Whether it is only a bound: the length is that at least.
    pub is_least: bool,
}

/// Number of a spot's track, and row and column of the coarse pixel that holds the spot.
type Place = (usize, (usize, usize));

/// Finds the correlation length of the coarse DTM's own errors, metres, at spots, if they have this mean `square`. The exponential is fitted to
/// the mean products of errors of one track, by their distance, each with the weight of its pairs. Spots in one coarse pixel count once, so the
/// image's errors, which hardly reach over it, are in no product. The mean is not taken off: it is an error, too.
///
/// Half the longest distance on one track is the most that is found, and then a bound: the length is at least that. `None` if there is no error,
/// or if tracks are shorter than two assumed lengths.
pub(super) fn along(spots: impl Iterator<Item = (Place, f64)>, square: f64) -> Option<TrackLength> {
    let products = products(spots);
    let longest = products.iter().rposition(|(count, _)| *count > 0.0)? as f64;
    if square <= 0.0 || longest < TRACK_LENGTHS * f64::from(ASSUMED_PX) {
        return None;
    }
    let apart = |length: f64| -> f64 {
        let fitted = |lag: usize| (-(lag as f64) / length).exp();
        let parts = products.iter().enumerate().filter(|(_, (count, _))| *count > 0.0);
        parts.map(|(lag, (count, sum))| count * (sum / count / square - fitted(lag)).powi(2)).sum()
    };
    let most = longest / TRACK_LENGTHS;
    let tried = std::iter::successors(Some(TRIED.0), |length| Some(length * TRIED.1));
    let tried = tried.take_while(|length| *length < most).chain([most]);
    let best = tried.map(|length| (apart(length), length)).min_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, length_px)| TrackLength { length_px, is_least: length_px >= most })
}

/// Returns, for each distance in whole coarse pixels, the number of pairs of coarse pixels with spots of one track, and the sum of the products of
/// their errors.
fn products(spots: impl Iterator<Item = (Place, f64)>) -> [(f64, f64); LONGEST_PX + 1] {
    let mut means: BTreeMap<Place, (f64, f64)> = BTreeMap::new();
    for (place, error_m) in spots {
        let (count, sum) = means.entry(place).or_default();
        *count += 1.0;
        *sum += error_m;
    }
    // From row to row of each track.
    let means: Vec<_> = means.into_iter().map(|((track, cell), (count, sum))| (track, cell, sum / count)).collect();
    let mut products = [(0.0, 0.0); LONGEST_PX + 1];
    for (index, &(track, (row, col), error_m)) in means.iter().enumerate() {
        for &(other, (down, right), other_m) in &means[index + 1..] {
            if other != track || down - row > LONGEST_PX {
                break;
            }
            let apart = |a: usize, b: usize| (a.abs_diff(b) as f64).powi(2);
            let lag = (apart(row, down) + apart(col, right)).sqrt().round() as usize;
            if let Some((count, sum)) = products.get_mut(lag) {
                *count += 1.0;
                *sum += error_m * other_m;
            }
        }
    }
    products
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns Gaussian numbers: sums of twelve of an even generator (PCG without its permutation, the upper bits).
    fn noise(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        let mut even = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        move || (0..12).map(|_| even()).sum::<f64>() - 6.0
    }

    /// Returns the spots of `tracks` tracks down a map, one in each of `rows` coarse pixels: errors of 3 m with a covariance of
    /// exp(-distance / length), and white ones of 1 m.
    fn spots(tracks: usize, rows: usize, length_px: f64) -> Vec<(Place, f64)> {
        let (mut random, kept) = (noise(7), (-1.0 / length_px).exp());
        let mut spots = vec![];
        for track in 0..tracks {
            let mut long = random();
            for row in 0..rows {
                spots.push(((track, (row, 5 * track)), 3.0 * long + random()));
                long = kept * long + (1.0 - kept * kept).sqrt() * random();
            }
        }
        spots
    }

    fn found(spots: &[(Place, f64)]) -> Option<TrackLength> {
        along(spots.iter().copied(), 9.0)
    }

    #[test]
    fn a_planted_length_is_found() {
        for length_px in [2.0, 5.0, 9.0, 20.0] {
            let found = found(&spots(60, 300, length_px)).unwrap();
            // 60 tracks of 300 pixels have 450 independent errors at the longest length.
            assert!((found.length_px / length_px - 1.0).abs() < 0.2 && !found.is_least, "{length_px}: {found:?}");
        }
    }

    #[test]
    fn white_errors_have_a_length_within_a_pixel() {
        let found = found(&spots(12, 200, 0.01)).unwrap();
        assert!(found.length_px < 0.5 && !found.is_least, "{found:?}");
    }

    #[test]
    fn an_error_that_does_not_change_has_a_bound() {
        let alike: Vec<_> = spots(4, 31, 1.0).into_iter().map(|(place, _)| (place, -3.0)).collect();
        assert_eq!(found(&alike), Some(TrackLength { length_px: 15.0, is_least: true }));
    }

    #[test]
    fn short_tracks_and_no_error_tell_nothing() {
        let all = spots(4, 19, 5.0);
        assert!(found(&all).is_some());
        let short: Vec<_> = all.iter().filter(|(place, _)| place.1.0 < 18).copied().collect();
        assert_eq!((found(&short), along(all.iter().copied(), 0.0), found(&[])), (None, None, None));
    }

    #[test]
    fn direction_and_many_spots_in_one_pixel_do_not_count() {
        let down = spots(4, 60, 5.0);
        let right: Vec<_> =
            down.iter().map(|&((track, (row, col)), error_m)| ((track, (col, 59 - row)), error_m)).collect();
        assert_eq!(found(&right), found(&down));
        let twice: Vec<_> =
            down.iter().flat_map(|&(place, error_m)| [(place, error_m - 2.0), (place, error_m + 2.0)]).collect();
        assert!((found(&twice).unwrap().length_px - found(&down).unwrap().length_px).abs() < 1e-9);
    }
}
