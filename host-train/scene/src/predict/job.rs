//! Work on a DTM file. Rows of an interrupted run are kept and the missing rows are made; then all rows become a GeoTIFF.

use super::errors::{ErrorsWriter, Origins};
use super::identity::Identity;
use super::sigma::CoarseSigma;
use super::tile::TileResult;
use super::{DtmWriter, PartFile, Provenance, Scene, Survey, Tally, TileProgress};
use elunar_base::output::Owner;
use elunar_base::{Error, HAS_THREADS, Result, interrupt, progress, say};
use elunar_net::illumination::{LightSource, Lighting};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::mpsc::sync_channel;
use std::thread::ScopedJoinHandle;

/// Pieces of finished rows that may wait for the files.
const WAITING: usize = 2;

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
    if part.lost() > 0 {
        say::note(&format!("{}: {} damaged rows found; they are made again", part.path().display(), part.lost()));
    }
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

/// Makes rows as [`fill`] does, and adds them all to `files`, those of earlier runs first. Files are compressed beside the making of rows. A row is
/// on disk before the files get it.
///
/// # Errors
/// As [`fill`] and [`Outputs::add`].
pub fn fill_files(
    mut part: PartFile,
    rows: usize,
    (files, owner): (&mut Outputs, &Owner),
    make: impl FnOnce(usize, Keep, TileProgress) -> Result<Tally>,
) -> Result<(PartFile, Tally)> {
    beside(
        |rows| files.add(rows),
        |give| {
            part.read(give)?;
            let mut both = |keep: Keep, rows: &[f32]| keep(rows).and_then(|()| give(rows));
            fill(part, rows, owner, |from, keep, progress| make(from, &mut |rows| both(&mut *keep, rows), progress))
        },
    )
}

/// Runs `make`, and beside it, on a thread of its own, `add` with all rows that `make` gives, in order.
///
/// # Errors
/// As `make`, which gets the errors of `add` as soon as it gives rows again.
fn beside<T>(mut add: impl FnMut(&[f32]) -> Result<()> + Send, make: impl FnOnce(Keep) -> Result<T>) -> Result<T> {
    if !HAS_THREADS {
        return make(&mut add);
    }
    std::thread::scope(|scope| {
        let (send, receive) = sync_channel::<Vec<f32>>(WAITING);
        let mut adder = Some(scope.spawn(move || receive.into_iter().try_for_each(|rows| add(&rows))));
        let made = make(&mut |rows| {
            if send.send(rows.to_vec()).is_ok() {
                return Ok(());
            }
            // The other thread has ended: it failed.
            adder.take().map_or(Ok(()), end)?;
            Err(Error::stopped("the files of the finished rows are not written any more"))
        });
        drop(send);
        let added = adder.take().map_or(Ok(()), end);
        made.and_then(|made| added.map(|()| made))
    })
}

/// Waits for a thread, and passes its panic on.
fn end(thread: ScopedJoinHandle<Result<()>>) -> Result<()> {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
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
    /// The file of expected errors to write, and the standard deviation of the coarse DTM's own heights. The rows must have them
    /// ([`super::PredictOptions::layers`]).
    pub errors: Option<(&'a Path, CoarseSigma)>,
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

/// The files of a job while its rows come: the DTM and its hillshade, and the expected errors if wanted. Until [`Self::finish`] none exists.
pub struct Outputs {
    writer: DtmWriter,
    errors: Option<ErrorsWriter>,
    finished: Finished,
    cols: usize,
}

impl Outputs {
    /// Starts the files. `model` says how the heights are made, and `light` under which light ([`light_text`]).
    ///
    /// # Errors
    /// If a file cannot be created.
    pub fn create(scene: &Scene, (model, light, identity): (&str, &str, &Identity), files: Files<'_>) -> Result<Self> {
        let file = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let (image, coarse) = (file(files.image), file(files.coarse));
        let from = Provenance { model, light, image: &image, coarse: &coarse, identity: Some(identity) };
        let (rows, cols) = (scene.rows, scene.cols);
        let writer = DtmWriter::create(files.output, rows, cols, &scene.georef, &from)?;
        let errors = |(path, sigma)| ErrorsWriter::create(path, (rows, cols), &scene.georef, &from, sigma);
        let errors = files.errors.map(errors).transpose()?;
        Ok(Self { writer, errors, finished: Finished::default(), cols })
    }

    /// Adds finished rows, in order.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn add(&mut self, rows: &[f32]) -> Result<()> {
        let Self { writer, errors, finished, cols } = self;
        let Some(errors) = errors else {
            finished.see(rows);
            return writer.add(rows);
        };
        for row in rows.chunks_exact(TileResult::LAYERS * *cols) {
            let (heights_m, parts) = layers(row, *cols);
            finished.see(heights_m);
            writer.add(heights_m)?;
            errors.add(parts)?;
        }
        Ok(())
    }

    /// Completes the files. The caller then removes the rows. `owner` owns the DTM.
    ///
    /// # Errors
    /// If rows are missing, a file cannot be written, or `owner` has lost the output. Then no DTM exists.
    pub fn finish(self, owner: &Owner) -> Result<Finished> {
        let Self { writer, errors, mut finished, .. } = self;
        // The DTM comes last, so that a DTM on disk has its errors beside it.
        owner.check()?;
        finished.origins = errors.map(ErrorsWriter::finish).transpose()?;
        writer.finish(&|| owner.check())?;
        Ok(finished)
    }
}

/// Passes the heights of finished rows with expected errors to `see`, row by row, each with the standard deviations that the image leaves, metres.
pub fn for_each_row(rows: &[f32], cols: usize, mut see: impl FnMut(&[f32], &[f32])) {
    for row in rows.chunks_exact(TileResult::LAYERS * cols) {
        let (heights_m, [of_heights, ..]) = layers(row, cols);
        see(heights_m, of_heights);
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_rows_are_added_in_order_and_a_failure_ends_the_making() {
        let mut added = vec![];
        let give = |give: Keep, rows: usize| (0..rows).try_for_each(|row| give(&[row as f32]));
        let keep = |rows: &[f32]| {
            added.extend_from_slice(rows);
            Ok(())
        };
        beside(keep, |keep| give(keep, 100)).unwrap();
        assert!(added.iter().copied().eq((0..100).map(|row| row as f32)), "{added:?}");
        let full = |rows: &[f32]| if rows[0] < 3.0 { Ok(()) } else { Err(Error::usage("the disk is full")) };
        let (mut given, mut ended) = (0, Ok(()));
        let made = beside(full, |keep| {
            let count = |rows: &[f32]| keep(rows).inspect(|()| given += 1);
            ended = give(&mut { count }, 100);
            ended.as_ref().map_err(|error| Error::usage(error.to_string())).copied()
        });
        assert!(made.unwrap_err().to_string().contains("the disk is full"));
        assert!(ended.is_err() && given <= 4 + WAITING, "{given} rows were given after the failure");
        // One that comes with the last rows is not lost.
        assert!(beside(full, |keep| give(keep, 4)).unwrap_err().to_string().contains("the disk is full"));
    }
}
