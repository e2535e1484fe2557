//! A comparison as text and as JSON.

use super::spectral::{Spectral, octaves_table};
use super::{Comparison, Details, PERCENTILES, Scored};
use elunar_core::metrics::height::LIMITS_M;
use serde_json::{Value, json as value};
use std::collections::BTreeSet;
use std::path::Path;

/// A row of the table: heading, unit, and the function that returns the figure.
type Line = (&'static str, &'static str, fn(&Scored) -> f64);

const LINES: [Line; 23] = [
    ("|error| < 2 m", "%", |j| 100.0 * j.scores.share_within[0]),
    ("|error| < 4 m", "%", |j| 100.0 * j.scores.share_within[1]),
    ("|error| < 10 m", "%", |j| 100.0 * j.scores.share_within[2]),
    ("MAE", "m", |j| j.scores.mae_m),
    ("RMSE", "m", |j| j.scores.rmse_m),
    ("RMSE, median removed", "m", |j| j.scores.rmse_median_removed_m),
    ("mean error", "m", |j| j.scores.bias_m),
    ("median error", "m", |j| j.scores.median_m),
    ("NMAD", "m", |j| j.scores.nmad_m),
    ("50 % of |error| below", "m", |j| j.scores.error_percentiles_m[0]),
    ("68 % of |error| below", "m", |j| j.scores.error_percentiles_m[1]),
    ("90 % of |error| below", "m", |j| j.scores.error_percentiles_m[2]),
    ("95 % of |error| below", "m", |j| j.scores.error_percentiles_m[3]),
    ("99 % of |error| below", "m", |j| j.scores.error_percentiles_m[4]),
    ("largest |error|", "m", |j| j.scores.largest_m),
    ("slope MAE", "deg", |j| j.scores.slope_mae_deg),
    ("slope RMSE", "deg", |j| j.scores.slope_rmse_deg),
    ("slope mean error", "deg", |j| j.scores.slope_bias_deg),
    ("50 % of |slope error| below", "deg", |j| j.scores.slope_error_percentiles_deg[0]),
    ("68 % of |slope error| below", "deg", |j| j.scores.slope_error_percentiles_deg[1]),
    ("90 % of |slope error| below", "deg", |j| j.scores.slope_error_percentiles_deg[2]),
    ("95 % of |slope error| below", "deg", |j| j.scores.slope_error_percentiles_deg[3]),
    ("99 % of |slope error| below", "deg", |j| j.scores.slope_error_percentiles_deg[4]),
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

/// Returns the table: one column per candidate, one line per figure. The text ends with a newline.
#[must_use]
pub fn table(comparison: &Comparison, details: &Details) -> String {
    let names = LINES.iter().map(|(name, unit, _)| (name, unit));
    let names = names.chain(SPECTRAL_LINES.iter().map(|(name, unit, _)| (name, unit)));
    let heading = names.map(|(name, unit)| name.len() + unit.len() + 3).max().unwrap_or(0);
    let names = short_names(comparison);
    let widths: Vec<usize> = names.iter().map(|name| name.chars().count().max(10)).collect();
    let mut text = format!(
        "against {}: {} of {} valid pixels, {:.3} x {:.3} m{}\n{:heading$}",
        comparison.truth,
        comparison.common_pixels,
        comparison.truth_pixels,
        comparison.pixel.row_m,
        comparison.pixel.col_m,
        comparison.resolution_m.map_or_else(String::new, |m| format!(", at a resolution of {m:.1} m")),
        ""
    );
    for (name, width) in names.iter().zip(&widths) {
        text += &format!("  {name:>width$}");
    }
    text.push('\n');
    for (name, unit, figure) in LINES {
        text += &format!("{:heading$}", format!("{name} [{unit}]"));
        for (scored, width) in comparison.scored.iter().zip(&widths) {
            text += &format!("  {:>width$.3}", figure(scored));
        }
        text.push('\n');
    }
    if !details.spectra.is_empty() {
        text += &spectral_lines(&details.spectra, heading, &widths);
        text += &format!("\n{}", octaves_table(&names, &details.spectra));
    }
    if let Some(found) = &details.calibration {
        text += &format!("\n{}", found.table());
        if comparison.resolution_m.is_some() {
            text +=
                "expected errors are those of the DTM's own grid, errors those at the resolution of the comparison\n";
        }
    }
    text
}

fn spectral_lines(spectra: &[Option<Spectral>], heading: usize, widths: &[usize]) -> String {
    let mut text = String::new();
    for (k, (name, unit, figure)) in SPECTRAL_LINES.iter().enumerate() {
        text += &format!("{:heading$}", format!("{name} [{unit}]"));
        for (one, width) in spectra.iter().zip(widths) {
            let bound = k == 0 && one.as_ref().and_then(|s| s.half_coherence).is_some_and(|half| half.at_most);
            let figure = one.as_ref().and_then(figure);
            let cell = figure.map_or_else(|| "-".into(), |v| format!("{}{v:.3}", if bound { "<= " } else { "" }));
            text += &format!("  {cell:>width$}");
        }
        text.push('\n');
    }
    text
}

/// Returns file names without their folders, unless two candidates would then have the same name.
#[must_use]
pub fn short_names(comparison: &Comparison) -> Vec<String> {
    let full: Vec<String> = comparison.scored.iter().map(|j| j.name.clone()).collect();
    let short: Vec<String> = full
        .iter()
        .map(|name| {
            Path::new(name).file_name().map_or_else(|| name.clone(), |file| file.to_string_lossy().into_owned())
        })
        .collect();
    let distinct = short.iter().collect::<BTreeSet<_>>().len() == short.len();
    if distinct { short } else { full }
}

/// Returns the comparison as JSON: one object, units in the names, shares in [0, 1].
#[must_use]
pub fn json(comparison: &Comparison, details: &Details) -> String {
    let mut candidates: Vec<Value> = comparison.scored.iter().map(candidate).collect();
    for (object, found) in candidates.iter_mut().zip(&details.spectra) {
        found.iter().for_each(|found| found.add_to(object));
    }
    let mut whole = value!({
        "truth": comparison.truth,
        "truth_pixels": comparison.truth_pixels,
        "common_pixels": comparison.common_pixels,
        "pixel_row_m": comparison.pixel.row_m,
        "pixel_col_m": comparison.pixel.col_m,
        "resolution_m": comparison.resolution_m,
        "candidates": candidates,
    });
    if let Some(found) = &details.calibration {
        whole["expected_errors"] = found.json();
    }
    format!("{whole:#}")
}

fn candidate(scored: &Scored) -> Value {
    let mut object = serde_json::to_value(scored.scores).unwrap_or_default();
    // Each of these gets a separate name below.
    let arrays = ["share_within", "error_percentiles_m", "slope_error_percentiles_deg"];
    object.as_object_mut().into_iter().for_each(|object| object.retain(|name, _| !arrays.contains(&name.as_str())));
    object["name"] = scored.name.clone().into();
    for (limit_m, share) in LIMITS_M.iter().zip(scored.scores.share_within) {
        object[format!("share_within_{limit_m}_m")] = share.into();
    }
    for (k, percent) in PERCENTILES.iter().enumerate() {
        object[format!("error_{percent}_m")] = scored.scores.error_percentiles_m[k].into();
        object[format!("slope_error_{percent}_deg")] = scored.scores.slope_error_percentiles_deg[k].into();
    }
    object
}
