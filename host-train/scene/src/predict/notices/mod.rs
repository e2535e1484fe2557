//! Warnings about a scene that is probably not what its user meant, each one line. They change no result.
//!
//! All limits are our choice, wide enough that ordinary scenes have no warning: a false alarm is worse than a miss.

mod coarse;
mod exchange;
mod image;
mod light;
mod scale;

#[cfg(test)]
mod tests;

pub use exchange::check_exchange;
pub use light::share_of_relief;

use super::job::Finished;
use super::sun::KnownFrom;
use super::{Scene, Survey};
use crate::body;
use elunar_base::Result;
use elunar_net::illumination::Lighting;
use elunar_raster::source::Source;

/// Returns the warnings about a scene, its survey, and the light that it is worked on under. `unit_stated` says that the user has stated the
/// unit of the heights.
///
/// # Errors
/// If the coarse DTM cannot be read.
pub fn notices(
    scene: &Scene,
    survey: &Survey,
    sun: &KnownFrom,
    lighting: &Lighting,
    unit_stated: bool,
) -> Result<Vec<String>> {
    if survey.lowest_m > survey.highest_m {
        // No valid pixel: the run will end with an error, which is enough.
        return Ok(vec![]);
    }
    let name = &scene.image.name;
    let of_coverage = coarse::coverage(scene, survey);
    let of_exchange = exchange::suspected(scene, unit_stated);
    let of_coarse = coarse::suspected(scene, survey, unit_stated)?;
    let of_scale = scale::suspected(name, &scene.coarse_name, scene.coarse_px);
    let of_image = image::suspected(name, &survey.brightness);
    // Neither under a wrong light nor in a clipped image does anything look like relief: the cause is told, not the effect.
    let little = || light::little_relief(name, survey, lighting);
    let unrelated = || light::unrelated(name, &scene.coarse_name, lighting);
    // Under a known azimuth an image without relief is the cause, and its brightness follows no slopes.
    let effect =
        || if sun.sun.azimuth_deg.is_some() { little().or_else(unrelated) } else { unrelated().or_else(little) };
    let of_light = light::contradiction(survey, sun, lighting).or_else(|| effect().filter(|_| of_image.is_empty()));
    let of_file = |name: &str, source: &dyn Source| {
        source.info().warnings.iter().map(|warning| format!("{name}: {warning}")).collect::<Vec<_>>()
    };
    let of_files =
        of_file(name, &*scene.image.source).into_iter().chain(of_file(&scene.coarse_name, scene.coarse.source()));
    let found = sun
        .refused
        .iter()
        .cloned()
        .chain(of_files)
        .chain(of_coverage)
        .chain(of_exchange)
        .chain(of_coarse)
        .chain(of_scale)
        .chain(of_image);
    Ok(found.chain(of_light).collect())
}

/// Returns the warning about a finished DTM that has heights which its body does not have. `output` is its name.
#[must_use]
pub fn notice_of_heights(output: &str, scene: &Scene, finished: &Finished) -> Option<String> {
    let range = (finished.low_m, finished.high_m);
    let what = body::beyond(scene.georef.crs.sphere_radius_m(), range)?;
    Some(format!("{output}: {what}: is the Sun right, and are the coarse DTM's heights metres above the sphere?"))
}

/// Returns a share in percent, for messages.
fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}
