//! Scores of DTMs against a truth. All candidates are scored on the same pixels. [`lola`] compares a DTM with laser tracks, and [`diff`]
//! subtracts two DTMs.

mod calibration;
mod coalign;
mod cross_spectrum;
mod details;
pub mod diff;
mod expected;
mod fill;
pub mod linear;
pub mod lola;
pub mod lowpass;
mod maps;
mod mean;
mod octaves;
mod quantiles;
mod registration;
mod relief;
mod report;
mod scores;
mod spectral;

pub use calibration::{Calibration, Coverage, calibration};
pub use coalign::CoAlignment;
pub use details::Details;
pub use expected::ExpectedErrorMaps;
pub use maps::{EvaluatedMaps, NamedSource, View};
pub use mean::CorrelatedErrors;
pub use octaves::{HalfCoherence, Octave, half_coherence};
pub use registration::Registration;
pub use relief::{ImageLight, ReliefScores, Side, relief};
pub use report::{Both, ReportSummary, json, short_names, table};
pub use scores::{PERCENTILES, Scores};
pub use spectral::{Spectral, octaves_picture, spectral};

use elunar_base::{Error, Result};
use elunar_core::terrain::PixelSize;
use elunar_raster::Raster;
use elunar_raster::align::{Interpolation, Named, onto};
use lowpass::LowPass;

/// A DTM to be scored.
#[derive(Debug, Clone, Copy)]
pub struct Candidate<'a> {
    /// Name and heights, metres.
    pub dtm: Named<'a>,
    /// Interpolation onto the truth's grid, if the grids differ.
    pub interpolation: Interpolation,
}

impl<'a> Candidate<'a> {
    /// Makes a candidate from a DTM of about the truth's resolution. Interpolation is bilinear; a pixel is invalid where a sample is
    /// missing.
    #[must_use]
    pub fn fine(name: &'a str, dtm: &'a Raster) -> Self {
        Self { dtm: Named::new(name, dtm), interpolation: Interpolation::Bilinear }
    }

    /// Makes a candidate from a coarse DTM on its own grid. Interpolation is bicubic, as for the network's input.
    #[must_use]
    pub fn coarse(name: &'a str, dtm: &'a Raster) -> Self {
        Self { dtm: Named::new(name, dtm), interpolation: Interpolation::Bicubic }
    }
}

/// The result for one candidate.
#[derive(Debug, Clone)]
pub struct Scored {
    /// The candidate's name.
    pub name: String,
    /// Its scores over the common pixels.
    pub scores: Scores,
    /// The candidate on the truth's grid at the resolution of the comparison, metres; NaN off the common pixels.
    pub placed: Raster,
    /// The candidate on the truth's grid as it is, before it is brought to that resolution.
    pub as_it_is: Raster,
    /// Candidate minus truth, metres, on the truth's grid; NaN off the common pixels.
    pub error_m: Raster,
}

/// The result of [`compare`].
#[derive(Debug, Clone)]
pub struct Comparison {
    /// Name of the truth.
    pub truth: String,
    /// Valid pixels of the truth.
    pub truth_pixels: usize,
    /// Pixels valid in the truth and in every candidate. Only these are scored.
    pub common_pixels: usize,
    /// Ground size of the truth's pixels.
    pub pixel: PixelSize,
    /// Resolution at which all DTMs were compared, metres; `None`: as they are.
    pub resolution_m: Option<f64>,
    /// The truth at this resolution, metres; NaN off the common pixels.
    pub truth_m: Raster,
    /// One result per candidate, in the order of the candidates.
    pub scored: Vec<Scored>,
}

/// Scores `candidates` against `truth` on the truth's grid, on the pixels that are valid in all of them.
///
/// A DTM from stereo or altimetry resolves less than its pixel. With `resolution_m`, the truth and all candidates are smoothed alike before
/// the comparison, by a Gaussian that halves waves of this length.
///
/// # Errors
/// [`Error::Input`] if a raster has no place, reference systems differ or no pixel is common to all, [`Error::Usage`] if the resolution does
/// not fit the truth.
pub fn compare(truth: Named, candidates: &[Candidate], resolution_m: Option<f64>) -> Result<Comparison> {
    let mut placed = Vec::with_capacity(candidates.len());
    for candidate in candidates {
        placed.push(onto(candidate.dtm, truth, candidate.interpolation)?);
    }
    let heights_m = &truth.raster.samples;
    let common: Vec<bool> = (0..heights_m.len())
        .map(|i| heights_m[i].is_finite() && placed.iter().all(|p| p.samples[i].is_finite()))
        .collect();
    let common_pixels = common.iter().filter(|&&c| c).count();
    if common_pixels == 0 {
        let names: Vec<&str> = candidates.iter().map(|c| c.dtm.name).collect();
        return Err(nothing_common(truth.name, &names));
    }
    let (row_m, col_m) =
        truth.raster.pixel_m().ok_or_else(|| Error::input(format!("{}: pixel size in metres unknown", truth.name)))?;
    let (height_m, width_m) = (truth.raster.rows as f64 * row_m, truth.raster.cols as f64 * col_m);
    check_resolution(resolution_m, height_m.max(width_m))?;
    let pixel = PixelSize { row_m, col_m };
    let filter = resolution_m.map(|wavelength_m| LowPass::new(wavelength_m, (row_m, col_m)));
    let resolved = |map: &Raster| {
        let map = masked(map, &common);
        match &filter {
            Some(filter) => Raster { samples: filter.apply(&map).0, ..map },
            None => map,
        }
    };
    let truth_m = resolved(truth.raster);
    let scored = candidates.iter().zip(placed).map(|(candidate, placed)| {
        let as_it_is = masked(&placed, &common);
        let placed = resolved(&placed);
        let samples = placed.samples.iter().zip(&truth_m.samples).map(|(z, t)| z - t).collect();
        let scores = Scores::of(&truth_m, &placed, pixel)?;
        let error_m = Raster { samples, ..placed.clone() };
        Ok(Scored { name: candidate.dtm.name.into(), scores, placed, as_it_is, error_m })
    });
    let scored = scored.collect::<Result<_>>()?;
    let (truth, truth_pixels) = (truth.name.into(), truth.raster.valid_count());
    Ok(Comparison { truth, truth_pixels, common_pixels, pixel, resolution_m, truth_m, scored })
}

/// Shortest resolution that a truth may have, metres. No grid is finer.
const SHORTEST_M: f64 = 1e-3;

/// Refuses a resolution that no truth has whose longer side is `longest_m` metres.
fn check_resolution(resolution_m: Option<f64>, longest_m: f64) -> Result<()> {
    match resolution_m {
        Some(found) if !(SHORTEST_M..=longest_m).contains(&found) => Err(Error::usage(format!(
            "resolution of the truth: metres from {SHORTEST_M} to {longest_m:.1}, the truth's longer side, expected, {found:?} found"
        ))),
        _ => Ok(()),
    }
}

fn nothing_common(truth: &str, candidates: &[&str]) -> Error {
    let names = candidates.join(" and ");
    Error::input(format!("{truth}: pixels that are valid there and in {names} expected, none found"))
}

fn masked(raster: &Raster, keep: &[bool]) -> Raster {
    let samples = raster.samples.iter().zip(keep).map(|(&v, &keep)| if keep { v } else { f32::NAN }).collect();
    Raster { samples, ..raster.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::sun::Body;
    use elunar_raster::{Crs, GeoRef};

    fn raster(rows: usize, cols: usize, height: impl Fn(usize, usize) -> f32) -> Raster {
        let georef = GeoRef {
            transform: [0.0, 2.0, 0.0, 0.0, 0.0, -2.0],
            crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0),
        };
        Raster {
            rows,
            cols,
            samples: (0..rows * cols).map(|i| height(i / cols, i % cols)).collect(),
            georef: Some(georef),
        }
    }

    #[test]
    fn scores_are_those_of_the_definition() {
        let truth = raster(20, 30, |r, c| (r as f32 * 0.7).sin() * 9.0 + c as f32);
        let error = |r: usize, c: usize| if (r + c).is_multiple_of(4) { 5.0 } else { 1.0 };
        let dtm = raster(20, 30, |r, c| truth.samples[r * 30 + c] + error(r, c));
        let found = compare(Named::new("truth", &truth), &[Candidate::fine("dtm", &dtm)], None).unwrap();
        let scores = found.scored[0].scores;
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-5, "{a} {b}");
        assert_eq!((found.common_pixels, found.truth_pixels, scores.pixels), (600, 600, 600));
        assert_eq!(scores.share_within, [0.75, 0.75, 1.0]);
        close(scores.mae_m, 2.0);
        close(scores.bias_m, 2.0);
        close(scores.rmse_m, 7.0_f64.sqrt());
        close(scores.median_m, 1.0);
        close(scores.rmse_median_removed_m, 2.0);
        close(scores.largest_m, 5.0);
        close(scores.nmad_m, 0.0);
        close(scores.error_95_m, 5.0);
        assert_eq!(scores.error_percentiles_m.map(f64::round), [1.0, 1.0, 5.0, 5.0, 5.0]);
        assert!(scores.slope_rmse_deg > 0.1 && scores.slope_pixels == 18 * 28);
        assert!((found.scored[0].error_m.samples[1] - 1.0).abs() < 1e-5);
    }

    /// Short waves of the DTM that the truth cannot show do not count at the truth's resolution; long ones do.
    #[test]
    fn a_resolution_smooths_truth_and_dtm_alike() {
        let wave = |r: usize, c: usize| (r as f32 * 0.1).sin() * 9.0 + c as f32 * 0.1;
        let truth = raster(60, 80, wave);
        let dtm = raster(60, 80, |r, c| wave(r, c) + if (r + c).is_multiple_of(2) { 1.0 } else { -1.0 });
        let at = |resolution_m| compare(Named::new("t", &truth), &[Candidate::fine("d", &dtm)], resolution_m);
        let (whole, coarse) = (at(None).unwrap(), at(Some(20.0)).unwrap());
        let rmse = |found: &Comparison| found.scored[0].scores.rmse_m;
        assert!((rmse(&whole) - 1.0).abs() < 1e-5 && rmse(&coarse) < 0.05, "{} {}", rmse(&whole), rmse(&coarse));
        assert_eq!(coarse.scored[0].as_it_is.samples, dtm.samples, "the DTM itself is not smoothed");
        // The truth's own waves of 126 m stay.
        let kept = coarse.truth_m.samples[30 * 80 + 40] - coarse.truth_m.samples[15 * 80 + 40];
        let before = truth.samples[30 * 80 + 40] - truth.samples[15 * 80 + 40];
        assert!((kept / before - 1.0).abs() < 0.05, "{kept} of {before}");
        assert!(
            table(&coarse, &Details::default()).contains("at a resolution of 20.0 m")
                && json(&coarse, &Details::default()).contains("\"resolution_m\": 20.0")
        );
        for wrong in [0.0, -3.0, f64::NAN, f64::INFINITY, 1e300, 1e-300, 161.0] {
            let text = at(Some(wrong)).unwrap_err().to_string();
            assert!(text.contains("metres from 0.001 to 160.0, the truth's longer side, expected"), "{wrong}: {text}");
        }
    }

    #[test]
    fn a_plane_has_a_slope_error_of_its_angle() {
        let (truth, dtm) = (raster(9, 9, |_, _| 3.0), raster(9, 9, |r, _| 2.0 * r as f32));
        let scores = compare(Named::new("t", &truth), &[Candidate::fine("d", &dtm)], None).unwrap().scored[0].scores;
        assert!((scores.slope_mae_deg - 45.0).abs() < 1e-9 && (scores.slope_bias_deg - 45.0).abs() < 1e-9);
        assert!(scores.slope_error_percentiles_deg.iter().all(|p| (p - 45.0).abs() < 1e-9));
    }

    #[test]
    fn all_candidates_are_scored_on_the_same_pixels() {
        let truth = raster(10, 10, |r, c| (r * c) as f32);
        let mut with_gap = truth.clone();
        with_gap.samples[44] = f32::NAN;
        let wrong_there = raster(10, 10, |r, c| if r * 10 + c == 44 { 1e4 } else { (r * c) as f32 });
        let candidates = [Candidate::fine("gap", &with_gap), Candidate::fine("wrong", &wrong_there)];
        let found = compare(Named::new("t", &truth), &candidates, None).unwrap();
        assert_eq!((found.common_pixels, found.truth_pixels), (99, 100));
        assert_eq!(found.scored[1].scores.rmse_m, 0.0);
        assert!(found.scored[1].error_m.samples[44].is_nan());
        let nothing = raster(10, 10, |r, c| if r * 10 + c == 44 { 1.0 } else { f32::NAN });
        let refused =
            compare(Named::new("t", &truth), &[candidates[0], Candidate::fine("nothing", &nothing)], None).unwrap_err();
        assert!(refused.to_string().contains("gap and nothing"), "{refused}");
    }

    #[test]
    fn table_and_json_hold_the_same_figures() {
        let truth = raster(10, 10, |r, c| (r * c) as f32);
        let dtm = raster(10, 10, |r, c| (r * c) as f32 + 3.0);
        let candidates = [Candidate::fine("dtm.tif", &dtm), Candidate::coarse("coarse.tif", &truth)];
        let found = compare(Named::new("truth.tif", &truth), &candidates, None).unwrap();
        let text = table(&found, &Details::default());
        assert!(text.contains("dtm.tif") && text.contains("coarse.tif") && text.contains("3.000"), "{text}");
        let value: serde_json::Value = serde_json::from_str(&json(&found, &Details::default())).unwrap();
        assert_eq!(value["candidates"][0]["rmse_m"], 3.0);
        assert_eq!(value["candidates"][0]["share_within_4_m"], 1.0);
        assert_eq!(value["candidates"][1]["mae_m"], 0.0);
        assert_eq!(value["common_pixels"], 100);
    }

    /// The scores of `truth.tif` and `dtm.tif` from their definitions.
    const NUMPY: &str = "
t = rasterio.open('truth.tif').read(1, masked=True).astype('f8').filled(np.nan)[3:53, 2:]
z = rasterio.open('dtm.tif').read(1, masked=True).astype('f8').filled(np.nan)[:, :78]
both = np.isfinite(t) & np.isfinite(z)
t[~both] = np.nan; z[~both] = np.nan
def slope(h):
    p = [[h[i:h.shape[0] - 2 + i, j:h.shape[1] - 2 + j] for j in range(3)] for i in range(3)]
    hole = sum(sum(row) for row in p)
    dx = ((p[0][2] + 2 * p[1][2] + p[2][2]) - (p[0][0] + 2 * p[1][0] + p[2][0])) / 16
    dy = ((p[2][0] + 2 * p[2][1] + p[2][2]) - (p[0][0] + 2 * p[0][1] + p[0][2])) / 16
    return np.degrees(np.arctan(np.hypot(dx, dy))) + 0 * hole
e = (z - t)[both]
s = slope(z) - slope(t); s = s[np.isfinite(s)]
rms = lambda v: np.sqrt(np.mean(v * v))
print(e.size, *[np.mean(abs(e) < l) for l in (2, 4, 10)], abs(e).mean(), rms(e), e.mean(), np.median(e), rms(e - np.median(e)),
      abs(e).max(), 1.4826 * np.median(abs(e - np.median(e))), np.quantile(abs(e), 0.95), *np.quantile(abs(e), [0.5, 0.68, 0.9, 0.95, 0.99]),
      *np.quantile(abs(s), [0.5, 0.68, 0.9, 0.95, 0.99]), s.size, abs(s).mean(), rms(s), s.mean())
";

    /// Two rasters with gaps on shifted grids; numpy computes the scores from the files.
    #[test]
    fn scores_match_numpy() {
        use elunar_raster::geotiff::{WriteOptions, write};
        let folder = tempfile::tempdir().unwrap();
        let bumps =
            |r: usize, c: usize, k: f32| (r as f32 * 0.31 * k).sin() * 20.0 + (c as f32 * 0.17).cos() * 15.0 - 1900.0;
        let mut truth = raster(60, 80, |r, c| bumps(r, c, 1.0));
        let mut dtm = raster(50, 90, |r, c| bumps(r, c, 1.07) + 0.7);
        // The DTM begins three rows and two columns after the truth. The grids coincide otherwise.
        dtm.georef.as_mut().unwrap().transform = [4.0, 2.0, 0.0, -6.0, 0.0, -2.0];
        for i in [5 * 80 + 7, 30 * 80 + 30, 30 * 80 + 31] {
            truth.samples[i] = f32::NAN;
        }
        dtm.samples[20 * 90 + 50] = f32::NAN;
        for (name, raster) in [("truth.tif", &truth), ("dtm.tif", &dtm)] {
            write(&folder.path().join(name), raster, &WriteOptions::heights("test")).unwrap();
        }
        let Some(out) = elunar_testing::rasterio(NUMPY, folder.path()) else { return };
        let expected: Vec<f64> = out.split_whitespace().map(|v| v.parse().unwrap()).collect();
        let s = compare(Named::new("t", &truth), &[Candidate::fine("d", &dtm)], None).unwrap().scored[0].scores;
        let [two, four, ten] = s.share_within;
        let (pixels, slopes) = (s.pixels as f64, s.slope_pixels as f64);
        let heights = [
            pixels,
            two,
            four,
            ten,
            s.mae_m,
            s.rmse_m,
            s.bias_m,
            s.median_m,
            s.rmse_median_removed_m,
            s.largest_m,
            s.nmad_m,
            s.error_95_m,
        ];
        let found = [
            heights.as_slice(),
            &s.error_percentiles_m,
            &s.slope_error_percentiles_deg,
            &[slopes, s.slope_mae_deg, s.slope_rmse_deg, s.slope_bias_deg],
        ]
        .concat();
        for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
            assert!(
                (found - expected).abs() < 1e-9 * expected.abs().max(1.0),
                "figure {i}: {found} instead of {expected}"
            );
        }
        assert_eq!(found.len(), expected.len());
    }
}
