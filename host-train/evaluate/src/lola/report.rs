//! The fits of all tracks as text and as JSON.

use super::shift::{Fit, Shifted};
use serde_json::{Value, json as value};
use std::collections::BTreeMap;

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

/// Figures of a fit that are averaged over the tracks, each track with equal weight, metres.
type Figure = fn(&Fit) -> f64;

/// The answer's deviation without the median, and its Eq. 18; the same without a shift; the smallest of Eq. 18.
const MEANS: [(&str, Figure); 5] = [
    ("std_median_removed_m", |fit| fit.median_removed.std_median_removed_m),
    ("std_m", |fit| fit.median_removed.std_m),
    ("std_median_removed_unshifted_m", |fit| fit.unshifted.std_median_removed_m),
    ("std_unshifted_m", |fit| fit.unshifted.std_m),
    ("eq_18_std_m", |fit| fit.eq_18.std_m),
];

/// Returns the means over the tracks that were compared; `None` without one.
fn means(report: &Report) -> Option<[f64; MEANS.len()]> {
    let fits: Vec<&Fit> = report.tracks.iter().filter_map(|track| track.fit.as_ref()).collect();
    let mean = |of: Figure| fits.iter().map(|fit| of(fit)).sum::<f64>() / fits.len() as f64;
    (!fits.is_empty()).then(|| MEANS.map(|(_, of)| mean(of)))
}

/// Returns the table: one line per track. The text ends with a newline.
#[must_use]
pub fn table(report: &Report) -> String {
    let width = report.tracks.iter().map(|track| track.name.chars().count()).max().unwrap_or(0).max(5);
    let compared = report.tracks.iter().filter(|track| track.fit.is_some()).count();
    let (dtm, tracks, flagged) = (&report.dtm, report.tracks.len(), report.flagged);
    let mut text = format!("{dtm}: {compared} of {tracks} tracks compared, {flagged} flagged rows left out; metres\n");
    text += &format!("{:width$}  {:>7}  {:>38}  {:>28}\n", "", "", "median removed", "Eq. 18, no median removed");
    text += &format!(
        "{:width$}  {:>7}  {:>9} {:>9} {:>8} {:>8} {:>9}",
        "track", "points", "unshifted", "STD", "shift x", "shift y", "median"
    );
    text += &format!("  {:>9} {:>9} {:>8} {:>8}\n", "unshifted", "STD", "shift x", "shift y");
    for track in &report.tracks {
        text += &format!("{:width$}  ", track.name);
        text += &match &track.fit {
            None => format!("{:>7} too few on valid heights\n", track.points),
            Some(fit) => format!("{:>7}  {}\n", fit.points, cells(fit)),
        };
    }
    if let Some([std_m, _, unshifted_m, eq_18_unshifted_m, eq_18_m]) = means(report) {
        text += &format!("{:width$}  {:>7}  {unshifted_m:>9.3} {std_m:>9.3} {:>8} {:>8} {:>9}", "mean", "", "", "", "");
        text += &format!("  {eq_18_unshifted_m:>9.3} {eq_18_m:>9.3}\n");
    }
    text
}

fn cells(fit: &Fit) -> String {
    let Fit { unshifted, median_removed: best, eq_18, .. } = fit;
    let mut text = format!("{:>9.3} {:>9.3}", unshifted.std_median_removed_m, best.std_median_removed_m);
    text += &format!(" {:>8.2} {:>8.2} {:>9.3}", best.x_m + 0.0, best.y_m + 0.0, best.median_m);
    text +=
        &format!("  {:>9.3} {:>9.3} {:>8.2} {:>8.2}", unshifted.std_m, eq_18.std_m, eq_18.x_m + 0.0, eq_18.y_m + 0.0);
    let edges = [(best, "the shift"), (eq_18, "the shift of Eq. 18")].into_iter().filter(|(at, _)| at.at_edge);
    let edges: Vec<&str> = edges.map(|(_, name)| name).collect();
    if edges.is_empty() { text } else { format!("{text}  {} at the search's edge", edges.join(" and ")) }
}

/// Returns the report as JSON.
#[must_use]
pub fn json(report: &Report) -> Value {
    // No minus before a zero.
    let shifted = |at: &Shifted| {
        value!({
            "std_m": at.std_m, "shift_x_m": at.x_m + 0.0, "shift_y_m": at.y_m + 0.0, "median_m": at.median_m,
            "std_median_removed_m": at.std_median_removed_m, "at_edge": at.at_edge,
        })
    };
    let track = |track: &ComparedTrack| {
        let Some(fit) = &track.fit else {
            return value!({ "track": track.name, "points": track.points, "judged": false });
        };
        let mut object = shifted(&fit.median_removed);
        object["track"] = track.name.clone().into();
        object["points"] = track.points.into();
        object["judged"] = true.into();
        object["compared"] = fit.points.into();
        object["std_unshifted_m"] = fit.unshifted.std_m.into();
        object["std_median_removed_unshifted_m"] = fit.unshifted.std_median_removed_m.into();
        object["eq_18"] = shifted(&fit.eq_18);
        object
    };
    let means = means(report)
        .map(|means| MEANS.iter().zip(means).map(|((name, _), mean)| (*name, mean)).collect::<BTreeMap<_, _>>());
    let tracks: Vec<Value> = report.tracks.iter().map(track).collect();
    value!({ "dtm": report.dtm, "flagged_rows": report.flagged, "tracks": tracks, "mean": means })
}
