//! Tables and curves of all experiments.

use super::ExperimentResults;
use super::train::TRAINING;
use crate::suite::tables::{TextTable, cross, learning, scenes, sums};
use elunar_base::Result;
use elunar_learn::train::curves::History;
use elunar_picture::{Chart, Series, curves as draw};
use std::path::Path;

/// File name of the picture of all validations.
pub const CURVES: &str = "curves.png";
/// Upper end of the range of normalised figures: the paper's NR.
const RANGE: f64 = 50.0;

/// Returns the paper's Table V: scores on the validation tiles in normalised units. As in the paper, every network is scored in the range
/// it was trained in, scaled to [0, 50]. In metres and degrees, the coarse DTM and the pipeline without training are beside it: they have no
/// row of their own, because experiments may differ in their validation tiles.
#[must_use]
pub fn validation(comparison: &ExperimentResults) -> TextTable {
    let heading = [
        "experiment",
        "like",
        "what differs",
        "a1",
        "a2",
        "a3",
        "REL",
        "RMSE",
        "log10",
        "PSNR, dB",
        "RMSE, m",
        "untrained, m",
        "coarse DTM, m",
        "slope MAE, °",
        "untrained, °",
        "coarse DTM, °",
        "parameters",
        "steps",
        "steps/s",
    ];
    let rows = comparison.trained.iter().map(|one| {
        let (v, experiment) = (&one.validation, &one.experiment);
        let rmse = v.rmse * RANGE / f64::from(experiment.network.nr);
        let ratios = [v.a1, v.a2, v.a3, v.rel, rmse, v.log10].map(|figure| format!("{figure:.3}"));
        let metres =
            [Some(v.network), v.untrained, Some(v.coarse)].map(|scores| scores.map(|s| (s.rmse_m, s.slope_mae_deg)));
        let [rmse_m, slope_deg] = [metres.map(|m| m.map(|m| m.0)), metres.map(|m| m.map(|m| m.1))];
        let ground = std::iter::once(Some(v.psnr_db)).chain(rmse_m).chain(slope_deg);
        let ground: Vec<String> =
            ground.map(|figure| figure.map_or_else(|| "–".into(), |figure| format!("{figure:.2}"))).collect();
        let words = [experiment.name.clone(), experiment.like.clone(), experiment.changes.join("; ")];
        let run = [one.parameters.to_string(), experiment.recipe.steps.to_string(), format!("{:.2}", one.steps_per_s)];
        [words.to_vec(), ratios.to_vec(), ground, run.to_vec()].concat()
    });
    TextTable { heading: heading.map(String::from).to_vec(), rows: rows.collect() }
}

/// Returns the whole comparison in Markdown.
#[must_use]
pub fn markdown(comparison: &ExperimentResults) -> String {
    let answers: String = comparison
        .trained
        .iter()
        .map(|one| format!("- {}: {}\n", one.experiment.name, one.experiment.answers.trim()))
        .collect();
    let test = &comparison.test;
    let two_suns = cross(test).markdown();
    let two_suns =
        if two_suns.is_empty() { two_suns } else { format!("\n## The same ground under two Suns\n\n{two_suns}") };
    format!(
        "# Experiments\n\n{answers}\n## Validation tiles\n\nIn the range each network was trained in, brought to [0, 50]; heights and \
         slopes against the truth as it is. Untrained: coarse DTM plus photoclinometry.\n\n{}\n## Test scenes: {}\n\n{}\n\n{}\n{}\n{}{two_suns}",
        validation(comparison).markdown(),
        test.suite,
        test.about.trim(),
        learning(test).markdown(),
        sums(test).markdown(),
        scenes(test).markdown()
    )
}

/// Draws the validations of all runs over their steps, by slope, because all networks have its unit in common. The coarse DTM's error stands beside
/// them, once for all runs with the same validation tiles.
///
/// # Errors
/// If a run's journal cannot be read or the picture cannot be written.
pub fn curves(comparison: &ExperimentResults, out: &Path) -> Result<()> {
    let (mut series, mut coarse): (Vec<Series>, Vec<Series>) = (Vec::new(), Vec::new());
    for one in &comparison.trained {
        let name = one.experiment.name.clone();
        let history = History::read(&out.join(&name).join(TRAINING))?;
        series.push(Series { points: history.slope_deg, name });
        let of_coarse = Series { points: history.coarse_slope_deg, name: "coarse DTM".into() };
        match coarse.iter_mut().find(|known| level(known) == level(&of_coarse)) {
            Some(known) if known.points.len() >= of_coarse.points.len() => {}
            Some(known) => *known = of_coarse,
            None => coarse.push(of_coarse),
        }
    }
    series.extend(coarse);
    let chart = Chart { title: "Validation", x: "step", y: "mean |slope error|, degrees", log_y: true };
    draw(&out.join(CURVES), &chart, &series)
}

/// Returns the value that a curve begins with, as bits.
fn level(series: &Series) -> Option<u64> {
    series.points.first().map(|(_, y)| y.to_bits())
}
