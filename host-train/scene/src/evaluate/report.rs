//! A comparison as text and as JSON.

use super::{Comparison, Details, Scored};
use elunar_core::metrics::height::LIMITS_M;
use serde_json::{Value, json as value};
use std::collections::BTreeSet;
use std::path::Path;

/// A row of the table: heading, unit, and the function that returns the figure.
type Line = (&'static str, &'static str, fn(&Scored) -> f64);

const LINES: [Line; 14] = [
    ("|error| < 2 m", "%", |j| 100.0 * j.scores.share_within[0]),
    ("|error| < 4 m", "%", |j| 100.0 * j.scores.share_within[1]),
    ("|error| < 10 m", "%", |j| 100.0 * j.scores.share_within[2]),
    ("MAE", "m", |j| j.scores.mae_m),
    ("RMSE", "m", |j| j.scores.rmse_m),
    ("RMSE, median removed", "m", |j| j.scores.rmse_median_removed_m),
    ("mean error", "m", |j| j.scores.bias_m),
    ("median error", "m", |j| j.scores.median_m),
    ("NMAD", "m", |j| j.scores.nmad_m),
    ("95 % of |error| below", "m", |j| j.scores.error_95_m),
    ("largest |error|", "m", |j| j.scores.largest_m),
    ("slope MAE", "deg", |j| j.scores.slope_mae_deg),
    ("slope RMSE", "deg", |j| j.scores.slope_rmse_deg),
    ("slope mean error", "deg", |j| j.scores.slope_bias_deg),
];

/// Returns the table: one column per candidate, one line per figure. The text ends with a newline.
#[must_use]
pub fn table(comparison: &Comparison, details: &Details) -> String {
    let heading = LINES.iter().map(|(name, unit, _)| name.len() + unit.len() + 3).max().unwrap_or(0);
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
    if let Some(found) = &details.calibration {
        text += &format!("\n{}", found.table());
        if comparison.resolution_m.is_some() {
            text +=
                "expected errors are those of the DTM's own grid, errors those at the resolution of the comparison\n";
        }
    }
    text
}

/// Returns file names without their folders, unless two candidates would then have the same name.
fn short_names(comparison: &Comparison) -> Vec<String> {
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
    let candidates: Vec<Value> = comparison.scored.iter().map(candidate).collect();
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
    // Each share gets a separate name below.
    object.as_object_mut().map(|object| object.remove("share_within"));
    object["name"] = scored.name.clone().into();
    for (limit_m, share) in LIMITS_M.iter().zip(scored.scores.share_within) {
        object[format!("share_within_{limit_m}_m")] = share.into();
    }
    object
}
