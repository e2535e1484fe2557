//! `elunar mosaic`: joins several DTMs.

use crate::held::Held;
use crate::outputs as output;
use elunar_base::{Error, Result, interrupt, progress, read, say};
use elunar_core::sun::Body;
use elunar_raster::Crs;
use elunar_raster::align::{Interpolation, Reprojected};
use elunar_raster::geotiff::{Compression, WriteOptions, Writer};
use elunar_raster::source::Source as _;
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
    println!("{}", write(&args, &Held::default())?);
    Ok(())
}

/// Opened DTMs, and how they are joined.
pub struct Joining {
    inputs: Vec<MosaicInput>,
    names: Vec<String>,
    rules: JoinRules,
    /// The mosaic's grid.
    pub grid: Grid,
}

/// What was joined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Joined {
    /// Number of heights.
    pub valid: usize,
    /// Lowest height, metres.
    pub low_m: f32,
    /// Highest height, metres.
    pub high_m: f32,
}

impl Joining {
    /// Opens the DTMs that the arguments or their list names.
    ///
    /// # Errors
    /// If an option is out of range, or a DTM cannot be read or does not fit the others.
    pub fn open(args: &Args, held: &Held) -> Result<Self> {
        if !(0.0..=100.0).contains(&args.weights_blur_sigma) {
            let what = format!("--weights-blur-sigma: 0 to 100 pixels expected, {} found", args.weights_blur_sigma);
            return Err(Error::usage(what));
        }
        let paths = args.paths()?;
        let open = |path: &PathBuf| Ok(MosaicInput { name: path.display().to_string(), source: held.heights(path)? });
        let mut inputs: Vec<MosaicInput> = paths.iter().map(open).collect::<Result<_>>()?;
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
        let name = |path: &PathBuf| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        Ok(Self { inputs, names: paths.iter().map(name).collect(), rules, grid })
    }

    /// Returns the radius of the body, metres.
    fn radius_m(&self) -> f64 {
        self.grid.georef.crs.sphere_radius_m().unwrap_or(Body::Moon.radius_m())
    }

    /// Joins the DTMs, and passes whole rows to `take`, from top to bottom: metres, NaN where no DTM has a height.
    ///
    /// # Errors
    /// If a DTM cannot be read, or no height is found. Errors of `take` are passed on.
    pub fn make(&self, take: &mut dyn FnMut(&[f32]) -> Result<()>) -> Result<Joined> {
        let bar = progress::bar("", self.grid.rows as u64, "rows");
        let mut joined = Joined { valid: 0, low_m: f32::INFINITY, high_m: f32::NEG_INFINITY };
        for first in (0..self.grid.rows).step_by(BAND_ROWS) {
            interrupt::check("mosaic")?;
            let band = first..(first + BAND_ROWS).min(self.grid.rows);
            let heights_m = join(&self.inputs, &self.grid.rows(band.clone()), &self.rules)?;
            for &z in heights_m.iter().filter(|z| z.is_finite()) {
                let Joined { valid, low_m, high_m } = joined;
                joined = Joined { valid: valid + 1, low_m: low_m.min(z), high_m: high_m.max(z) };
            }
            take(&heights_m)?;
            bar.inc(band.len() as u64);
        }
        bar.finish_and_clear();
        if joined.valid == 0 {
            let what = format!("{}: a valid height on the mosaic's grid expected, none found", self.names.join(", "));
            return Err(Error::usage(what));
        }
        Ok(joined)
    }

    /// Warns of heights that the body does not have. `name` is that of the mosaic.
    pub fn warn(&self, name: &str, joined: &Joined) {
        if let Some(what) = body::beyond(Some(self.radius_m()), (joined.low_m, joined.high_m)) {
            say::warning(&format!("{name}: {what}: are the DTMs' heights metres above the sphere?"));
        }
    }
}

/// Joins the DTMs and writes the mosaic. Returns a line about it.
///
/// # Errors
/// As [`run`].
pub fn write(args: &Args, held: &Held) -> Result<String> {
    output::extension(&args.output, &["tif", "tiff"])?;
    let paths = args.paths()?;
    let inputs = held.files(paths.iter().chain(&args.dem_list).map(PathBuf::as_path));
    let _owner = output::take(&args.output, &inputs)?;
    let joining = Joining::open(args, held)?;
    let (grid, names) = (&joining.grid, &joining.names);
    let about = format!("mosaic of {} DTMs: heights above the {} m sphere", names.len(), joining.radius_m());
    let options = WriteOptions::heights(about).with_item("INPUTS", names.join(", ")).with_compression(args.compress);
    let mut writer = Writer::create(&args.output, grid.rows, grid.cols, Some(&grid.georef), &options)?;
    let joined = joining.make(&mut |rows| writer.write_rows(rows))?;
    writer.finish()?;
    let name = args.output.display().to_string();
    joining.warn(&name, &joined);
    let (Joined { valid, low_m, high_m }, rows, cols) = (joined, grid.rows, grid.cols);
    Ok(format!("{name}: {rows} x {cols} pixels, {valid} of them valid, {low_m:.1} to {high_m:.1} m"))
}

impl Args {
    /// Returns the DTMs' paths.
    fn paths(&self) -> Result<Vec<PathBuf>> {
        self.dem_list.as_deref().map_or_else(|| Ok(self.dems.clone()), listed)
    }
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
