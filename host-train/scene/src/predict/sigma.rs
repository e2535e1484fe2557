//! The standard deviation of the coarse DTM's own heights: told, assumed, or found where laser altimeter tracks cross the DTM.
//!
//! Along a track the DTM's error is known. The part of its mean square that the image's own expected errors leave is the coarse DTM's. The DTM is
//! compared, not the coarse DTM: a coarse height is a mean over a coarse pixel, a laser spot is not, and the DTM has the relief inside a coarse
//! pixel. With the coarse DTM itself fewer scenes have the right shares (`host-train/suites/estimates.py OUT sigma`: `without relief`).

use super::correlation::{TrackLength, along, assumed_correlation_m};
use elunar_base::quantile::quantile;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// Largest assumed error of a coarse DTM, metres: SLDEM2015's against LOLA is 3 to 4 m (Barker et al. 2016).
const SIGMA_MAX_M: f32 = 3.0;
/// Assumed error of a coarse DTM, in its own pixels (our choice).
const SIGMA_PX: f32 = 0.04;

/// Returns the standard deviation that the heights of a coarse DTM are taken to have, metres, for the size of its pixels: 0.04 pixels, at most
/// 3 m (our choice). Errors of waves that are longer than the scene cannot be estimated from it.
#[must_use]
pub fn assumed_sigma_m(coarse_pixel_m: f32) -> f32 {
    SIGMA_MAX_M.min(SIGMA_PX * coarse_pixel_m)
}

/// Spots farther from the median than this many robust standard deviations are gross errors of the altimeter (our choice): relief that the DTM
/// lacks is nearer, false returns are not.
const OUTLIER_SDS: f64 = 5.0;
/// No spot nearer to the median than this is one, metres (our choice): heights may be rounded.
const LEAST_OUTLIER_M: f64 = 1.0;
/// A median absolute deviation of a Gaussian times this is its standard deviation.
const MAD_TO_SD: f64 = 1.4826;

/// Standard deviation of the coarse DTM's own heights, how far apart they err alike, and who says so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoarseSigma {
    /// The standard deviation, metres.
    pub sigma_m: f32,
    /// Correlation length of its errors, metres ([`super::correlation`]).
    pub correlation_m: f32,
    /// Who says so.
    pub from: SigmaFrom,
}

/// Who says how large the coarse DTM's own errors are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SigmaFrom {
    /// The user.
    Told,
    /// The size of its pixels ([`assumed_sigma_m`]).
    Assumed,
    /// Laser altimeter tracks.
    Tracks(TrackSigma),
}

/// What was found along tracks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TrackSigma {
    /// Spots that were used.
    pub points: usize,
    /// Tracks that they are of.
    pub tracks: usize,
    /// Spots left out as gross errors.
    pub outliers: usize,
    /// Standard deviation of the coarse DTM's own heights, metres.
    pub sigma_m: f64,
    /// The same, one of its own standard deviations lower.
    pub sigma_low_m: f64,
    /// The same, one higher.
    pub sigma_high_m: f64,
    /// Mean of DTM minus spots, metres: the error of the mean height of the ground that the tracks cross.
    pub mean_m: f64,
    /// Its standard deviation, metres.
    pub mean_sd_m: f64,
    /// Correlation length of the coarse DTM's own errors; `None` if the tracks are too short to tell.
    pub correlation: Option<TrackLength>,
}

/// A DTM at a laser spot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpotError {
    /// Number of the spot's track.
    pub track: usize,
    /// Row and column of the coarse pixel that holds the spot.
    pub cell: (usize, usize),
    /// DTM minus spot, metres.
    pub error_m: f64,
    /// Standard deviation of the DTM's height that the image leaves, without that of the coarse DTM's own, metres.
    pub expected_m: f64,
}

impl CoarseSigma {
    /// Returns what is told or, without that, assumed for the size of the coarse DTM's pixels.
    #[must_use]
    pub fn told_or_assumed(told_m: Option<f32>, coarse_pixel_m: f32) -> Self {
        let correlation_m = assumed_correlation_m(coarse_pixel_m);
        match told_m {
            Some(sigma_m) => Self { sigma_m, correlation_m, from: SigmaFrom::Told },
            None => Self { sigma_m: assumed_sigma_m(coarse_pixel_m), correlation_m, from: SigmaFrom::Assumed },
        }
    }

    /// Returns what is found along tracks, for the size of the coarse DTM's pixels.
    #[must_use]
    pub fn found(found: TrackSigma, coarse_pixel_m: f32) -> Self {
        let length_m = |length: TrackLength| (length.length_px * f64::from(coarse_pixel_m)) as f32;
        let correlation_m = found.correlation.map_or_else(|| assumed_correlation_m(coarse_pixel_m), length_m);
        Self { sigma_m: found.sigma_m as f32, correlation_m, from: SigmaFrom::Tracks(found) }
    }

    /// Returns who says how long the correlation length is.
    #[must_use]
    pub fn correlation_from(&self) -> &'static str {
        match self.from.tracks().and_then(|found| found.correlation) {
            Some(TrackLength { is_least: true, .. }) => "tracks, at least",
            Some(_) => "tracks",
            None => "assumed",
        }
    }
}

impl SigmaFrom {
    /// Returns the origin as one word.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Self::Told => "told",
            Self::Assumed => "assumed",
            Self::Tracks(_) => "tracks",
        }
    }

    /// Returns what was found along tracks.
    #[must_use]
    pub fn tracks(&self) -> Option<TrackSigma> {
        match *self {
            Self::Tracks(found) => Some(found),
            Self::Told | Self::Assumed => None,
        }
    }
}

impl std::fmt::Display for SigmaFrom {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self::Tracks(found) = self else { return f.write_str(self.word()) };
        let TrackSigma { points, tracks, outliers, sigma_low_m, sigma_high_m, mean_m, mean_sd_m, .. } = found;
        write!(f, "{sigma_low_m:.2} to {sigma_high_m:.2} m, from {points} laser points of {tracks} tracks")?;
        if *outliers > 0 {
            write!(f, " without {outliers} outliers")?;
        }
        write!(f, "; DTM minus points {mean_m:.2} +- {mean_sd_m:.2} m in the mean")
    }
}

/// What tracks cross.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Covered {
    /// Coarse pixels with a spot.
    pub cells: usize,
    /// Tracks with a spot.
    pub tracks: usize,
}

impl Covered {
    /// Fewest coarse pixels with a spot. Neighbouring spots share one error, so spots within one coarse pixel count once. Of one spot per coarse
    /// pixel, 20 of two tracks are the fewest with which more scenes of each list (real, exact and erring, and the suite) have 0.55 to 0.80 of
    /// their heights within one standard deviation than with the assumed sigma (`host-train/suites/estimates.py OUT floor`).
    pub const LEAST_CELLS: usize = 20;
    /// Fewest tracks. The scatter from track to track is the uncertainty of what is found.
    pub const LEAST_TRACKS: usize = 2;

    /// Counts the tracks and coarse pixels of spots.
    pub fn of(spots: impl Iterator<Item = (usize, (usize, usize))> + Clone) -> Self {
        let tracks: BTreeSet<usize> = spots.clone().map(|(track, _)| track).collect();
        let cells: BTreeSet<(usize, usize)> = spots.map(|(_, cell)| cell).collect();
        Self { cells: cells.len(), tracks: tracks.len() }
    }

    /// Returns whether a standard deviation can be found.
    #[must_use]
    pub fn is_enough(&self) -> bool {
        self.cells >= Self::LEAST_CELLS && self.tracks >= Self::LEAST_TRACKS
    }
}

/// Finds the standard deviation of the coarse DTM's own heights. Gross errors are left out. The uncertainty is from the scatter of tracks: errors
/// along one are alike.
///
/// # Errors
/// What the tracks cross without gross errors, if it is too little.
pub fn along_tracks(spots: &[SpotError]) -> std::result::Result<TrackSigma, Covered> {
    let middle_m = quantile(&mut spots.iter().map(|spot| spot.error_m).collect::<Vec<_>>(), 0.5).unwrap_or(0.0);
    let off_m = |spot: &SpotError| (spot.error_m - middle_m).abs();
    let spread_m = MAD_TO_SD * quantile(&mut spots.iter().map(off_m).collect::<Vec<_>>(), 0.5).unwrap_or(0.0);
    let limit_m = (OUTLIER_SDS * spread_m).max(LEAST_OUTLIER_M);
    let used: Vec<&SpotError> = spots.iter().filter(|spot| off_m(spot) <= limit_m).collect();
    let covered = Covered::of(used.iter().map(|spot| (spot.track, spot.cell)));
    if !covered.is_enough() {
        return Err(covered);
    }
    let excess = |spot: &SpotError| spot.error_m.powi(2) - spot.expected_m.powi(2);
    let (square, square_sd) = mean_by_track(&used, excess);
    let (mean_m, mean_sd_m) = mean_by_track(&used, |spot| spot.error_m);
    let root = |square: f64| square.max(0.0).sqrt();
    Ok(TrackSigma {
        points: used.len(),
        tracks: covered.tracks,
        outliers: spots.len() - used.len(),
        sigma_m: root(square),
        sigma_low_m: root(square - square_sd),
        sigma_high_m: root(square + square_sd),
        mean_m,
        mean_sd_m,
        correlation: along(used.iter().map(|spot| ((spot.track, spot.cell), spot.error_m)), square),
    })
}

/// Returns the mean of a figure over all spots and its standard deviation, from the scatter of the tracks' sums (that of a ratio).
fn mean_by_track(spots: &[&SpotError], figure: impl Fn(&SpotError) -> f64) -> (f64, f64) {
    let mut sums: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
    for spot in spots {
        let (count, sum) = sums.entry(spot.track).or_default();
        *count += 1.0;
        *sum += figure(spot);
    }
    let points = spots.len() as f64;
    let mean = sums.values().map(|(_, sum)| sum).sum::<f64>() / points;
    let scatter: f64 = sums.values().map(|(count, sum)| (sum - count * mean).powi(2)).sum();
    let tracks = sums.len() as f64;
    (mean, (scatter * tracks / (tracks - 1.0)).sqrt() / points)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the spots of `tracks` tracks down a map, 30 on each, with the coarse DTM's error a wave of `sigma_m` with a phase of its own on
    /// each track, and the image's an alternating one of 1 m.
    fn spots(tracks: usize, sigma_m: f64) -> Vec<SpotError> {
        let spot = |i: usize| {
            let (track, row) = (i / 30, i % 30);
            let wave = (row as f64 / 30.0 * 6.0 * std::f64::consts::PI + 2.1 * track as f64).sin() * 2f64.sqrt();
            let error_m = sigma_m * wave + if i.is_multiple_of(2) { 1.0 } else { -1.0 };
            SpotError { track, cell: (row, 5 * track), error_m, expected_m: 1.0 }
        };
        (0..30 * tracks).map(spot).collect()
    }

    #[test]
    fn the_assumed_error_is_that_of_global_dtms_at_most() {
        assert!((assumed_sigma_m(59.2) - 2.37).abs() < 0.01);
        assert_eq!((assumed_sigma_m(118.0), assumed_sigma_m(32_000.0)), (3.0, 3.0));
    }

    #[test]
    fn a_known_error_is_found_beside_that_of_the_image() {
        for sigma_m in [0.0, 0.5, 3.0, 40.0] {
            let found = along_tracks(&spots(4, sigma_m)).unwrap();
            assert!((found.sigma_m - sigma_m).abs() < 0.03 * sigma_m + 1e-6, "{sigma_m}: {found:?}");
            assert!(found.sigma_low_m <= found.sigma_m && found.sigma_m <= found.sigma_high_m, "{found:?}");
            assert_eq!((found.points, found.tracks, found.outliers), (120, 4, 0));
        }
    }

    #[test]
    fn gross_errors_are_left_out() {
        let mut bad = spots(4, 3.0);
        let clean = along_tracks(&bad).unwrap();
        bad.iter_mut().step_by(20).for_each(|spot| spot.error_m += if spot.track % 2 == 0 { 900.0 } else { -60.0 });
        let found = along_tracks(&bad).unwrap();
        assert_eq!((found.outliers, found.points), (6, 114));
        assert!((found.sigma_m - clean.sigma_m).abs() < 0.1, "{found:?} {clean:?}");
        // Of heights that are right to the last digit, no rounded one is an outlier.
        let exact = |i: usize| SpotError {
            track: i / 30,
            cell: (i % 30, i / 30),
            error_m: f64::from(u8::from(i.is_multiple_of(3))) * 0.5,
            expected_m: 0.0,
        };
        assert_eq!(along_tracks(&(0..60).map(exact).collect::<Vec<_>>()).unwrap().outliers, 0);
    }

    #[test]
    fn the_scatter_of_tracks_is_the_uncertainty() {
        // Each track has an error of its own: the mean over 4 tracks has half its standard deviation, whatever the number of spots.
        let level = |i: usize| [3.0, -1.0, 2.0, -4.0][i / 30];
        let spot = |i: usize| SpotError { track: i / 30, cell: (i % 30, i / 30), error_m: level(i), expected_m: 0.0 };
        let found = along_tracks(&(0..120).map(spot).collect::<Vec<_>>()).unwrap();
        assert!(found.mean_m.abs() < 1e-12 && (found.mean_sd_m - (30f64 / 3.0 / 4.0).sqrt()).abs() < 1e-12);
        // Of squares 9, 1, 4 and 16: mean 7.5, variance of the mean 43 / 4.
        let sd = (((9.0 - 7.5f64).powi(2) + 6.5f64.powi(2) + 3.5f64.powi(2) + 8.5f64.powi(2)) / 3.0 / 4.0).sqrt();
        assert!((found.sigma_high_m - (7.5 + sd).sqrt()).abs() < 1e-12, "{found:?}");
        assert!((found.sigma_low_m - (7.5 - sd).sqrt()).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn too_little_is_refused_with_what_there_is() {
        let all = spots(4, 3.0);
        assert_eq!(along_tracks(&all[..30]), Err(Covered { cells: 30, tracks: 1 }));
        assert_eq!(along_tracks(&all[20..39]), Err(Covered { cells: 19, tracks: 2 }));
        assert!(along_tracks(&all[20..40]).is_ok());
        let within_one: Vec<SpotError> = all.iter().map(|spot| SpotError { cell: (0, 0), ..*spot }).collect();
        assert_eq!(along_tracks(&within_one), Err(Covered { cells: 1, tracks: 4 }));
        assert_eq!(along_tracks(&[]), Err(Covered { cells: 0, tracks: 0 }));
    }

    #[test]
    fn a_length_is_assumed_unless_tracks_tell_it() {
        let found = along_tracks(&spots(4, 3.0)).unwrap();
        let with = |correlation| CoarseSigma::found(TrackSigma { correlation, ..found }, 50.0);
        let length = |is_least| Some(TrackLength { length_px: 4.0, is_least });
        for (sigma, expected) in [
            (with(None), (450.0, "assumed")),
            (with(length(false)), (200.0, "tracks")),
            (with(length(true)), (200.0, "tracks, at least")),
            (CoarseSigma::told_or_assumed(Some(2.0), 50.0), (450.0, "assumed")),
            (CoarseSigma::told_or_assumed(None, 50.0), (450.0, "assumed")),
        ] {
            assert_eq!((sigma.correlation_m, sigma.correlation_from()), expected);
        }
    }

    #[test]
    fn the_origin_is_said_in_one_line() {
        let found = along_tracks(&spots(4, 3.0)).unwrap();
        let text = CoarseSigma::found(found, 59.2).from.to_string();
        assert!(text.contains(" m, from 120 laser points of 4 tracks; DTM minus points "), "{text}");
        let said = [Some(2.0), None].map(|told| CoarseSigma::told_or_assumed(told, 59.2).from.to_string());
        assert_eq!(said, ["told", "assumed"]);
    }
}
