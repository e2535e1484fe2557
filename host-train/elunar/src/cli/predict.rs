//! `elunar predict`: makes a DTM from an image and a coarse DTM.

use super::output;
use elunar_net::illumination::KnownSun;
use elunar_raster::stated::{HeightUnit, Statements};
use elunar_raster::sun::StatedSun;
use elunar_raster::{Crs, Error, Result};
use elunar_scene::mosaic::Blend;
use elunar_scene::predict::errors::{assumed_sigma_m, origins_text};
use elunar_scene::predict::job::{Files, fill, finish, light_text, state, summary};
use elunar_scene::predict::network::Model;
use elunar_scene::predict::notices::{check_exchange, notices, share_of_relief};
use elunar_scene::predict::record::{ErrorsRecord, LightRecord, Record};
use elunar_scene::predict::sun::{KnownFrom, check_sun};
use elunar_scene::predict::{Input, Options, Part, Scene, Tally, int8, predict_rows};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Help text below the options.
pub const HELP: &str = "\
Image and coarse DTM are GeoTIFFs or PDS3 products, each on a grid of its own and in a projection of its own, on \
one sphere. The DTM gets the image's grid. Pixels without a valid image sample or coarse height become nodata. A hillshade is \
written beside the DTM (dtm_hillshade.png).

Finished rows wait in dtm.tif.part until all are done: after Ctrl-C or a kill the same command goes on from there.

Example:
  elunar predict --image scene_0000_image.tif --coarse scene_0000_coarse.tif --model nano.eld -o dtm.tif";

/// Options of `predict`.
#[derive(Debug, clap::Args)]
#[command(after_help = HELP)]
pub struct Args {
    /// Orbiter image: GeoTIFF or PDS3.
    #[arg(long, value_name = "I.tif")]
    pub image: PathBuf,
    /// Coarse DTM: GeoTIFF or PDS3, heights above the sphere in metres, or in the unit that the file names.
    #[arg(long, value_name = "C.tif")]
    pub coarse: PathBuf,
    /// Model: .eld for the int8 runner. `host-train` also accepts .safetensors, the float network.
    #[arg(long, value_name = "M")]
    pub model: PathBuf,
    /// DTM to write.
    #[arg(short, long, value_name = "DTM.tif")]
    pub output: PathBuf,
    /// Write the errors that heights and slopes are expected to have: a GeoTIFF with their standard deviations (metres; metres per metre
    /// along either axis) and the origin of each height. For models of weighed maps.
    #[arg(long, value_name = "ERR.tif")]
    pub uncertainty: Option<PathBuf>,
    /// Standard deviation of the coarse DTM's own heights, metres [default: 0.04 of its pixels, at most 3 m].
    #[arg(long, value_name = "M", value_parser = metres, requires = "uncertainty")]
    pub coarse_sigma: Option<f32>,
    /// Number of threads; 0 takes as many as the machine offers.
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
    /// Reference system of the image, if the file does not state it: IAU_2015:30110 and the like, or a PROJ text.
    #[arg(long, value_name = "SRS", value_parser = Crs::parse)]
    pub image_srs: Option<Crs>,
    /// Reference system of the coarse DTM, if the file does not state it.
    #[arg(long, value_name = "SRS", value_parser = Crs::parse)]
    pub coarse_srs: Option<Crs>,
    /// Unit of the coarse DTM's heights, if the file does not state it [default: m].
    #[arg(long)]
    pub coarse_unit: Option<HeightUnit>,
    /// Azimuth of the Sun, degrees clockwise from the grid's up, -360 to 360 [default: as the image's file states it, else fitted to image and coarse DTM].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_azimuth: Option<f64>,
    /// Elevation of the Sun, degrees above the horizon, above 0 and below 90 [default: as the image's file states it, else the change of brightness with slope is fitted to image and coarse DTM].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_elevation: Option<f64>,
    /// Do not use the angles of the Sun that the image's file states: fit those that are not given.
    #[arg(long)]
    pub fit_sun: bool,
    /// Value of the image's file, before scale and offset, that means no measurement, as if its nodata tag said so.
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
    pub image_nodata: Option<f64>,
    /// Value of the coarse DTM's file, before scale, offset and unit, that means no measurement.
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
    pub coarse_nodata: Option<f64>,
    /// Print what was taken and found as one JSON object on stdout; the text goes to stderr.
    #[arg(long)]
    pub json: bool,
    /// Overlap of neighbouring tiles, pixels [default: 100, or a third of a smaller tile's shorter side].
    #[arg(long, value_name = "PX")]
    pub overlap: Option<usize>,
    /// Weights of overlapping tiles.
    #[arg(long, default_value = "dem-mosaic")]
    pub blend: Blend,
    /// Take the low frequencies from the network, not from the coarse DTM, as in the paper.
    #[arg(long)]
    pub no_anchor: bool,
}

/// Runs the command.
///
/// # Errors
/// If an input cannot be read, the model cannot be opened, or predicting or writing fails. Then no DTM exists.
pub fn run(args: Args) -> Result<()> {
    run_with(args, open)
}

/// Opens a model file of the int8 runner.
///
/// # Errors
/// [`Error::Unsupported`] if the file's name is that of float weights, or of no known kind; otherwise as [`int8::open`].
pub fn open(path: &Path) -> Result<Box<dyn Model>> {
    let wrong = |what| Err(Error::unsupported(path, what));
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("eld") => Ok(Box::new(int8::open(path)?)),
        Some("safetensors") => {
            wrong("expected a model (.eld); `host-train` runs float weights, `export` makes a model of them")
        }
        _ => wrong("expected a model with extension .eld"),
    }
}

/// Runs the command with models from `open`.
///
/// # Errors
/// As [`run`].
pub fn run_with(args: Args, open: impl FnOnce(&Path) -> Result<Box<dyn Model>>) -> Result<()> {
    let start = Instant::now();
    let sun = KnownSun { azimuth_deg: args.sun_azimuth, elevation_deg: args.sun_elevation };
    check_sun(sun)?;
    let inputs: [&Path; 3] = [&args.image, &args.coarse, &args.model];
    let _owner = output::take_dtm(&args.output, &inputs)?;
    let _owners = output::take_all(&args.uncertainty, &[&inputs[..], &[&args.output]].concat())?;
    let model = open(&args.model)?;
    if args.uncertainty.is_some() && !model.input_rules().illumination.is_weighed() {
        return Err(Error::unsupported(
            &args.model,
            "--uncertainty: a model of weighed maps expected; this one does not say how much an image explains",
        ));
    }
    let (scene, sun) = scene(&args, sun)?;
    let survey = scene.survey()?;
    let lighting = survey.lighting(model.input_rules().illumination, sun.sun);
    let warnings = notices(&scene, &survey, &sun, &lighting, args.coarse_unit.is_some())?;
    warnings.iter().for_each(|warning| eprintln!("WARNING: {warning}"));
    let options = Options {
        overlap_px: args.overlap.unwrap_or_else(|| Options::overlap_for(model.tile())),
        blend: args.blend,
        anchor: !args.no_anchor,
        threads: args.threads,
        sun: sun.sun,
        expected_errors: args.uncertainty.is_some(),
    };
    let width = scene.cols * options.layers();
    let part = Part::open(&args.output, &job(&args, &options, &model.description())?, width)?;
    let (part, tally) = fill(part, &scene, |from, keep, progress| {
        predict_rows(&scene, model.as_ref(), &options, from, keep, progress)
    })?;
    let model = model.description();
    let Tally { light, change, .. } = tally;
    let changes = change.map_or(String::new(), |change| format!("; {change}"));
    let stored = light_text(&light) + sun.origin_of(&light) + &changes;
    let sigma_m = args.coarse_sigma.unwrap_or_else(|| assumed_sigma_m(scene.coarse_px * scene.pixel_m));
    let errors = args.uncertainty.as_deref().map(|path| (path, sigma_m));
    let files = Files { output: &args.output, image: &args.image, coarse: &args.coarse, errors };
    let finished = finish(part, &scene, (&model, &stored), files)?;
    let mut text = summary(&args.output, &scene, &finished, &tally) + sun.origin_of(&light) + &changes;
    if let (Some((path, sigma_m)), Some(origins)) = (errors, &finished.origins) {
        let said = if args.coarse_sigma.is_some() { "as told" } else { "assumed; --coarse-sigma tells it" };
        let origins = origins_text(origins);
        text += &format!(
            "\nheights: {origins}\n{}: expected errors, the coarse DTM's own {sigma_m:.2} m ({said})",
            path.display()
        );
    }
    if !args.json {
        println!("{text}");
        return Ok(());
    }
    eprintln!("{text}");
    let name = |path: &Path| path.display().to_string();
    let record = Record {
        image: name(&args.image),
        coarse: name(&args.coarse),
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
        tiles: (&tally).into(),
        light: LightRecord::new(&light, change, &sun),
        share_of_relief: share_of_relief(&survey, &light),
        warnings,
        seconds: start.elapsed().as_secs_f64(),
    };
    println!("{}", record.json());
    Ok(())
}

/// Parses a standard deviation, metres.
fn metres(text: &str) -> std::result::Result<f32, String> {
    let sigma_m = text.parse().map_err(|_| "a number of metres expected".to_string())?;
    if (0.0..1e6).contains(&sigma_m) { Ok(sigma_m) } else { Err("metres from 0 to 1,000,000 expected".into()) }
}

/// Opens image and coarse DTM. Angles of the Sun that the user does not give are those of the image's file.
fn scene(args: &Args, user: KnownSun) -> Result<(Scene, KnownFrom)> {
    let coarse = Statements { srs: args.coarse_srs.clone(), unit: args.coarse_unit };
    let image = Statements { srs: args.image_srs.clone(), unit: None };
    let (image, coarse) = (
        Input::stated(&args.image, image, args.image_nodata)?,
        Input::stated(&args.coarse, coarse, args.coarse_nodata)?,
    );
    check_exchange(&image, &coarse, args.coarse_unit.is_some())?;
    let of_file = if args.fit_sun { StatedSun::default() } else { image.source.info().sun };
    let sun = KnownFrom::new(user, &image.name, of_file)?;
    Ok((Scene::new(image, coarse)?, sun))
}

/// Returns a text that identifies this job. With a changed input, model or option, the job starts anew.
fn job(args: &Args, options: &Options, model: &str) -> Result<String> {
    // The result is the same for every number of threads.
    let options = Options { threads: 0, ..*options };
    let (image, coarse) = (state(&args.image)?, state(&args.coarse)?);
    let nodata = (args.image_nodata, args.coarse_nodata);
    let stated = (&args.image_srs, &args.coarse_srs, args.coarse_unit, nodata);
    Ok(format!("{} {image} {coarse} {stated:?} {model} {options:?}", env!("CARGO_PKG_VERSION")))
}
