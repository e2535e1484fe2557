//! Summaries over the scenes of a kind, and over all scenes.

use super::results::{COARSE, MethodScores, SuiteResults, UNTRAINED};
use serde::Serialize;

/// Name of the summary over all scenes.
pub const ALL: &str = "all";

/// Scores of a method over several scenes. Means are over scenes, each with the same weight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SuiteSummary {
    /// Kind of the scenes, or [`ALL`].
    pub kind: String,
    /// The method.
    pub method: String,
    /// Number of scenes.
    pub scenes: usize,
    /// Root of the mean square of the scenes' height RMSE, metres.
    pub rmse_m: f64,
    /// Ratio of this RMSE to the coarse DTM's.
    pub rmse_ratio: f64,
    /// Ratio of this RMSE to that of the pipeline without training; `None` in results without it.
    pub rmse_over_untrained: Option<f64>,
    /// Mean of the scenes' MAE, metres.
    pub mae_m: f64,
    /// Means of the shares, in [0, 1], of |error| below 2, 4 and 10 m.
    pub share_within: [f64; 3],
    /// Mean slope error, degrees.
    pub slope_mae_deg: f64,
    /// Mean length of the slope vector's error, metres per metre. This and the following are `None` if a scene lacks the figure.
    pub slope_vector_error: Option<f64>,
    /// Ratio of this error to the coarse DTM's.
    pub slope_vector_ratio: Option<f64>,
    /// Ratio of this error to that of the pipeline without training.
    pub slope_vector_over_untrained: Option<f64>,
    /// Mean correlation of short waves with the truth's short waves.
    pub high_pass_correlation: Option<f64>,
    /// Root of the mean square of the long waves' error, metres.
    pub low_pass_rmse_m: Option<f64>,
    /// Root of the mean square of the short waves' error, metres.
    pub high_pass_rmse_m: Option<f64>,
    /// Mean slope-vector error on bright and on shaded ground, metres per metre.
    pub sides: Option<(f64, f64)>,
    /// Mean correlation of hillshade and image.
    pub shading_correlation: Option<f64>,
    /// Seconds of all predictions.
    pub seconds: Option<f64>,
    /// Geometric mean of the scenes' half-coherence wavelengths, metres.
    pub half_coherence_m: Option<f64>,
}

/// Returns the summaries of every method over every kind of scene, then over all. Scenes with a weak truth are left out.
#[must_use]
pub fn summaries(results: &SuiteResults) -> Vec<SuiteSummary> {
    let scenes: Vec<_> = results.scenes.iter().filter(|scene| !scene.weak_truth).collect();
    let mut kinds: Vec<&str> = vec![];
    for scene in &scenes {
        if !kinds.contains(&scene.kind.as_str()) {
            kinds.push(&scene.kind);
        }
    }
    if kinds.len() != 1 {
        kinds.push(ALL);
    }
    let mut found = vec![];
    for kind in kinds {
        let of_kind = |method: &str| -> Vec<MethodScores> {
            let scenes = scenes.iter().filter(|scene| kind == ALL || scene.kind == kind);
            scenes.flat_map(|scene| scene.scored.iter().filter(|scored| scored.method == method)).cloned().collect()
        };
        let (coarse, untrained) = (of_kind(COARSE), of_kind(UNTRAINED));
        for method in &results.methods {
            let scored = of_kind(&method.name);
            if !scored.is_empty() {
                found.push(summary((kind, &method.name), &scored, &coarse, &untrained));
            }
        }
    }
    found
}

fn summary(
    (kind, method): (&str, &str),
    scored: &[MethodScores],
    coarse: &[MethodScores],
    untrained: &[MethodScores],
) -> SuiteSummary {
    let rms = |of: &[MethodScores]| mean(of, |j| j.heights.rmse_m.powi(2)).sqrt();
    let slope = |of: &[MethodScores]| known(of, |j| j.relief.slope_vector_error);
    let bright = known(scored, |j| j.relief.bright.map(|side| side.slope_vector_error));
    let shaded = known(scored, |j| j.relief.shaded.map(|side| side.slope_vector_error));
    let count = scored.len() as f64;
    SuiteSummary {
        kind: kind.into(),
        method: method.into(),
        scenes: scored.len(),
        rmse_m: rms(scored),
        rmse_ratio: rms(scored) / rms(coarse),
        rmse_over_untrained: (!untrained.is_empty()).then(|| rms(scored) / rms(untrained)),
        mae_m: mean(scored, |j| j.heights.mae_m),
        share_within: std::array::from_fn(|k| mean(scored, |j| j.heights.share_within[k])),
        slope_mae_deg: mean(scored, |j| j.heights.slope_mae_deg),
        slope_vector_error: slope(scored),
        slope_vector_ratio: slope(scored).zip(slope(coarse)).map(|(own, coarse)| own / coarse),
        slope_vector_over_untrained: slope(scored).zip(slope(untrained)).map(|(own, untrained)| own / untrained),
        high_pass_correlation: known(scored, |j| j.relief.high_pass_correlation),
        low_pass_rmse_m: known(scored, |j| j.relief.low_pass_rmse_m.map(|m| m * m)).map(f64::sqrt),
        high_pass_rmse_m: known(scored, |j| j.relief.high_pass_rmse_m.map(|m| m * m)).map(f64::sqrt),
        sides: bright.zip(shaded),
        shading_correlation: known(scored, |j| j.relief.shading_correlation),
        seconds: known(scored, |j| j.seconds).map(|mean| mean * count),
        half_coherence_m: known(scored, |j| j.half_coherence_m().map(f64::ln)).map(f64::exp),
    }
}

fn mean(of: &[MethodScores], figure: impl Fn(&MethodScores) -> f64) -> f64 {
    of.iter().map(figure).sum::<f64>() / of.len() as f64
}

/// Returns the mean if every scene has the figure.
fn known(of: &[MethodScores], figure: impl Fn(&MethodScores) -> Option<f64>) -> Option<f64> {
    let figures: Option<Vec<f64>> = of.iter().map(figure).collect();
    figures.filter(|f| !f.is_empty()).map(|f| f.iter().sum::<f64>() / f.len() as f64)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::suite::results::{MethodInfo, SceneResult};
    use elunar_evaluate::{CoAlignment, HalfCoherence, Registration, ReliefScores, Scores, Spectral};

    pub(crate) fn scores(method: &str, rmse_m: f64, slope: f64) -> MethodScores {
        let heights = Scores {
            pixels: 9,
            share_within: [0.5, 0.75, 1.0],
            mae_m: rmse_m / 2.0,
            rmse_m,
            bias_m: 0.0,
            median_m: 0.0,
            rmse_median_removed_m: rmse_m,
            largest_m: 9.0,
            nmad_m: 1.0,
            error_95_m: 3.0,
            error_percentiles_m: [1.0, 1.5, 2.5, 3.0, 4.0],
            slope_error_percentiles_deg: [1.0; 5],
            slope_pixels: 4,
            slope_mae_deg: 10.0 * slope,
            slope_rmse_deg: 1.0,
            slope_bias_deg: 0.0,
        };
        let relief = ReliefScores {
            slope_vector_error: Some(slope),
            low_pass_rmse_m: Some(1.0),
            high_pass_rmse_m: Some(0.5),
            high_pass_correlation: Some(0.8),
            bright: None,
            shaded: None,
            shading_correlation: None,
        };
        let spectral = Spectral {
            octaves: vec![],
            half_coherence: Some(HalfCoherence { wavelength_m: 1000.0 * slope, at_most: false }),
            registration: Some(Registration {
                down_px: 0.5,
                right_px: -0.25,
                down_m: 1.0,
                right_m: -0.5,
                down_sd_px: 0.1,
                right_sd_px: 0.1,
                correlation: 0.9,
            }),
        };
        MethodScores { method: method.into(), heights, relief, spectral: Some(spectral), seconds: None }
    }

    pub(crate) fn results() -> SuiteResults {
        let scene = |name: &str, kind: &str, weak_truth: bool, scored: Vec<MethodScores>| SceneResult {
            name: name.into(),
            kind: kind.into(),
            remarks: String::new(),
            weak_truth,
            shape: (3, 3),
            pixel_m: (2.0, 2.0),
            coarse_m: 59.0,
            high_pass_m: 60.0,
            sun_deg: (Some(300.0), None),
            pixels: (9, 9),
            scored,
            pictures: vec![],
        };
        let info = |name: &str| MethodInfo {
            name: name.into(),
            description: format!("{name}, described"),
            anchor: false,
            co_alignment: CoAlignment::None,
            sun_told: true,
        };
        SuiteResults {
            software: "test".into(),
            suite: "made up".into(),
            about: "About <it>.".into(),
            list_sha256: String::new(),
            methods: vec![info(COARSE), info("net")],
            scenes: vec![
                scene("one", "mare", false, vec![scores(COARSE, 3.0, 0.1), scores("net", 1.5, 0.06)]),
                scene("two", "highland", false, vec![scores(COARSE, 4.0, 0.3), scores("net", 2.0, 0.10)]),
                scene("three", "real", true, vec![scores(COARSE, 400.0, 9.0), scores("net", 900.0, 9.0)]),
            ],
            cross: vec![CrossResult {
                ground: "g".into(),
                method: "net".into(),
                scenes: ("one".into(), "two".into()),
                difference_m: 1.0,
                rmse_m: 2.0,
                high_pass_m: (Some(0.2), None),
            }],
        }
    }

    /// Returns [`results`] with the pipeline without training among the methods.
    pub(crate) fn with_untrained() -> SuiteResults {
        let mut made = results();
        made.methods.insert(1, MethodInfo { name: UNTRAINED.into(), ..made.methods[1].clone() });
        for (scene, (rmse_m, slope)) in made.scenes.iter_mut().zip([(2.0, 0.08), (2.5, 0.20), (500.0, 9.0)]) {
            scene.scored.insert(1, scores(UNTRAINED, rmse_m, slope));
        }
        made
    }

    use crate::suite::results::CrossResult;

    #[test]
    fn kinds_are_summed_apart_and_weak_truths_left_out() {
        let found = summaries(&results());
        let kinds: Vec<(&str, &str)> = found.iter().map(|s| (s.kind.as_str(), s.method.as_str())).collect();
        assert_eq!(
            kinds,
            [("mare", COARSE), ("mare", "net"), ("highland", COARSE), ("highland", "net"), (ALL, COARSE), (ALL, "net")]
        );
        let all = &found[5];
        assert!(
            (all.rmse_m - ((1.5f64.powi(2) + 4.0) / 2.0).sqrt()).abs() < 1e-12 && (all.rmse_ratio - 0.5).abs() < 1e-12
        );
        assert!((all.slope_vector_ratio.unwrap() - 0.16 / 0.4).abs() < 1e-12);
        assert_eq!((all.scenes, all.sides, all.high_pass_rmse_m), (2, None, Some(0.5)));
        assert_eq!((all.rmse_over_untrained, all.slope_vector_over_untrained), (None, None));
        assert_eq!(found[0].rmse_ratio, 1.0);
        assert!((all.half_coherence_m.unwrap() - (60.0_f64 * 100.0).sqrt()).abs() < 1e-9);
    }

    #[test]
    fn what_learning_adds_is_a_ratio_to_the_untrained_pipeline() {
        let found = summaries(&with_untrained());
        let of =
            |kind: &str, method: &str| found.iter().find(|s| (s.kind.as_str(), s.method.as_str()) == (kind, method));
        let net = of("highland", "net").unwrap();
        assert!((net.rmse_over_untrained.unwrap() - 2.0 / 2.5).abs() < 1e-12);
        assert!((net.slope_vector_over_untrained.unwrap() - 0.10 / 0.20).abs() < 1e-12);
        let untrained = of(ALL, UNTRAINED).unwrap();
        assert_eq!((untrained.rmse_over_untrained, untrained.slope_vector_over_untrained), (Some(1.0), Some(1.0)));
    }
}
