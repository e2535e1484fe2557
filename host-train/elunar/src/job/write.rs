//! The files of a finished prediction, and what it says at its end.

use super::request::Request;
use super::task::Task;
use super::{Done, Watch};
use elunar_base::Result;
use elunar_base::output::Owner;
use elunar_scene::predict::errors::{assumed_sigma_m, origins_text};
use elunar_scene::predict::job::{Files, ReadRows, finish, light_text, summary};
use elunar_scene::predict::notices::{notice_of_heights, share_of_relief};
use elunar_scene::predict::record::{ErrorsRecord, LightRecord, Phases, PredictionRecord};
use elunar_scene::predict::{Survey, Tally};
use std::path::Path;
use std::time::Instant;

/// What a run found before it predicted.
pub(super) struct Found {
    pub(super) survey: Survey,
    pub(super) warnings: Vec<String>,
    pub(super) start: Instant,
    pub(super) phases: Phases,
}

/// Writes the files of finished rows. Returns what they are.
///
/// # Errors
/// As [`finish`].
pub(super) fn write(
    args: &Request,
    task: &Task,
    read: ReadRows,
    tally: &Tally,
    found: Found,
    owner: &Owner,
) -> Result<Done> {
    let (scene, sun) = (&task.scene, &task.sun);
    let model = task.model.description();
    let Tally { light, change, .. } = *tally;
    let changes = change.map_or(String::new(), |change| format!("; {change}"));
    let stored = light_text(&light) + &sun.origin_of(&light) + &changes;
    let sigma_m = args.coarse_sigma.unwrap_or_else(|| assumed_sigma_m(scene.coarse_px * scene.pixel_m));
    let errors = args.uncertainty.as_deref().map(|path| (path, sigma_m));
    let files = Files { output: &args.output, image: &args.inputs.image, coarse: &args.inputs.coarse, errors };
    let mut watch = Watch::new();
    let finished = finish(read, scene, (&model, &stored, &task.identity), files, owner)?;
    let phases = Phases { write_s: watch.lap_s(), ..found.phases };
    let mut warnings = found.warnings;
    let beyond = notice_of_heights(&args.output.display().to_string(), scene, &finished);
    super::warn(&beyond);
    warnings.extend(beyond);
    let mut text = summary(&args.output, scene, &finished, tally) + &sun.origin_of(&light) + &changes;
    if let (Some((path, sigma_m)), Some(origins)) = (errors, &finished.origins) {
        let said = if args.coarse_sigma.is_some() { "as told" } else { "assumed; --coarse-sigma tells it" };
        let origins = origins_text(origins);
        text += &format!(
            "\nheights: {origins}\n{}: expected errors, the coarse DTM's own {sigma_m:.2} m ({said})",
            path.display()
        );
    }
    let name = |path: &Path| path.display().to_string();
    let record = PredictionRecord {
        image: name(&args.inputs.image),
        coarse: name(&args.inputs.coarse),
        model,
        output: name(&args.output),
        uncertainty: errors
            .map(|(path, sigma_m)| ErrorsRecord::new(path, sigma_m, &finished.origins.unwrap_or_default())),
        rows: scene.rows,
        cols: scene.cols,
        pixel_m: scene.pixel_m,
        coarse_px: scene.coarse_px,
        lowest_m: finished.low_m,
        highest_m: finished.high_m,
        pixels_valid: finished.pixels_valid,
        pixels_void: scene.rows * scene.cols - finished.pixels_valid,
        coarse_covers: found.survey.coverage(),
        tiles: tally.into(),
        light: LightRecord::new(&light, change, sun),
        share_of_relief: share_of_relief(&found.survey, &light),
        warnings,
        seconds: found.start.elapsed().as_secs_f64(),
        phases,
    };
    Ok(Done { text, json: Some(record.json()) })
}
