//! `elunar predict`: makes a DTM from an image and a coarse DTM.

use super::output;
use elunar_net::illumination::KnownSun;
use elunar_raster::stated::{HeightUnit, Statements};
use elunar_raster::{Crs, Error, Result};
use elunar_scene::mosaic::Blend;
use elunar_scene::predict::job::{fill, finish, light_text, state, summary};
use elunar_scene::predict::network::Model;
use elunar_scene::predict::sun::check_sun;
use elunar_scene::predict::{Input, Options, Part, Scene, Survey, int8, predict_rows};
use std::path::{Path, PathBuf};

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
    /// Azimuth of the Sun, degrees clockwise from the grid's up, -360 to 360 [default: estimated from image and coarse DTM].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_azimuth: Option<f64>,
    /// Elevation of the Sun, degrees above the horizon, above 0 and below 90 [default: the change of brightness with slope is fitted to image and coarse DTM].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_elevation: Option<f64>,
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
    let sun = KnownSun { azimuth_deg: args.sun_azimuth, elevation_deg: args.sun_elevation };
    check_sun(sun)?;
    output::check(&args.output, &[&args.image, &args.coarse, &args.model])?;
    let model = open(&args.model)?;
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
        sun,
    };
    let part = Part::open(&args.output, &job(&args, &options, &model.description())?, scene.cols)?;
    let (part, tally) = fill(part, &scene, |from, keep, progress| {
        predict_rows(&scene, model.as_ref(), &options, from, keep, progress)
    })?;
    let model = model.description();
    let range = finish(part, &args.output, &scene, (&model, &light_text(&tally.light)), (&args.image, &args.coarse))?;
    println!("{}", summary(&args.output, &scene, range, &tally));
    Ok(())
}

fn scene(args: &Args) -> Result<Scene> {
    let coarse = Statements { srs: args.coarse_srs.clone(), unit: args.coarse_unit };
    let image = Statements { srs: args.image_srs.clone(), unit: None };
    Scene::new(Input::stated(&args.image, image)?, Input::stated(&args.coarse, coarse)?)
}

/// Returns a text that identifies this job. With a changed input, model or option, the job starts anew.
fn job(args: &Args, options: &Options, model: &str) -> Result<String> {
    // The result is the same for every number of threads.
    let options = Options { threads: 0, ..*options };
    let (image, coarse) = (state(&args.image)?, state(&args.coarse)?);
    let stated = (&args.image_srs, &args.coarse_srs, args.coarse_unit);
    Ok(format!("{} {image} {coarse} {stated:?} {model} {options:?}", env!("CARGO_PKG_VERSION")))
}
