//! The fits of all tracks as text and as JSON.

use super::shift::Fit;
use serde_json::{Value, json as value};

/// One track of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct ComparedTrack {
    /// File name, with the number of the track if the file holds several.
    pub name: String,
    /// Number of points of the track, on and off the DTM.
    pub points: usize,
    /// The best fit; `None` if too few points lie on valid heights.
    pub fit: Option<Fit>,
}

/// All tracks over one DTM.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Name of the DTM.
    pub dtm: String,
    /// Tracks in the order of the files.
    pub tracks: Vec<ComparedTrack>,
    /// Number of rows whose flag marks them as no measurement of the ground.
    pub flagged: usize,
}

/// Returns means over the tracks that were compared, each track with equal weight: (STD, STD unshifted, STD with the median removed),
/// metres.
fn means(report: &Report) -> Option<(f64, f64, f64)> {
    let fits: Vec<&Fit> = report.tracks.iter().filter_map(|track| track.fit.as_ref()).collect();
    let mean = |of: fn(&Fit) -> f64| fits.iter().map(|fit| of(fit)).sum::<f64>() / fits.len() as f64;
    (!fits.is_empty()).then(|| (mean(|f| f.std_m), mean(|f| f.std_unshifted_m), mean(|f| f.std_median_removed_m)))
}

/// Returns the table: one line per track. The text ends with a newline.
#[must_use]
pub fn table(report: &Report) -> String {
    let width = report.tracks.iter().map(|track| track.name.chars().count()).max().unwrap_or(0).max(5);
    let compared = report.tracks.iter().filter(|track| track.fit.is_some()).count();
    let mut text = format!(
        "{}: {compared} of {} tracks compared, {} flagged rows left out; metres\n{:width$}  {:>7} {:>9} {:>9} {:>8} {:>8} {:>9} {:>11}\n",
        report.dtm,
        report.tracks.len(),
        report.flagged,
        "track",
        "points",
        "unshifted",
        "STD",
        "shift x",
        "shift y",
        "median",
        "STD-median"
    );
    for track in &report.tracks {
        text += &format!("{:width$}  ", track.name);
        text += &match &track.fit {
            None => format!("{:>7} too few on valid heights\n", track.points),
            Some(fit) => format!(
                "{:>7} {:>9.3} {:>9.3} {:>8.2} {:>8.2} {:>9.3} {:>11.3}{}\n",
                fit.points,
                fit.std_unshifted_m,
                fit.std_m,
                fit.x_m,
                fit.y_m,
                fit.median_m,
                fit.std_median_removed_m,
                if fit.at_edge { "  at the search's edge" } else { "" }
            ),
        };
    }
    if let Some((std_m, unshifted_m, median_m)) = means(report) {
        text += &format!(
            "{:width$}  {:>7} {unshifted_m:>9.3} {std_m:>9.3} {:>8} {:>8} {:>9} {median_m:>11.3}\n",
            "mean", "", "", "", ""
        );
    }
    text
}

/// Returns the report as JSON.
#[must_use]
pub fn json(report: &Report) -> Value {
    let track = |track: &ComparedTrack| match &track.fit {
        None => value!({ "track": track.name, "points": track.points, "judged": false }),
        Some(fit) => value!({
            "track": track.name, "points": track.points, "judged": true, "compared": fit.points,
            "std_m": fit.std_m, "std_unshifted_m": fit.std_unshifted_m, "shift_x_m": fit.x_m, "shift_y_m": fit.y_m,
            "median_m": fit.median_m, "std_median_removed_m": fit.std_median_removed_m, "at_edge": fit.at_edge,
        }),
    };
    let means = means(report).map(|(std_m, unshifted_m, median_m)| {
        value!({ "std_m": std_m, "std_unshifted_m": unshifted_m, "std_median_removed_m": median_m })
    });
    let tracks: Vec<Value> = report.tracks.iter().map(track).collect();
    value!({ "dtm": report.dtm, "flagged_rows": report.flagged, "tracks": tracks, "mean": means })
}
