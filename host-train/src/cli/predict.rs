//! `host-train predict`: an image and a coarse DTM in, a DTM out.

use crate::model::backend::Backend;
use crate::mosaic::Blend;
use crate::predict::{Options, Prediction, Provenance, Scene, open, predict, write_dtm};
use crate::raster::align::Named;
use crate::raster::geotiff;
use crate::{Error, Result, interrupt};
use indicatif::{ProgressBar, ProgressStyle};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// Options of `predict`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:
  host-train predict --image scene_0000_image.tif --coarse scene_0000_coarse.tif --model nano.eld -o dtm.tif

The coarse DTM may lie on a grid of its own, but must be in the image's reference system. The DTM gets the image's grid; pixels
without a valid image sample or coarse height become nodata. A hillshade, dtm_hillshade.png, is written beside it.")]
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
    /// Azimuth of the Sun, degrees clockwise from the grid's up [default: estimated from image and coarse DTM].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_azimuth: Option<f64>,
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
/// From reading the inputs, opening the model, predicting and writing; no file is left behind then.
pub fn run(args: Args) -> Result<()> {
    check_output(&args)?;
    let model = open(&args.model, args.backend)?;
    let (image_name, coarse_name) = (args.image.display().to_string(), args.coarse.display().to_string());
    // The rasters are let go once the scene holds what it needs of them.
    let scene = {
        let (image, coarse) = (geotiff::read(&args.image)?, geotiff::read(&args.coarse)?);
        Scene::new(Named::new(&image_name, &image), Named::new(&coarse_name, &coarse))?
    };
    let overlap_px = args.overlap.unwrap_or_else(|| Options::overlap_for(model.tile()));
    let options = Options {
        overlap_px,
        blend: args.blend,
        anchor: !args.no_anchor,
        threads: args.threads,
        sun_azimuth_deg: args.sun_azimuth,
    };
    interrupt::listen();
    let made = with_progress(|progress| predict(&scene, model.as_ref(), &options, progress))?;
    let file = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let (model, image, coarse) = (model.description(), file(&args.image), file(&args.coarse));
    write_dtm(&args.output, &made, &Provenance { model: &model, image: &image, coarse: &coarse })?;
    println!("{}", summary(&args.output, &made));
    Ok(())
}

/// Fails before the work rather than after it.
fn check_output(args: &Args) -> Result<()> {
    let same = |input: &Path| {
        input.canonicalize().is_ok_and(|input| args.output.canonicalize().is_ok_and(|output| input == output))
    };
    if let Some(input) = [&args.image, &args.coarse, &args.model].into_iter().find(|input| same(input)) {
        return Err(Error::usage(format!("{}: the output must not overwrite an input", input.display())));
    }
    let folder = args.output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::NamedTempFile::new_in(folder).map_err(Error::io(&args.output)).map(drop)
}

fn with_progress<T>(work: impl FnOnce(&mut dyn FnMut(usize, usize) -> ControlFlow<()>) -> Result<T>) -> Result<T> {
    let style = "{bar:40} {pos}/{len} tiles, {per_sec}, {eta} left";
    let bar = ProgressBar::new(0)
        .with_style(ProgressStyle::with_template(style).unwrap_or_else(|_| ProgressStyle::default_bar()));
    let result = work(&mut |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
        if interrupt::requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    bar.finish_and_clear();
    result
}

fn summary(output: &Path, made: &Prediction) -> String {
    let (rows, cols) = (made.dtm.rows, made.dtm.cols);
    let heights = made.dtm.range().map_or("no valid pixel".into(), |(low, high)| format!("{low:.1} to {high:.1} m"));
    let mut text = format!("{}: {rows} x {cols} pixels, {heights}, {} tiles", output.display(), made.tiles);
    if made.tiles_coarse > 0 {
        text += &format!(", {} of them without contrast or relief (coarse heights kept)", made.tiles_coarse);
    }
    if made.tiles_empty > 0 {
        text += &format!(", {} of them without a valid pixel", made.tiles_empty);
    }
    text
}
