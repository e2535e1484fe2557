//! The section of a page about each kind of folder.

use super::html::{Cell, Picture, escaped, figure, table};
use crate::experiment::train::TRAINING;
use crate::experiment::{ExperimentResults, TEST, table as comparison_tables};
use crate::suite::results::{SceneResult, SuiteResults};
use crate::suite::tables::{self, TextTable};
use elunar_base::Result;
use elunar_learn::train::curves::{CURVES, draw};
use elunar_learn::train::run::RunRecord;
use std::path::Path;

/// Returns the section about a test suite.
pub(super) fn suite(folder: &Path, results: &SuiteResults) -> Result<String> {
    let methods: String = results
        .methods
        .iter()
        .map(|method| {
            let anchored = if method.anchor { "; anchored to the coarse DTM" } else { "" };
            let aligned = match method.co_alignment {
                elunar_evaluate::CoAlignment::None => "",
                elunar_evaluate::CoAlignment::Fit => "; fitted to the coarse DTM",
                elunar_evaluate::CoAlignment::LowPass => "; fitted to the coarse DTM, low frequencies exchanged",
            };
            let (name, about) = (escaped(&method.name), escaped(&method.description));
            format!("<li>{name}: <code>{about}</code>{anchored}{aligned}</li>\n")
        })
        .collect();
    let cross = tables::cross(results);
    let two_suns = if cross.rows.is_empty() {
        String::new()
    } else {
        format!(
            "<h3>The same ground under two Suns</h3>\n<p class=\"faint\">The ratio is the difference of the two DTMs over their error: 0 \
             if both Suns tell the same, 1.4 if their errors have nothing in common. Errors of the coarse DTM, which both share, make \
             it small; the short waves have none of those.</p>\n{}",
            html(&cross)
        )
    };
    let learning = tables::learning(results);
    let learning = if learning.rows.is_empty() {
        String::new()
    } else {
        format!(
            "<h3>What learning adds</h3>\n<p class=\"faint\">Errors over those of the pipeline without training (untrained: coarse DTM plus \
             photoclinometry), and over those of the coarse DTM.</p>\n{}",
            html(&learning)
        )
    };
    let pictures: String = results.scenes.iter().map(|scene| pictures(folder, scene)).collect::<Result<_>>()?;
    Ok(format!(
        "<h2>Test scenes: {}</h2>\n<p>{}</p>\n<ul>\n{methods}</ul>\n{learning}<h3>Sums</h3>\n{}<p class=\"faint\">Means over scenes; RMSE is \
         the root of the mean square. Slope vector error: mean length of the difference between predicted and true gradient. Short waves: \
         the heights minus their Gaussian low-pass that halves waves of 60 m (or of the coarse DTM's pixel, where that is wider). \
         Bright and shaded ground falls towards and away from the Sun by 3° or more.</p>\n<h3>Scenes</h3>\n{}{two_suns}{pictures}",
        escaped(&results.suite),
        escaped(results.about.trim()),
        html(&tables::sums(results)),
        html(&tables::scenes(results))
    ))
}

fn pictures(folder: &Path, scene: &SceneResult) -> Result<String> {
    let angle = |deg: Option<f64>| deg.map_or_else(|| "unknown".into(), |deg| format!("{deg:.0}°"));
    let (azimuth, elevation) = scene.sun_deg;
    let figures: String = scene
        .pictures
        .iter()
        .map(|(file, caption)| figure(&Picture { file: folder.join(file), caption: caption.clone() }))
        .collect::<Result<_>>()?;
    let weak = if scene.weak_truth { " Weak truth: left out of the sums." } else { "" };
    Ok(format!(
        "<h3>{}</h3>\n<p class=\"faint\">{}, {} × {} pixels of {:.2} m, coarse DTM of {:.0} m; Sun from azimuth {}, {} high; {} of {} \
         pixels scored.{weak} {}</p>\n{figures}",
        escaped(&scene.name),
        escaped(&scene.kind),
        scene.shape.0,
        scene.shape.1,
        scene.pixel_m.0,
        scene.coarse_m,
        angle(azimuth),
        angle(elevation),
        scene.pixels.0,
        scene.pixels.1,
        escaped(&scene.remarks)
    ))
}

/// Returns the section about a comparison of experiments, with its test suite.
pub(super) fn experiments(folder: &Path, comparison: &ExperimentResults) -> Result<String> {
    let answers: String = comparison
        .trained
        .iter()
        .map(|one| {
            format!(
                "<li><strong>{}</strong>: {}</li>\n",
                escaped(&one.experiment.name),
                escaped(&one.experiment.answers)
            )
        })
        .collect();
    let picture = |file: &str, caption: &str| figure(&Picture { file: folder.join(file), caption: caption.into() });
    let curves: String = comparison
        .trained
        .iter()
        .map(|one| {
            let name = &one.experiment.name;
            picture(&format!("{name}/{TRAINING}/{CURVES}"), name)
        })
        .collect::<Result<_>>()?;
    Ok(format!(
        "<h2>Experiments</h2>\n<ul>\n{answers}</ul>\n<h3>Validation tiles</h3>\n{}<p class=\"faint\">a1 to PSNR in the range each \
         network was trained in, brought to [0, 50]; metres and degrees against the truth as it is.</p>\n<div class=\"chart\">{}</div>\n{}\
         <h3>Training</h3>\n<div class=\"grid\">\n{curves}</div>\n",
        html(&comparison_tables::validation(comparison)),
        picture(comparison_tables::CURVES, "Validation of all runs")?,
        suite(&folder.join(TEST), &comparison.test)?
    ))
}

/// Returns the section about a training run.
pub(super) fn training(folder: &Path) -> Result<String> {
    let record = RunRecord::read(folder)?;
    draw(folder)?;
    let picture = Picture { file: folder.join(CURVES), caption: format!("{} steps", record.recipe.steps) };
    let about = serde_json::to_string_pretty(&record).unwrap_or_default();
    Ok(format!(
        "<h2>Training run {}</h2>\n<div class=\"chart\">{}</div>\n<details><summary>Record</summary><pre>{}</pre></details>\n",
        escaped(&folder.display().to_string()),
        figure(&picture)?,
        escaped(&about)
    ))
}

/// Returns a table. In every group of rows (equal first cells), the best is marked if the column has a merit.
pub(super) fn html(of: &TextTable) -> String {
    let merits: Vec<Option<f64>> = of.heading.iter().map(|heading| merit(heading)).collect();
    let cell = |row: &Vec<String>, col: usize| {
        let text = row[col].clone();
        let best = merits[col].is_some_and(|sign| {
            let group = of.rows.iter().filter(|other| other[0] == row[0]);
            let values: Vec<f64> = group.filter_map(|other| Some(sign * other[col].parse::<f64>().ok()?)).collect();
            let (low, high) =
                values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
            low < high && text.parse::<f64>().is_ok_and(|v| sign * v == high)
        });
        Cell { text, best }
    };
    let rows: Vec<Vec<Cell>> = of.rows.iter().map(|row| (0..row.len()).map(|col| cell(row, col)).collect()).collect();
    table(&of.heading.iter().map(String::as_str).collect::<Vec<_>>(), &rows)
}

/// Returns, by a column's heading, 1 if larger values are better, -1 if smaller values are better; `None` if neither.
fn merit(heading: &str) -> Option<f64> {
    let has = |words: &[&str]| words.iter().any(|word| heading.contains(word));
    if has(&["|e|<", "correlation"]) {
        Some(1.0)
    } else if has(&["RMSE", "MAE", "error", "ratio", "difference", "time"]) {
        Some(-1.0)
    } else {
        None
    }
}
