//! The scores as tables: Markdown for reading, CSV for computing. Both, and the report, use the same columns.

use super::results::{COARSE, MethodScores, SuiteResults};
use super::summary::{SuiteSummary, summaries};
use elunar_base::Result;
use elunar_base::table::to_csv;

/// A table of text: heading and rows of the same length.
#[derive(Debug, Clone, PartialEq)]
pub struct TextTable {
    /// Names of the columns, with units.
    pub heading: Vec<String>,
    /// The rows.
    pub rows: Vec<Vec<String>>,
}

/// Returns a figure with this number of digits; a dash if there is none.
fn digits(value: Option<f64>, digits: usize) -> String {
    let text = value.filter(|v| v.is_finite()).map_or_else(|| "–".into(), |v| format!("{v:.digits$}"));
    // A small negative figure is not "-0.00".
    match text.strip_prefix('-') {
        Some(size) if size.chars().all(|c| "0.".contains(c)) => size.into(),
        _ => text,
    }
}

/// Headings of the figures of a method, on a scene or over several.
const FIGURES: [&str; 17] = [
    "|e|<2 m, %",
    "|e|<4 m, %",
    "|e|<10 m, %",
    "MAE, m",
    "RMSE, m",
    "RMSE / coarse",
    "slope MAE, °",
    "slope vector error",
    "its ratio to coarse",
    "RMSE long waves, m",
    "RMSE short waves, m",
    "correlation short waves",
    "slope vector error, bright",
    "slope vector error, shaded",
    "hillshade–image correlation",
    "time, s",
    "half-coherence wavelength, m",
];

fn heading(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_string()).collect()
}

/// Returns what learning adds: the errors of every method over those of the pipeline without training. Empty for results without it.
#[must_use]
pub fn learning(results: &SuiteResults) -> TextTable {
    let names = [
        "scenes",
        "method",
        "RMSE / untrained",
        "slope vector error / untrained",
        "RMSE / coarse",
        "slope vector error / coarse",
    ];
    let compared = |sum: &SuiteSummary| sum.method != COARSE && sum.rmse_over_untrained.is_some();
    let row = |sum: &SuiteSummary| {
        let words = vec![sum.kind.clone(), sum.method.clone()];
        let ratios =
            [sum.rmse_over_untrained, sum.slope_vector_over_untrained, Some(sum.rmse_ratio), sum.slope_vector_ratio];
        [words, ratios.map(|ratio| digits(ratio, 3)).to_vec()].concat()
    };
    let rows = summaries(results).iter().filter(|sum| compared(sum)).map(row).collect();
    TextTable { heading: heading(&names), rows }
}

/// Returns the table of every method on every scene: the paper's Table VI, and the relief.
#[must_use]
pub fn scenes(results: &SuiteResults) -> TextTable {
    let heading = heading(&[&["scene", "method"][..], &FIGURES, &["offset down, px", "offset right, px"]].concat());
    let mut rows = vec![];
    for scene in &results.scenes {
        let coarse = scene.scored.first();
        rows.extend(scene.scored.iter().map(|scored| [vec![scene.name.clone()], scene_row(scored, coarse)].concat()));
    }
    TextTable { heading, rows }
}

fn scene_row(scored: &MethodScores, coarse: Option<&MethodScores>) -> Vec<String> {
    let (heights, relief) = (&scored.heights, &scored.relief);
    let percent = |k: usize| digits(Some(100.0 * heights.share_within[k]), 1);
    let offset = scored.spectral.as_ref().and_then(|found| found.registration);
    let slope_ratio =
        relief.slope_vector_error.zip(coarse.and_then(|c| c.relief.slope_vector_error)).map(|(a, b)| a / b);
    vec![
        scored.method.clone(),
        percent(0),
        percent(1),
        percent(2),
        digits(Some(heights.mae_m), 2),
        digits(Some(heights.rmse_m), 2),
        digits(coarse.map(|c| heights.rmse_m / c.heights.rmse_m), 3),
        digits(Some(heights.slope_mae_deg), 2),
        digits(relief.slope_vector_error, 4),
        digits(slope_ratio, 3),
        digits(relief.low_pass_rmse_m, 2),
        digits(relief.high_pass_rmse_m, 3),
        digits(relief.high_pass_correlation, 3),
        digits(relief.bright.map(|side| side.slope_vector_error), 4),
        digits(relief.shaded.map(|side| side.slope_vector_error), 4),
        digits(relief.shading_correlation, 3),
        digits(scored.seconds, 1),
        half_coherence(scored),
        digits(offset.map(|found| found.down_px), 2),
        digits(offset.map(|found| found.right_px), 2),
    ]
}

/// Returns the half-coherence wavelength; with "≤" if the true one may be shorter.
fn half_coherence(scored: &MethodScores) -> String {
    match scored.spectral.as_ref().and_then(|found| found.half_coherence) {
        Some(half) if half.at_most => format!("≤{:.1}", half.wavelength_m),
        half => digits(half.map(|half| half.wavelength_m), 1),
    }
}

/// Returns the table of every method over every kind of scene, and over all.
#[must_use]
pub fn sums(results: &SuiteResults) -> TextTable {
    let heading = heading(&[&["scenes", "method", "number"][..], &FIGURES].concat());
    TextTable { heading, rows: summaries(results).iter().map(sum_row).collect() }
}

fn sum_row(sum: &SuiteSummary) -> Vec<String> {
    let percent = |k: usize| digits(Some(100.0 * sum.share_within[k]), 1);
    vec![
        sum.kind.clone(),
        sum.method.clone(),
        sum.scenes.to_string(),
        percent(0),
        percent(1),
        percent(2),
        digits(Some(sum.mae_m), 2),
        digits(Some(sum.rmse_m), 2),
        digits(Some(sum.rmse_ratio), 3),
        digits(Some(sum.slope_mae_deg), 2),
        digits(sum.slope_vector_error, 4),
        digits(sum.slope_vector_ratio, 3),
        digits(sum.low_pass_rmse_m, 2),
        digits(sum.high_pass_rmse_m, 3),
        digits(sum.high_pass_correlation, 3),
        digits(sum.sides.map(|sides| sides.0), 4),
        digits(sum.sides.map(|sides| sides.1), 4),
        digits(sum.shading_correlation, 3),
        digits(sum.seconds, 1),
        digits(sum.half_coherence_m, 1),
    ]
}

/// Returns the table of grounds under two Suns (Fig. 14), which may be empty.
#[must_use]
pub fn cross(results: &SuiteResults) -> TextTable {
    let names = [
        "ground",
        "method",
        "scenes",
        "difference of the two DTMs, m",
        "RMSE of both, m",
        "ratio",
        "difference of short waves, m",
        "error of short waves, m",
    ];
    let row = |found: &super::results::CrossResult| {
        vec![
            found.ground.clone(),
            found.method.clone(),
            format!("{}, {}", found.scenes.0, found.scenes.1),
            digits(Some(found.difference_m), 3),
            digits(Some(found.rmse_m), 3),
            digits(Some(found.ratio()), 3),
            digits(found.high_pass_m.0, 3),
            digits(found.high_pass_m.1, 3),
        ]
    };
    TextTable { heading: heading(&names), rows: results.cross.iter().map(row).collect() }
}

impl TextTable {
    /// Returns the table as Markdown, or an empty text without rows.
    #[must_use]
    pub fn markdown(&self) -> String {
        if self.rows.is_empty() {
            return String::new();
        }
        let line = |cells: &[String]| {
            let cells: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let rule = format!("|{}\n", "---|".repeat(self.heading.len()));
        let rows: String = self.rows.iter().map(|row| line(row)).collect();
        format!("{}{rule}{rows}", line(&self.heading))
    }

    /// Returns the table as CSV. A dash becomes an empty cell, and "≤" is left out.
    ///
    /// # Errors
    /// If a row and the heading differ in length.
    pub fn csv(&self) -> Result<Vec<u8>> {
        let cell = |text: &String| {
            if text == "–" { String::new() } else { text.trim_start_matches('≤').into() }
        };
        to_csv(std::iter::once(&self.heading).chain(&self.rows).map(|cells| cells.iter().map(cell)))
    }
}

/// Returns the results of the whole suite in Markdown.
#[must_use]
pub fn markdown(results: &SuiteResults) -> String {
    let methods: String = results
        .methods
        .iter()
        .map(|m| format!("- {}: {}{}\n", m.name, m.description, if m.anchor { "; anchored" } else { "" }))
        .collect();
    let remarks: String = results
        .scenes
        .iter()
        .filter(|scene| !scene.remarks.is_empty())
        .map(|scene| format!("- {}: {}\n", scene.name, scene.remarks))
        .collect();
    let cross = cross(results).markdown();
    let cross = if cross.is_empty() { cross } else { format!("\n## The same ground under two Suns\n\n{cross}") };
    let learning = learning(results).markdown();
    let learning = if learning.is_empty() { learning } else { format!("\n## What learning adds\n\n{learning}") };
    format!(
        "# Suite {}\n\n{}\n\n{methods}{learning}\n## Sums\n\n{}\n## Scenes\n\n{}{cross}\n{remarks}",
        results.suite,
        results.about.trim(),
        sums(results).markdown(),
        scenes(results).markdown()
    )
}

#[cfg(test)]
mod tests {
    use super::super::summary::tests::{results, with_untrained};
    use super::*;

    #[test]
    fn headings_fit_their_rows_and_figures_are_there() {
        let results = results();
        for table in [scenes(&results), sums(&results), cross(&results)] {
            assert!(!table.rows.is_empty());
            assert!(table.rows.iter().all(|row| row.len() == table.heading.len()), "{table:?}");
        }
        let text = markdown(&results);
        assert!(text.contains("| one | net | 50.0 | 75.0 | 100.0 | 0.75 | 1.50 | 0.500 |"), "{text}");
        assert!(text.contains("| g | net | one, two | 1.000 | 2.000 | 0.500 | 0.200 | – |"), "{text}");
        assert!(text.contains("\\|e\\|<2 m"));
        assert!(text.contains("| – | 60.0 | 0.50 | -0.25 |"), "{text}");
    }

    #[test]
    fn what_learning_adds_is_stated_first() {
        let text = markdown(&with_untrained());
        assert!(text.contains("| highland | net | 0.800 | 0.500 | 0.500 | 0.333 |"), "{text}");
        assert!(text.contains("| highland | untrained | 1.000 | 1.000 |"), "{text}");
        assert!(!text.contains("| highland | coarse DTM | 1.6"), "{text}");
        assert!(text.find("## What learning adds").unwrap() < text.find("## Sums").unwrap());
        // Results of an older program have no such row.
        assert!(learning(&results()).rows.is_empty() && !markdown(&results()).contains("What learning adds"));
    }

    #[test]
    fn csv_quotes_what_it_must() {
        let csv = String::from_utf8(scenes(&results()).csv().unwrap()).unwrap();
        let mut lines = csv.lines();
        assert!(lines.next().unwrap().contains("\"|e|<2 m, %\""));
        let cells = |line: &str| line.split(',').map(String::from).collect::<Vec<_>>();
        let first = cells(lines.next().unwrap());
        assert_eq!((first[0].as_str(), first[6].as_str(), first[17].as_str()), ("one", "3.00", ""));
    }
}
