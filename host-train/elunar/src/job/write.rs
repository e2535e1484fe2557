//! The files of a finished prediction, and what it says at its end.

use super::report;
use super::request::Request;
use super::task::{Task, Work};
use super::{Done, Watch};
use super::{pds4, stac};
use elunar_base::output::Owner;
use elunar_base::{Result, say};
use elunar_net::illumination::Lighting;
use elunar_scene::predict::errors::origins_text;
use elunar_scene::predict::job::{Files, Finished, Outputs, light_text, summary};
use elunar_scene::predict::neighbourhoods::{Change, SceneLight};
use elunar_scene::predict::notices::{notice_of_heights, share_of_relief};
use elunar_scene::predict::record::{ErrorsRecord, LightRecord, Phases, PredictionRecord};
use elunar_scene::predict::sigma::{CoarseSigma, SigmaFrom};
use elunar_scene::predict::{Survey, Tally};
use std::path::Path;
use std::time::Instant;

/// What a run found before it predicted.
pub(super) struct Found {
    pub(super) survey: Survey,
    pub(super) warnings: Vec<String>,
    pub(super) coarse_sigma: CoarseSigma,
    pub(super) start: Instant,
    pub(super) phases: Phases,
}

impl Found {
    /// Returns what a run took and found.
    pub(super) fn record(
        self,
        args: &Request,
        work: &Work,
        tally: &Tally,
        finished: &Finished,
        uncertainty: Option<ErrorsRecord>,
    ) -> PredictionRecord {
        let (scene, Tally { light, change, .. }) = (&work.scene, *tally);
        let name = |path: &Path| path.display().to_string();
        let Phases { survey_s, tiles_s, write_s } = self.phases;
        say::detail(&format!("seconds: survey {survey_s:.1}, tiles {tiles_s:.1}, writing {write_s:.1}"));
        PredictionRecord {
            image: name(&args.inputs.image),
            coarse: name(&args.inputs.coarse),
            model: work.model.description(),
            output: name(&args.output),
            uncertainty,
            rows: scene.rows,
            cols: scene.cols,
            pixel_m: scene.pixel_m,
            coarse_px: scene.coarse_px,
            lowest_m: finished.low_m,
            highest_m: finished.high_m,
            pixels_valid: finished.pixels_valid,
            pixels_void: scene.rows * scene.cols - finished.pixels_valid,
            coarse_covers: self.survey.coverage(),
            tiles: tally.into(),
            light: LightRecord::new(&light, change, &work.sun),
            share_of_relief: share_of_relief(&self.survey, &light),
            warnings: self.warnings,
            seconds: self.start.elapsed().as_secs_f64(),
            phases: self.phases,
        }
    }

    /// Adds the warning about the heights, and says it.
    pub(super) fn warn_of_heights(&mut self, args: &Request, work: &Work, finished: &Finished) {
        let beyond = notice_of_heights(&args.output.display().to_string(), &work.scene, finished);
        super::warn(&beyond);
        self.warnings.extend(beyond);
    }
}

/// Starts the files of a prediction under a light.
///
/// # Errors
/// As [`Outputs::create`].
pub(super) fn begin(args: &Request, task: &Task, light: &SceneLight, sigma: CoarseSigma) -> Result<Outputs> {
    let work = &task.work;
    let stored = light_text(&light.whole) + &of_light(work, &light.whole, light.change());
    let errors = args.uncertainty.as_deref().map(|path| (path, sigma));
    let files = Files { output: &args.output, image: &args.inputs.image, coarse: &args.inputs.coarse, errors };
    Outputs::create(&work.scene, (&work.model.description(), &stored, &task.identity), files)
}

/// Returns where the light comes from, and how it changes.
fn of_light(work: &Work, light: &Lighting, change: Option<Change>) -> String {
    work.sun.origin_of(light) + &change.map_or(String::new(), |change| format!("; {change}"))
}

/// Completes the files. Returns what they are.
///
/// # Errors
/// As [`Outputs::finish`].
pub(super) fn end(
    args: &Request,
    task: &Task,
    files: Outputs,
    tally: &Tally,
    mut found: Found,
    owner: &Owner,
) -> Result<Done> {
    let (work, mut watch) = (&task.work, Watch::new());
    let of_light = of_light(work, &tally.light, tally.change);
    let errors = args.uncertainty.as_deref().map(|path| (path, found.coarse_sigma));
    let finished = files.finish(owner)?;
    found.phases.write_s += watch.lap_s();
    found.warn_of_heights(args, work, &finished);
    let mut text = summary(&args.output, &work.scene, &finished, tally) + &of_light;
    if let (Some((path, CoarseSigma { sigma_m, correlation_m, from })), Some(origins)) = (errors, &finished.origins) {
        let said = match from {
            SigmaFrom::Told => "as told".into(),
            SigmaFrom::Assumed => "assumed; --coarse-sigma tells it, --tracks find it".into(),
            SigmaFrom::Tracks(_) => from.to_string(),
        };
        let origins = origins_text(origins);
        text += &format!(
            "\nheights: {origins}\n{}: expected errors, the coarse DTM's own {sigma_m:.2} m ({said}), alike over {correlation_m:.0} m",
            path.display()
        );
    }
    let of_errors = |(path, sigma)| ErrorsRecord::new(path, sigma, &finished.origins.unwrap_or_default());
    let record = found.record(args, work, tally, &finished, errors.map(of_errors));
    if let Some(path) = &args.report {
        report::write(path, args, &work.scene, &record)?;
        text += &format!("\n{}: a page to look at", path.display());
    }
    if let Some(path) = &args.stac {
        stac::write(path, args, task, &record)?;
        text += &format!("\n{}: STAC item", path.display());
    }
    if let Some(path) = &args.pds4 {
        pds4::write(path, args, task)?;
        text += &format!("\n{}: PDS4 label", path.display());
    }
    Ok(Done { text, json: Some(record.json()) })
}
