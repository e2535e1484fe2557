//! `elunar mosaic`: joins several DTMs.

use super::input::heights;
use crate::outputs as output;
use elunar_base::{Error, Result, progress, read};
use elunar_raster::align::{Interpolation, Reprojected};
use elunar_raster::geotiff::{Compression, WriteOptions, Writer};
use elunar_raster::source::Source as _;
use elunar_raster::{Crs, MOON_RADIUS_M};
use elunar_scene::body;
use elunar_scene::mosaic::{Grid, GridOptions, JoinRules, MosaicInput, WeightRules, join};
use std::path::{Path, PathBuf};

/// Options of `mosaic`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Weights, blending and option names are those of the Ames Stereo Pipeline's dem_mosaic: each DTM weighs most where it is far from \
its edges and gaps. Without --t_srs all DTMs must be in one reference system. Spacing and system of the mosaic are those of the \
first.

Example:
  elunar mosaic left.tif right.tif -o mosaic.tif --priority-blending-length 50")]
pub struct Args {
    /// DTMs, heights in metres. The order matters only with --priority-blending-length.
    #[arg(value_name = "DEM", required_unless_present = "dem_list", conflicts_with = "dem_list")]
    pub dems: Vec<PathBuf>,
    /// Text file with one DTM per line, instead of DTM arguments.
    #[arg(short = 'l', long, alias = "dem-list-file", value_name = "FILE")]
    pub dem_list: Option<PathBuf>,
    /// Mosaic to write.
    #[arg(short, long, value_name = "OUT.tif")]
    pub output: PathBuf,
    /// Reference system of the mosaic: IAU_2015:30110 and the like, a PROJ text, or WKT. Every DTM is reprojected (bilinearly) before its
    /// weights are computed [default: the DTMs' system, which must be the same for all].
    #[arg(long = "t_srs", value_name = "SRS", value_parser = Crs::parse)]
    pub t_srs: Option<Crs>,
    /// Side of a pixel, map units [default: the first DTM's].
    #[arg(long, value_name = "STEP", allow_negative_numbers = true)]
    pub tr: Option<f64>,
    /// Region of the mosaic, map units.
    #[arg(long = "t_projwin", num_args = 4, value_names = ["XMIN", "YMIN", "XMAX", "YMAX"], allow_negative_numbers = true)]
    pub t_projwin: Option<Vec<f64>>,
    /// Number of pixels to remove at every edge and gap.
    #[arg(long, value_name = "PX", default_value_t = 0, value_parser = clap::value_parser!(u32).range(..=1000))]
    pub erode_length: u32,
    /// Exponent of the distance in the weights of the DTMs.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(i32).range(1..=16))]
    pub weights_exponent: i32,
    /// Gaussian blur of the weights, pixels; 0 for none.
    #[arg(long, value_name = "PX", default_value_t = 5.0, allow_negative_numbers = true)]
    pub weights_blur_sigma: f64,
    /// Keep earlier DTMs unchanged, except in a band this wide along their edges, pixels, where the next DTM is blended in; 0 for none.
    #[arg(long, value_name = "PX", default_value_t = 0, value_parser = clap::value_parser!(u32).range(..=10_000))]
    pub priority_blending_length: u32,
    /// Compression of the mosaic.
    #[arg(long, default_value = "deflate")]
    pub compress: Compression,
}

/// Number of rows joined at a time.
const BAND_ROWS: usize = 1024;

/// Runs the command.
///
/// # Errors
/// If a DTM cannot be read, the DTMs do not fit each other, or the mosaic cannot be written. Then no output file exists.
pub fn run(args: Args) -> Result<()> {
    let paths = match &args.dem_list {
        Some(list) => listed(list)?,
        None => args.dems.clone(),
    };
    output::extension(&args.output, &["tif", "tiff"])?;
    let inputs: Vec<&Path> = paths.iter().chain(&args.dem_list).map(PathBuf::as_path).collect();
    let _owner = output::take(&args.output, &inputs)?;
    if !(0.0..=100.0).contains(&args.weights_blur_sigma) {
        let what = format!("--weights-blur-sigma: 0 to 100 pixels expected, {} found", args.weights_blur_sigma);
        return Err(Error::usage(what));
    }
    let mut inputs: Vec<MosaicInput> = paths.iter().map(|path| open(path)).collect::<Result<_>>()?;
    if let Some(crs) = &args.t_srs {
        inputs = reprojected(inputs, crs, args.tr)?;
    }
    let window = args.t_projwin.as_deref().map(|w| [w[0], w[1], w[2], w[3]]);
    let grid = Grid::around(&inputs, GridOptions { spacing: args.tr, window })?;
    let weights = WeightRules {
        erode_px: args.erode_length,
        blur_sigma_px: args.weights_blur_sigma,
        exponent: args.weights_exponent,
    };
    let rules = JoinRules { weights, priority_px: args.priority_blending_length };
    let names: Vec<String> =
        paths.iter().map(|p| p.file_name().unwrap_or(p.as_os_str()).to_string_lossy().into_owned()).collect();
    let radius_m = grid.georef.crs.sphere_radius_m().unwrap_or(MOON_RADIUS_M);
    let about = format!("mosaic of {} DTMs: heights above the {radius_m} m sphere", names.len());
    let options = WriteOptions::heights(about).with_item("INPUTS", names.join(", ")).with_compression(args.compress);
    let mut writer = Writer::create(&args.output, grid.rows, grid.cols, Some(&grid.georef), &options)?;
    let bar = progress::bar("", grid.rows as u64, "rows");
    let (mut valid, mut low, mut high) = (0_usize, f32::INFINITY, f32::NEG_INFINITY);
    for first in (0..grid.rows).step_by(BAND_ROWS) {
        let band = first..(first + BAND_ROWS).min(grid.rows);
        let heights_m = join(&inputs, &grid.rows(band.clone()), &rules)?;
        for &z in heights_m.iter().filter(|z| z.is_finite()) {
            (valid, low, high) = (valid + 1, low.min(z), high.max(z));
        }
        writer.write_rows(&heights_m)?;
        bar.inc(band.len() as u64);
    }
    bar.finish_and_clear();
    if valid == 0 {
        let what = format!("{}: a valid height on the mosaic's grid expected, none found", names.join(", "));
        return Err(Error::usage(what));
    }
    writer.finish()?;
    let (rows, cols) = (grid.rows, grid.cols);
    println!("{}: {rows} x {cols} pixels, {valid} of them valid, {low:.1} to {high:.1} m", args.output.display());
    if let Some(what) = body::beyond(Some(radius_m), (low, high)) {
        eprintln!("WARNING: {}: {what}: are the DTMs' heights metres above the sphere?", args.output.display());
    }
    Ok(())
}

fn open(path: &Path) -> Result<MosaicInput> {
    Ok(MosaicInput { name: path.display().to_string(), source: heights(path)? })
}

/// Reprojects the DTMs to another system. All get pixels of one size: the stated one, or the first DTM's.
fn reprojected(inputs: Vec<MosaicInput>, crs: &Crs, mut spacing: Option<f64>) -> Result<Vec<MosaicInput>> {
    let mut seen = Vec::with_capacity(inputs.len());
    // All lie near the first, so that grids agree across the seam of longitudes.
    let mut near_x = None;
    for MosaicInput { name, source } in inputs {
        let source = Reprojected::new(source.into(), &name, crs, (spacing, near_x), Interpolation::Bilinear)?;
        let place = source.info().georef.as_ref().map(|georef| georef.transform);
        spacing = spacing.or_else(|| place.map(|place| place[1]));
        near_x = near_x.or_else(|| place.map(|place| place[0]));
        seen.push(MosaicInput { name, source: Box::new(source) });
    }
    Ok(seen)
}

fn listed(list: &Path) -> Result<Vec<PathBuf>> {
    let text = read::text(list, read::MOST_BYTES)?;
    let paths: Vec<PathBuf> = text.lines().map(str::trim).filter(|l| !l.is_empty()).map(PathBuf::from).collect();
    if paths.is_empty() {
        return Err(Error::usage(format!("{}: one DTM a line expected, none found", list.display())));
    }
    Ok(paths)
}
