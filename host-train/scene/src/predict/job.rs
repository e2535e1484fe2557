//! Work on a DTM file. Rows of an interrupted run are kept and the missing rows are made; then all rows become a GeoTIFF.

use super::errors::{ErrorsWriter, Origins};
use super::identity::Identity;
use super::tile::TileResult;
use super::{DtmWriter, PartFile, Provenance, Scene, Survey, Tally, TileProgress};
use elunar_base::output::Owner;
use elunar_base::{Result, interrupt, progress, say};
use elunar_net::illumination::{LightSource, Lighting};
use std::ops::ControlFlow;
use std::path::Path;

/// Receives finished rows; see [`super::predict_rows`].
pub type Keep<'a> = &'a mut dyn FnMut(&[f32]) -> Result<()>;

/// Surveys a scene. A progress bar counts blocks of rows, and Ctrl-C stops between them.
///
/// # Errors
/// As [`Scene::survey_with`].
pub fn survey(scene: &Scene) -> Result<Survey> {
    interrupt::listen();
    with_progress(("survey", "blocks"), |progress| scene.survey_with(progress))
}

/// Makes the rows that `part` lacks of `rows`, in order. A progress bar counts tiles. If the run stops, the finished rows stay on disk for the
/// next run. Nothing is added once `owner` has lost the output.
///
/// # Errors
/// As `make`. The message says where the finished rows are, if there are any.
pub fn fill(
    mut part: PartFile,
    rows: usize,
    owner: &Owner,
    make: impl FnOnce(usize, Keep, TileProgress) -> Result<Tally>,
) -> Result<(PartFile, Tally)> {
    let from = part.rows();
    if from > 0 {
        say::note(&format!("{}: going on after row {from} of {rows}", part.path().display()));
    }
    let keep = |part: &mut PartFile, rows: &[f32]| owner.check().and_then(|()| part.append(rows));
    match tiles(|progress| make(from, &mut |rows| keep(&mut part, rows), progress)) {
        Ok(tally) => Ok((part, tally)),
        Err(error) if owner.check().is_err() => Err(error),
        Err(error) if part.rows() == 0 => {
            part.remove()?;
            Err(error)
        }
        Err(error) => {
            let kept = part.path().display();
            Err(error.and(&format!("; what was made is in {kept}, the same command goes on from there")))
        }
    }
}

/// Makes the tiles of a scene. A progress bar counts them, and Ctrl-C stops between them.
///
/// # Errors
/// As `make`.
pub fn tiles(make: impl FnOnce(TileProgress) -> Result<Tally>) -> Result<Tally> {
    interrupt::listen();
    with_progress(("", "tiles"), make)
}

/// The files of a finished job.
#[derive(Debug, Clone, Copy)]
pub struct Files<'a> {
    /// The DTM to write.
    pub output: &'a Path,
    /// The image.
    pub image: &'a Path,
    /// The coarse DTM.
    pub coarse: &'a Path,
    /// The file of expected errors to write, and the standard deviation of the coarse DTM's own heights, metres. The rows must have them
    /// ([`super::PredictOptions::layers`]).
    pub errors: Option<(&'a Path, f32)>,
}

/// What a finished job found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finished {
    /// Lowest height, metres.
    pub low_m: f32,
    /// Highest height, metres.
    pub high_m: f32,
    /// Number of heights.
    pub pixels_valid: usize,
    /// Origins of the heights, if expected errors were wanted.
    pub origins: Option<Origins>,
}

impl Default for Finished {
    fn default() -> Self {
        Self { low_m: f32::INFINITY, high_m: f32::NEG_INFINITY, pixels_valid: 0, origins: None }
    }
}

impl Finished {
    /// Counts heights.
    pub(super) fn see(&mut self, heights_m: &[f32]) {
        for &z in heights_m.iter().filter(|z| z.is_finite()) {
            (self.low_m, self.high_m, self.pixels_valid) =
                (self.low_m.min(z), self.high_m.max(z), self.pixels_valid + 1);
        }
    }
}

/// Reads all rows of a job, in order, in blocks.
pub type ReadRows<'a> = &'a mut dyn FnMut(&mut dyn FnMut(&[f32]) -> Result<()>) -> Result<()>;

/// Writes finished rows as the DTM and its hillshade, and the expected errors if wanted. `model` says how the heights were made, and `light`
/// under which light ([`light_text`]). The caller removes the rows. `owner` owns the DTM.
///
/// # Errors
/// If a file cannot be read or written, or `owner` has lost the output. Then no DTM exists.
pub fn finish(
    read: ReadRows,
    scene: &Scene,
    (model, light, identity): (&str, &str, &Identity),
    files: Files<'_>,
    owner: &Owner,
) -> Result<Finished> {
    let file = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let (image, coarse) = (file(files.image), file(files.coarse));
    let from = Provenance { model, light, image: &image, coarse: &coarse, identity: Some(identity) };
    let mut writer = DtmWriter::create(files.output, scene.rows, scene.cols, &scene.georef, &from)?;
    let errors = |(path, sigma_m)| ErrorsWriter::create(path, (scene.rows, scene.cols), &scene.georef, &from, sigma_m);
    let mut errors = files.errors.map(errors).transpose()?;
    let mut finished = Finished::default();
    read(&mut |rows| {
        let Some(errors) = &mut errors else {
            finished.see(rows);
            return writer.add(rows);
        };
        for row in rows.chunks_exact(TileResult::LAYERS * scene.cols) {
            let (heights_m, parts) = layers(row, scene.cols);
            finished.see(heights_m);
            writer.add(heights_m)?;
            errors.add(parts)?;
        }
        Ok(())
    })?;
    // The DTM comes last, so that a DTM on disk has its errors beside it.
    owner.check()?;
    finished.origins = errors.map(ErrorsWriter::finish).transpose()?;
    writer.finish(&|| owner.check())?;
    Ok(finished)
}

/// Returns the heights of a row, and its maps of expected errors.
pub(super) fn layers(row: &[f32], cols: usize) -> (&[f32], [&[f32]; TileResult::LAYERS - 1]) {
    let (heights_m, rest) = row.split_at(cols);
    (heights_m, std::array::from_fn(|layer| &rest[layer * cols..][..cols]))
}

/// Runs work in pieces that Ctrl-C can stop, under a bar with the name of the work and of its pieces.
fn with_progress<T>((what, unit): (&str, &str), work: impl FnOnce(TileProgress) -> Result<T>) -> Result<T> {
    let bar = progress::bar(what, 0, unit);
    let result = work(&mut |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
        if interrupt::requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    bar.finish_and_clear();
    result
}

/// Returns one line about a finished DTM.
#[must_use]
pub fn summary(output: &Path, scene: &Scene, finished: &Finished, tally: &Tally) -> String {
    let Finished { low_m: low, high_m: high, .. } = finished;
    let Tally { tiles, tiles_before, tiles_coarse, tiles_empty, light, .. } = *tally;
    let (output, rows, cols) = (output.display(), scene.rows, scene.cols);
    let mut text = format!("{output}: {rows} x {cols} pixels, {low:.1} to {high:.1} m, {tiles} tiles");
    let notes = [
        (tiles_before, "made by an earlier run"),
        (tiles_coarse, "of them without contrast or relief (coarse heights kept)"),
        (tiles_empty, "of them without a valid pixel"),
    ];
    for (count, what) in notes.into_iter().filter(|(count, _)| *count > 0) {
        text += &format!(", {count} {what}");
    }
    if light.source != LightSource::NotAsked {
        text += &format!("\nlight: {}", light_text(&light));
    }
    text
}

/// Returns a light in words: azimuth, strength, the elevation of a Sun of that strength, their uncertainty and origin, the trust, and
/// where it is not certain the probability that the image shows the ground of the coarse DTM.
#[must_use]
pub fn light_text(lighting: &Lighting) -> String {
    let Lighting { light, source, trust, related, log_strength_sd, azimuth_sd_deg, .. } = *lighting;
    let (azimuth, strength, elevation) = (light.azimuth_deg(), light.strength(), light.elevation_deg());
    let origin = match source {
        LightSource::NotAsked => return "not used by the network".into(),
        LightSource::Given => "given",
        LightSource::Fitted => "fitted",
        LightSource::Assumed if azimuth_sd_deg == 0.0 => {
            "strength assumed, as neither the Sun's elevation is known nor the scene shows it: give --sun-elevation"
        }
        LightSource::Assumed => {
            "assumed, as neither the Sun is known nor the scene shows it: give --sun-azimuth and --sun-elevation"
        }
    };
    let azimuth = match azimuth_sd_deg {
        sd if sd > 0.0 => format!("azimuth {azimuth:.0} +- {sd:.0} deg"),
        _ => format!("azimuth {azimuth:.0} deg"),
    };
    let strength = format!("strength {strength:.2}, uncertain by a factor of {:.2}", log_strength_sd.exp());
    let related = match source {
        LightSource::Fitted | LightSource::Given if related < 0.995 => {
            format!("brightness follows the coarse DTM with probability {related:.2}; ")
        }
        _ => String::new(),
    };
    format!("{azimuth}, {strength}, as of a Sun {elevation:.0} deg high; trust {trust:.2}; {related}{origin}")
}
