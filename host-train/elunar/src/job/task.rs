//! What a prediction works with: the opened inputs and the identity of the job.

use super::inputs::Opened;
use super::request::Request;
use super::tracks::Tracks;
use super::words;
use crate::held::Held;
use elunar_base::digest::sha256;
use elunar_base::{Error, Result, say};
use elunar_core::sun::UtcTime;
use elunar_net::illumination::Lighting;
use elunar_raster::pds4;
use elunar_scene::mosaic::BLEND;
use elunar_scene::predict::identity::{self, Identity, content_of_input, job_note};
use elunar_scene::predict::job::{Keep, survey};
use elunar_scene::predict::neighbourhoods::SceneLight;
use elunar_scene::predict::network::TileModel;
use elunar_scene::predict::notices::notices;
use elunar_scene::predict::sigma::CoarseSigma;
use elunar_scene::predict::span::Span;
use elunar_scene::predict::sun::KnownFrom;
use elunar_scene::predict::{
    PredictOptions, Scene, Survey, Tally, TileProgress, predict_span, shared_survey, survey_path,
};
use std::path::Path;

/// What a prediction works with.
pub(super) struct Work {
    pub(super) model: Box<dyn TileModel>,
    pub(super) scene: Scene,
    pub(super) sun: KnownFrom,
    /// When the image was taken, if that is known.
    pub(super) time: Option<UtcTime>,
    /// Laser altimeter tracks, if they are to say how large the coarse DTM's own errors are.
    pub(super) tracks: Option<Tracks>,
    pub(super) options: PredictOptions,
}

impl Work {
    /// Opens model and inputs. `coarse_pixel_m` is as [`super::MemoryJob`] has it.
    ///
    /// # Errors
    /// If one cannot be read, the model does not say how much an image explains and that is wanted, or a coarse pixel is smaller than the image's.
    pub(super) fn new(
        args: &Request,
        held: &Held,
        expected_errors: bool,
        coarse_pixel_m: Option<f64>,
        open: impl FnOnce(&Path) -> Result<Box<dyn TileModel>>,
    ) -> Result<Self> {
        let model = open(&args.model)?;
        if expected_errors && !model.input_rules().illumination.is_weighed() {
            return Err(Error::unsupported(
                &args.model,
                "--uncertainty: a model of weighed maps expected; this one does not say how much an image explains",
            ));
        }
        let Opened { mut scene, sun, image } = args.inputs.open(held)?;
        if let Some(coarse_pixel_m) = coarse_pixel_m {
            scene.coarse_px = (coarse_pixel_m / f64::from(scene.pixel_m)) as f32;
            if !(1.0..=f32::MAX).contains(&scene.coarse_px) {
                let what = format!("pixels of {} m at least expected, {coarse_pixel_m} m found", scene.pixel_m);
                return Err(Error::usage(format!("coarse_pixel_size: {what}")));
            }
        }
        let time = args.inputs.time.or(image.source.info().sun.time);
        let is_tracked = expected_errors && !args.tracks.is_empty();
        let tracks = is_tracked.then(|| Tracks::open(&args.tracks, &scene, &image.name)).transpose()?;
        let options = PredictOptions {
            overlap_px: args.overlap.unwrap_or_else(|| PredictOptions::overlap_for(model.tile())),
            anchor: !args.no_anchor,
            threads: args.threads,
            sun: sun.sun,
            expected_errors,
        };
        Ok(Self { model, scene, sun, time, tracks, options })
    }

    pub(super) fn lighting(&self, survey: &Survey) -> Lighting {
        survey.lighting(self.model.input_rules().illumination, self.sun.sun)
    }

    /// Returns what the user should know before the prediction, and says it.
    pub(super) fn warn(&self, args: &Request, survey: &Survey, lighting: &Lighting) -> Result<Vec<String>> {
        let warnings = notices(&self.scene, survey, &self.sun, lighting, args.inputs.coarse_unit.is_some())?;
        super::warn(&warnings);
        Ok(warnings)
    }

    /// Returns the light of the tiles.
    pub(super) fn light(&self, survey: &Survey) -> SceneLight {
        survey.light_for(self.model.input_rules().illumination, self.sun.sun)
    }

    /// Makes the tiles of `span`, and passes finished rows to `keep`.
    pub(super) fn predict(&self, light: SceneLight, span: &Span, keep: Keep, progress: TileProgress) -> Result<Tally> {
        predict_span(&self.scene, self.model.as_ref(), &self.options, light, span, keep, progress)
    }

    /// Returns the standard deviation of the coarse DTM's own heights without tracks.
    pub(super) fn told_or_assumed(&self, args: &Request) -> CoarseSigma {
        CoarseSigma::told_or_assumed(args.coarse_sigma, self.scene.coarse_px * self.scene.pixel_m)
    }

    /// Returns the standard deviation of the coarse DTM's own heights. Tracks need the finished rows, which `read` passes on, all in order.
    ///
    /// # Errors
    /// Errors of `read`; if too few points of tracks lie on heights.
    pub(super) fn coarse_sigma(
        &self,
        args: &Request,
        read: impl FnOnce(&mut dyn FnMut(&[f32]) -> Result<()>) -> Result<()>,
    ) -> Result<CoarseSigma> {
        let Some(tracks) = &self.tracks else {
            return Ok(self.told_or_assumed(args));
        };
        let mut seen = tracks.seen();
        read(&mut |rows| {
            seen.add(rows);
            Ok(())
        })?;
        seen.sigma()
    }
}

/// What a run on files works with: also the identity of the job.
pub(super) struct Task {
    pub(super) work: Work,
    pub(super) identity: Identity,
}

impl Task {
    /// Opens model and inputs.
    ///
    /// # Errors
    /// As [`Work::new`].
    pub(super) fn new(args: &Request, open: impl FnOnce(&Path) -> Result<Box<dyn TileModel>>) -> Result<Self> {
        let work = Work::new(args, &Held::default(), args.uncertainty.is_some(), None, open)?;
        let identity = identity(args, &work.options, &work.model.description())?;
        say::detail(&format!("model: {}", work.model.description()));
        say::detail(&format!("options: {}", identity.options));
        say::detail(&format!("job: {}", identity.job));
        Ok(Self { work, identity })
    }

    /// Returns the number of samples of a row, with all maps.
    pub(super) fn width(&self) -> usize {
        self.work.scene.cols * self.work.options.layers()
    }

    pub(super) fn is_finished(&self, args: &Request) -> bool {
        let outputs = std::iter::once(&args.output).chain(&args.uncertainty);
        let has_others = args.report.iter().chain(&args.stac).all(|path| path.is_file());
        let note = job_note(&self.identity.job);
        let has_label = args.pds4.as_deref().is_none_or(|path| pds4::holds(path, &note));
        has_others && has_label && outputs.into_iter().all(|output| self.identity.is_finished(output))
    }

    /// Returns the survey that all parts of the DTM and `join` use. The first of them makes it.
    pub(super) fn shared_survey(&self, args: &Request) -> Result<(Survey, Lighting)> {
        let survey = shared_survey(&survey_path(&args.output), &self.identity.job, || survey(&self.work.scene))?;
        let lighting = self.work.lighting(&survey);
        Ok((survey, lighting))
    }
}

/// Returns what identifies this job. With a changed input, model or option, the job starts anew.
fn identity(args: &Request, options: &PredictOptions, model: &str) -> Result<Identity> {
    let known = |stated: &Option<String>, path: &Path| stated.clone().map_or_else(|| content_of_input(path), Ok);
    let image = known(&args.image_sha256, &args.inputs.image)?;
    let tables = args.tracks.iter().map(|path| sha256(path)).collect::<Result<Vec<_>>>()?;
    let options = in_words(args, options, &tables);
    Ok(Identity::new(image, known(&args.coarse_sha256, &args.inputs.coarse)?, model, options))
}

/// Returns the options that change the result, with the SHA-256 of each table of tracks. The number of threads does not.
fn in_words(args: &Request, options: &PredictOptions, tables: &[String]) -> String {
    let yes = |yes: bool| Some(if yes { "yes" } else { "no" }.to_string());
    let of_run = [
        ("overlap_px", Some(options.overlap_px.to_string())),
        ("blend", Some(BLEND.into())),
        ("anchor", yes(options.anchor)),
        ("sun_azimuth_deg", words::number(options.sun.azimuth_deg)),
        ("sun_elevation_deg", words::number(options.sun.elevation_deg)),
        ("expected_errors", yes(options.expected_errors)),
    ];
    let sigma = ("coarse_sigma_m", args.coarse_sigma.map(|sigma_m| sigma_m.to_string()));
    let tracks = ("tracks_sha256", (!tables.is_empty()).then(|| tables.join("+")));
    identity::words(of_run.into_iter().chain(args.inputs.words()).chain([sigma, tracks]))
}
