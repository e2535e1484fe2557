//! A comparison as text and as JSON.

use super::spectral::{Spectral, octaves_table};
use super::{Comparison, Details, EvaluatedMaps, PERCENTILES, Scores};
use elunar_base::Result;
use elunar_core::metrics::height::LIMITS_M;
use elunar_core::terrain::PixelSize;
use serde_json::{Value, json as value};
use std::collections::BTreeSet;
use std::path::Path;

/// What a report is made of.
#[derive(Debug, Clone)]
pub struct ReportSummary {
    /// Name of the truth.
    pub truth: String,
    /// Valid pixels of the truth.
    pub truth_pixels: usize,
    /// Pixels valid in the truth and in every candidate. Only these are scored.
    pub common_pixels: usize,
    /// Ground size of the truth's pixels.
    pub pixel: PixelSize,
    /// Wavelength that the truth resolves, metres, if it is known.
    pub resolution_m: Option<f64>,
    /// Scores of the candidates.
    pub candidates: Vec<Both>,
}

/// The scores of a candidate: at the truth's pixel, and at its resolution.
#[derive(Debug, Clone)]
pub struct Both {
    /// Name of the candidate.
    pub name: String,
    /// Scores of all DTMs as they are; `None` if they were not computed.
    pub at_pixel: Option<Scores>,
    /// Scores of all DTMs smoothed to the truth's resolution; `None` if that is not known.
    pub at_resolution: Option<Scores>,
}

impl Both {
    /// Returns the scores that the comparison is about: those at the truth's resolution, if it is known.
    fn main(&self) -> Option<&Scores> {
        self.at_resolution.as_ref().or(self.at_pixel.as_ref())
    }
}

impl ReportSummary {
    /// Scores the maps at the truth's pixel, and at its resolution if that is known.
    ///
    /// # Errors
    /// Errors of reading are passed on.
    pub fn of(maps: &EvaluatedMaps) -> Result<Self> {
        let at_pixel = maps.as_they_are()?.scores()?;
        let at_resolution = maps.resolution_m().map(|_| maps.at_resolution()?.scores()).transpose()?;
        let both = |(k, (name, at_pixel)): (usize, (&str, Scores))| Both {
            name: name.into(),
            at_pixel: Some(at_pixel),
            at_resolution: at_resolution.as_ref().and_then(|scores| scores.get(k)).copied(),
        };
        let candidates = maps.names().zip(at_pixel).enumerate().map(both).collect();
        let ((truth_pixels, common_pixels), pixel, resolution_m) = (maps.pixels(), maps.pixel(), maps.resolution_m());
        Ok(Self { truth: maps.truth_name().into(), truth_pixels, common_pixels, pixel, resolution_m, candidates })
    }
}

impl From<&Comparison> for ReportSummary {
    fn from(from: &Comparison) -> Self {
        let is_smoothed = from.resolution_m.is_some();
        let candidates = from.scored.iter().map(|scored| Both {
            name: scored.name.clone(),
            at_pixel: Some(scored.scores).filter(|_| !is_smoothed),
            at_resolution: Some(scored.scores).filter(|_| is_smoothed),
        });
        Self {
            truth: from.truth.clone(),
            truth_pixels: from.truth_pixels,
            common_pixels: from.common_pixels,
            pixel: from.pixel,
            resolution_m: from.resolution_m,
            candidates: candidates.collect(),
        }
    }
}

/// A row of the table: heading, unit, and the function that returns the figure.
type Line = (&'static str, &'static str, fn(&Scores) -> f64);

const LINES: [Line; 23] = [
    ("|error| < 2 m", "%", |s| 100.0 * s.share_within[0]),
    ("|error| < 4 m", "%", |s| 100.0 * s.share_within[1]),
    ("|error| < 10 m", "%", |s| 100.0 * s.share_within[2]),
    ("MAE", "m", |s| s.mae_m),
    ("RMSE", "m", |s| s.rmse_m),
    ("RMSE, median removed", "m", |s| s.rmse_median_removed_m),
    ("mean error", "m", |s| s.bias_m),
    ("median error", "m", |s| s.median_m),
    ("NMAD", "m", |s| s.nmad_m),
    ("50 % of |error| below", "m", |s| s.error_percentiles_m[0]),
    ("68 % of |error| below", "m", |s| s.error_percentiles_m[1]),
    ("90 % of |error| below", "m", |s| s.error_percentiles_m[2]),
    ("95 % of |error| below", "m", |s| s.error_percentiles_m[3]),
    ("99 % of |error| below", "m", |s| s.error_percentiles_m[4]),
    ("largest |error|", "m", |s| s.largest_m),
    ("slope MAE", "deg", |s| s.slope_mae_deg),
    ("slope RMSE", "deg", |s| s.slope_rmse_deg),
    ("slope mean error", "deg", |s| s.slope_bias_deg),
    ("50 % of |slope error| below", "deg", |s| s.slope_error_percentiles_deg[0]),
    ("68 % of |slope error| below", "deg", |s| s.slope_error_percentiles_deg[1]),
    ("90 % of |slope error| below", "deg", |s| s.slope_error_percentiles_deg[2]),
    ("95 % of |slope error| below", "deg", |s| s.slope_error_percentiles_deg[3]),
    ("99 % of |slope error| below", "deg", |s| s.slope_error_percentiles_deg[4]),
];

/// A row of figures from spectra, likewise.
type SpectralLine = (&'static str, &'static str, fn(&Spectral) -> Option<f64>);

const SPECTRAL_LINES: [SpectralLine; 8] = [
    ("half-coherence wavelength", "m", |s| Some(s.half_coherence?.wavelength_m)),
    ("offset down", "px", |s| Some(s.registration?.down_px)),
    ("offset right", "px", |s| Some(s.registration?.right_px)),
    ("offset down, standard deviation", "px", |s| Some(s.registration?.down_sd_px)),
    ("offset right, standard deviation", "px", |s| Some(s.registration?.right_sd_px)),
    ("offset down", "m", |s| Some(s.registration?.down_m)),
    ("offset right", "m", |s| Some(s.registration?.right_m)),
    ("correlation of slopes there", "1", |s| Some(s.registration?.correlation)),
];

/// A column of the table: what the scores are of, at what, and its width.
struct Column<'a> {
    name: &'a str,
    at: String,
    scores: &'a Scores,
    width: usize,
    /// Number of the candidate whose spectrum belongs to the column.
    spectrum: Option<usize>,
}

/// Returns the columns: of every candidate the scores at the pixel, and those at the truth's resolution.
fn columns<'a>(summary: &'a ReportSummary, names: &'a [String]) -> Vec<Column<'a>> {
    let resolution = format!("at {:.1} m", summary.resolution_m.unwrap_or_default());
    let mut columns = vec![];
    for (k, (both, name)) in summary.candidates.iter().zip(names).enumerate() {
        let at_pixel = both.at_pixel.as_ref().map(|scores| (scores, "at the pixel", both.at_resolution.is_none()));
        let at_resolution = both.at_resolution.as_ref().map(|scores| (scores, resolution.as_str(), true));
        for (scores, at, is_main) in at_pixel.into_iter().chain(at_resolution) {
            let width = name.chars().count().max(at.len()).max(10);
            columns.push(Column { name, at: at.into(), scores, width, spectrum: is_main.then_some(k) });
        }
    }
    columns
}

/// Returns the table: one line per figure; of every candidate the scores at the truth's pixel and at its resolution. The text ends with a
/// newline.
#[must_use]
pub fn table(summary: impl Into<ReportSummary>, details: &Details) -> String {
    let summary = summary.into();
    let lines = LINES.iter().map(|(name, unit, _)| (name, unit));
    let lines = lines.chain(SPECTRAL_LINES.iter().map(|(name, unit, _)| (name, unit)));
    let heading = lines.map(|(name, unit)| name.len() + unit.len() + 3).max().unwrap_or(0);
    let names = short_names(&summary);
    let columns = columns(&summary, &names);
    let mut text = format!(
        "against {}: {} of {} valid pixels, {:.3} x {:.3} m, {}\n{:heading$}",
        summary.truth,
        summary.common_pixels,
        summary.truth_pixels,
        summary.pixel.row_m,
        summary.pixel.col_m,
        match summary.resolution_m {
            Some(m) => format!("as they are and at a resolution of {m:.1} m"),
            None => "as they are; with --truth-resolution-m also at what the truth resolves".into(),
        },
        ""
    );
    columns.iter().for_each(|Column { name, width, .. }| text += &format!("  {name:>width$}"));
    text += &format!("\n{:heading$}", "");
    columns.iter().for_each(|Column { at, width, .. }| text += &format!("  {at:>width$}"));
    text.push('\n');
    for (name, unit, figure) in LINES {
        text += &format!("{:heading$}", format!("{name} [{unit}]"));
        for Column { scores, width, .. } in &columns {
            text += &format!("  {:>width$.3}", figure(scores));
        }
        text.push('\n');
    }
    if !details.spectra.is_empty() {
        text += &spectral_lines(&details.spectra, heading, &columns);
        text += &format!("\n{}", octaves_table(&names, &details.spectra));
    }
    if let Some(found) = &details.calibration {
        text += &format!("\n{}", found.table());
        if summary.resolution_m.is_some() {
            text +=
                "expected errors are those of the DTM's own grid, errors those at the resolution of the comparison\n";
        }
    }
    text
}

fn spectral_lines(spectra: &[Option<Spectral>], heading: usize, columns: &[Column]) -> String {
    let mut text = String::new();
    for (k, (name, unit, figure)) in SPECTRAL_LINES.iter().enumerate() {
        text += &format!("{:heading$}", format!("{name} [{unit}]"));
        for Column { width, spectrum, .. } in columns {
            let one = spectrum.and_then(|spectrum| spectra.get(spectrum)?.as_ref());
            let bound = k == 0 && one.and_then(|s| s.half_coherence).is_some_and(|half| half.at_most);
            let figure = one.and_then(figure);
            let cell = figure.map_or_else(|| "-".into(), |v| format!("{}{v:.3}", if bound { "<= " } else { "" }));
            let cell = if spectrum.is_some() { cell } else { String::new() };
            text += &format!("  {cell:>width$}");
        }
        text.push('\n');
    }
    text
}

/// Returns file names without their folders, unless two candidates would then have the same name.
#[must_use]
pub fn short_names(summary: &ReportSummary) -> Vec<String> {
    let full: Vec<String> = summary.candidates.iter().map(|both| both.name.clone()).collect();
    let short: Vec<String> = full
        .iter()
        .map(|name| {
            Path::new(name).file_name().map_or_else(|| name.clone(), |file| file.to_string_lossy().into_owned())
        })
        .collect();
    let distinct = short.iter().collect::<BTreeSet<_>>().len() == short.len();
    if distinct { short } else { full }
}

/// Returns the comparison as JSON: one object, units in the names, shares in [0, 1]. The figures of a candidate are those at the truth's
/// resolution, if it is known, otherwise at the pixel; `at_pixel` and `at_resolution` hold both.
#[must_use]
pub fn json(summary: impl Into<ReportSummary>, details: &Details) -> String {
    let summary = summary.into();
    let mut candidates: Vec<Value> = summary.candidates.iter().map(candidate).collect();
    for (object, found) in candidates.iter_mut().zip(&details.spectra) {
        found.iter().for_each(|found| found.add_to(object));
    }
    let mut whole = value!({
        "truth": summary.truth,
        "truth_pixels": summary.truth_pixels,
        "common_pixels": summary.common_pixels,
        "pixel_row_m": summary.pixel.row_m,
        "pixel_col_m": summary.pixel.col_m,
        "resolution_m": summary.resolution_m,
        "candidates": candidates,
    });
    if let Some(found) = &details.calibration {
        whole["expected_errors"] = found.json();
    }
    format!("{whole:#}")
}

fn candidate(both: &Both) -> Value {
    let mut object = both.main().map_or_else(|| value!({}), scores);
    object["name"] = both.name.clone().into();
    object["at_pixel"] = both.at_pixel.as_ref().map_or(Value::Null, scores);
    object["at_resolution"] = both.at_resolution.as_ref().map_or(Value::Null, scores);
    object
}

fn scores(scores: &Scores) -> Value {
    let mut object = serde_json::to_value(scores).unwrap_or_default();
    // Each of these gets a separate name below.
    let arrays = ["share_within", "error_percentiles_m", "slope_error_percentiles_deg"];
    object.as_object_mut().into_iter().for_each(|object| object.retain(|name, _| !arrays.contains(&name.as_str())));
    for (limit_m, share) in LIMITS_M.iter().zip(scores.share_within) {
        object[format!("share_within_{limit_m}_m")] = share.into();
    }
    for (k, percent) in PERCENTILES.iter().enumerate() {
        object[format!("error_{percent}_m")] = scores.error_percentiles_m[k].into();
        object[format!("slope_error_{percent}_deg")] = scores.slope_error_percentiles_deg[k].into();
    }
    object
}
