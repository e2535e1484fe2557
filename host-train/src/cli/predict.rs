//! `host-train predict`: an image and a coarse DTM in, a DTM out.

use super::output;
use crate::illumination::KnownSun;
use crate::model::backend::Backend;
use crate::mosaic::Blend;
use crate::predict::{DtmWriter, Input, Options, Part, Progress, Provenance, Scene, Survey, Tally, open, predict_rows};
use crate::raster::stated::{HeightUnit, Statements};
use crate::raster::{Crs, source};
use crate::{Error, Result, interrupt};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// Options of `predict`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:
  host-train predict --image scene_0000_image.tif --coarse scene_0000_coarse.tif --model nano.eld -o dtm.tif

The coarse DTM may lie on a grid of its own, but must be in the image's reference system. The DTM gets the image's grid; pixels
without a valid image sample or coarse height become nodata. A hillshade, dtm_hillshade.png, is written beside it.

Finished rows wait in dtm.tif.part until all are done: after Ctrl-C or a kill the same command goes on from there.")]
pub struct Args {
    /// Orbiter image, GeoTIFF.
    #[arg(long, value_name = "I.tif")]
    pub image: PathBuf,
    /// Coarse DTM, GeoTIFF, heights in metres above the sphere.
    #[arg(long, value_name = "C.tif")]
    pub coarse: PathBuf,
    /// Model: .eld for the int8 runner, .safetensors for the float network.
    #[arg(long, value_name = "M")]
    pub model: PathBuf,
    /// DTM to write.
    #[arg(short, long, value_name = "DTM.tif")]
    pub output: PathBuf,
    /// Threads; 0 takes as many as the machine offers.
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
    /// Reference system of the image, where the file does not say it: IAU_2015:30110 and the like, or a PROJ text.
    #[arg(long, value_name = "SRS", value_parser = Crs::parse)]
    pub image_srs: Option<Crs>,
    /// Reference system of the coarse DTM, likewise.
    #[arg(long, value_name = "SRS", value_parser = Crs::parse)]
    pub coarse_srs: Option<Crs>,
    /// Unit of the coarse DTM's heights, where the file does not say it [default: m].
    #[arg(long)]
    pub coarse_unit: Option<HeightUnit>,
    /// Azimuth of the Sun, degrees clockwise from the grid's up [default: estimated from image and coarse DTM].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_azimuth: Option<f64>,
    /// Elevation of the Sun, degrees above the horizon [default: how brightness answers to slope is fitted to image and coarse DTM].
    #[arg(long, value_name = "DEG")]
    pub sun_elevation: Option<f64>,
    /// Pixels by which neighbouring tiles overlap [default: 100, or a third of a smaller tile].
    #[arg(long, value_name = "PX")]
    pub overlap: Option<usize>,
    /// How overlapping tiles are weighed.
    #[arg(long, default_value = "dem-mosaic")]
    pub blend: Blend,
    /// Let the network change the low frequencies of the coarse DTM too, as in the paper.
    #[arg(long)]
    pub no_anchor: bool,
    /// Where a float network runs.
    #[arg(long, default_value = "flex")]
    pub backend: Backend,
}

/// Runs the command.
///
/// # Errors
/// From reading the inputs, opening the model, predicting and writing; no DTM is left behind then.
pub fn run(args: Args) -> Result<()> {
    output::check(&args.output, &[&args.image, &args.coarse, &args.model])?;
    let model = open(&args.model, args.backend)?;
    let scene = scene(&args)?;
    let survey = scene.survey()?;
    if survey.suspects_kilometres() && args.coarse_unit.is_none() {
        let Survey { relief_m, extent_m, .. } = survey;
        eprintln!(
            "WARNING: {}: {relief_m:.3} m of relief over {extent_m:.0} m: kilometres taken for metres? Say --coarse-unit km, or m",
            args.coarse.display()
        );
    }
    let options = Options {
        overlap_px: args.overlap.unwrap_or_else(|| Options::overlap_for(model.tile())),
        blend: args.blend,
        anchor: !args.no_anchor,
        threads: args.threads,
        sun: KnownSun { azimuth_deg: args.sun_azimuth, elevation_deg: args.sun_elevation },
    };
    let part = Part::open(&args.output, &job(&args, &options, &model.description())?, scene.cols)?;
    let (part, tally) = fill(part, &scene, |from, keep, progress| {
        predict_rows(&scene, model.as_ref(), &options, from, keep, progress)
    })?;
    let model = model.description();
    let range = finish(part, &args.output, &scene, &model, (&args.image, &args.coarse))?;
    println!("{}", summary(&args.output, &scene, range, &tally));
    Ok(())
}

/// Hears finished rows; see [`predict_rows`].
pub(super) type Keep<'a> = &'a mut dyn FnMut(&[f32]) -> Result<()>;

/// Makes the rows that `part` lacks, from the first of them on, under a bar that counts tiles. A run that stops leaves them for the next.
pub(super) fn fill(
    mut part: Part,
    scene: &Scene,
    make: impl FnOnce(usize, Keep, Progress) -> Result<Tally>,
) -> Result<(Part, Tally)> {
    let from = part.rows();
    if from > 0 {
        eprintln!("{}: going on after row {from} of {}", part.path().display(), scene.rows);
    }
    interrupt::listen();
    match with_progress(|progress| make(from, &mut |rows| part.append(rows), progress)) {
        Ok(tally) => Ok((part, tally)),
        Err(error) if part.rows() == 0 => {
            part.remove()?;
            Err(error)
        }
        Err(error) => {
            let kept = part.path().display();
            Err(Error::usage(format!("{error}; what was made is in {kept}, the same command goes on from there")))
        }
    }
}

/// Turns finished rows into the DTM and its hillshade; the lowest and highest height, metres.
pub(super) fn finish(
    mut part: Part,
    output: &Path,
    scene: &Scene,
    model: &str,
    (image, coarse): (&Path, &Path),
) -> Result<(f32, f32)> {
    let file = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let (image, coarse) = (file(image), file(coarse));
    let from = Provenance { model, image: &image, coarse: &coarse };
    let mut writer = DtmWriter::create(output, scene.rows, scene.cols, &scene.georef, &from)?;
    let mut range = (f32::INFINITY, f32::NEG_INFINITY);
    part.read(&mut |rows| {
        range = rows.iter().filter(|z| z.is_finite()).fold(range, |(low, high), &z| (low.min(z), high.max(z)));
        writer.add(rows)
    })?;
    writer.finish()?;
    part.remove()?;
    Ok(range)
}

fn scene(args: &Args) -> Result<Scene> {
    Scene::new(input(&args.image, &args.image_srs, None)?, input(&args.coarse, &args.coarse_srs, args.coarse_unit)?)
}

/// Opens a file, with what the command line says of it.
pub(super) fn input(path: &Path, srs: &Option<Crs>, unit: Option<HeightUnit>) -> Result<Input> {
    let name = path.display().to_string();
    let source = Statements { srs: srs.clone(), unit }.of(&name, source::open(path)?)?;
    Ok(Input { name, source: source.into() })
}

/// What tells this job from others: a changed input, model or option begins anew.
fn job(args: &Args, options: &Options, model: &str) -> Result<String> {
    // The result is the same for every number of threads.
    let options = Options { threads: 0, ..*options };
    let (image, coarse) = (state(&args.image)?, state(&args.coarse)?);
    let stated = (&args.image_srs, &args.coarse_srs, args.coarse_unit);
    Ok(format!("{} {image} {coarse} {stated:?} {model} {options:?}", env!("CARGO_PKG_VERSION")))
}

/// What changes when a file does.
pub(super) fn state(path: &Path) -> Result<String> {
    let known = path.metadata().map_err(Error::io(path))?;
    Ok(format!("{:?} {} {:?}", path.canonicalize().ok(), known.len(), known.modified().ok()))
}

fn with_progress<T>(work: impl FnOnce(&mut dyn FnMut(usize, usize) -> ControlFlow<()>) -> Result<T>) -> Result<T> {
    let bar = output::progress(0, "tiles");
    let result = work(&mut |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
        if interrupt::requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    bar.finish_and_clear();
    result
}

/// One line about a finished DTM.
pub(super) fn summary(output: &Path, scene: &Scene, (low, high): (f32, f32), tally: &Tally) -> String {
    let Tally { tiles, tiles_before, tiles_coarse, tiles_empty } = *tally;
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
    text
}
