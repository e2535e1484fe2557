//! The Sun against the scene.

use super::super::Survey;
use super::super::sun::{AngleSource, KnownFrom};
use super::percent;
use elunar_net::illumination::{LightSource, Lighting};

/// Least trust in a fitted light that can contradict a known one.
const TRUST_MIN: f32 = 0.9;
/// Least difference of azimuths: that many standard deviations of the fit, and that many degrees.
const AZIMUTH_SDS: f64 = 3.0;
const AZIMUTH_DEG: f64 = 20.0;

/// Least probability that brightness follows the coarse DTM without a warning.
const RELATED_MIN: f32 = 0.5;

/// A scene whose share of relief is smaller hardly shows its relief. Of the synthetic scenes of the test, with strong albedo among them, none
/// has less than 0.2 (`cargo test -p elunar-scene --lib notices -- --nocapture`).
const RELIEF_MIN: f32 = 0.1;

/// Warns if the known azimuth contradicts the one that image and coarse DTM show.
pub(super) fn contradiction(survey: &Survey, sun: &KnownFrom, lighting: &Lighting) -> Option<String> {
    let told_deg = sun.sun.azimuth_deg?;
    if lighting.source == LightSource::NotAsked {
        return None;
    }
    let fit = survey.light.estimate(None, None)?;
    let (fitted_deg, sd_deg) = (fit.light.azimuth_deg(), f64::from(fit.azimuth_sd_deg));
    let apart_deg = ((told_deg - fitted_deg + 180.0).rem_euclid(360.0) - 180.0).abs();
    if fit.trust <= TRUST_MIN || apart_deg <= AZIMUTH_DEG || apart_deg <= AZIMUTH_SDS * sd_deg {
        return None;
    }
    let turned = "if the image was turned, say --sun-azimuth, or in `predict` --fit-sun";
    let (whose, instead) = match sun.azimuth_from {
        AngleSource::File => ("the Sun's azimuth in the image's file", turned),
        AngleSource::Time => ("the Sun's azimuth at the image's time", "if place or time are wrong, say --sun-azimuth"),
        AngleSource::User => ("--sun-azimuth", "degrees are clockwise from the grid's up"),
    };
    Some(format!(
        "{whose} is {told_deg:.0} deg, but image and coarse DTM show a Sun at {fitted_deg:.0} +- {sd_deg:.0} deg, trust {:.2}: {instead}",
        fit.trust
    ))
}

/// Warns if brightness hardly follows the slopes of the coarse DTM: heights stay near the coarse DTM's then.
pub(super) fn unrelated(image: &str, coarse: &str, lighting: &Lighting) -> Option<String> {
    let seen = matches!(lighting.source, LightSource::Fitted | LightSource::Given);
    (seen && lighting.related < RELATED_MIN).then(|| {
        let probability = lighting.related;
        let told = if lighting.azimuth_sd_deg == 0.0 {
            "is it the same ground, well placed, and the Sun's azimuth clockwise from the grid's up?"
        } else {
            "is it the same ground, well placed? If so, say --sun-azimuth"
        };
        format!(
            "{image}: its brightness hardly follows the slopes of {coarse} (probability {probability:.2}), so heights stay near the coarse DTM's: \
             {told}"
        )
    })
}

/// Returns the share of the image's contrast that is relief under a light ([`elunar_core::photoclinometry::Share`]); `None` if the direction
/// of the light is unknown.
#[must_use]
pub fn share_of_relief(survey: &Survey, lighting: &Lighting) -> Option<f32> {
    let known = lighting.source != LightSource::NotAsked && lighting.trust > 0.0;
    known.then(|| survey.contrast.share(lighting.light).mean())
}

/// Warns if hardly any of the image's contrast is relief. The share supposes relief of every direction, so ripples across the light look like
/// albedo. If brightness follows the slopes of the coarse DTM, there is no warning.
pub(super) fn little_relief(name: &str, survey: &Survey, lighting: &Lighting) -> Option<String> {
    let share = share_of_relief(survey, lighting)?;
    let follows = survey.light.estimate(None, None).is_some_and(|fit| fit.trust > TRUST_MIN);
    (share < RELIEF_MIN && !follows).then(|| {
        let share = percent(f64::from(share));
        format!("{name}: only {share} of its contrast looks like relief under this light, the rest like albedo or noise: expect little more than the coarse DTM")
    })
}
