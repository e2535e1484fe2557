//! `elunar inspect`: describes a file.

use crate::inspect;
use crate::picture::arena;
use elunar_base::Result;
use elunar_net::inspect::plan_text;
use elunar_net::{kernels, shipped};
use std::path::PathBuf;

/// Options of `inspect`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Understands GeoTIFF, PDS3 images and labels, NumPy arrays, tables of laser points, models (.eld), float weights and golden cases \
(.safetensors). The content decides, not the name. Large rasters are sampled: the range of values is that of rows at even \
distances.

Of a model, lists every operator, how many rows of its output are kept at a time, and where the map lies in memory. --time runs \
the built-in tile entry by entry of the schedule; the figures contain the small cost of stepping.

Examples:
  elunar inspect SLDEM2015_512_00N_30N_000_045_FLOAT.LBL
  elunar inspect nano.eld --time --plan plan.png")]
pub struct Args {
    /// Any file; `ground` and `nano` are the models in this program.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Measure the time of every operator of a model.
    #[arg(long)]
    pub time: bool,
    /// Draw a model's memory during a tile, tensor by tensor.
    #[arg(long, value_name = "P.png")]
    pub plan: Option<PathBuf>,
    /// Print a model's plan as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Number of tiles that are timed.
const TILES: usize = 5;

/// Runs the command.
///
/// # Errors
/// If the file is of no known kind, or broken.
pub fn run(args: Args) -> Result<()> {
    // What is described was read, so it is there.
    let length = || std::fs::metadata(&args.file).map_or(0, |found| found.len());
    let bytes = || shipped::find(&args.file).map_or_else(length, |(_, bytes)| bytes.len() as u64);
    let print = |text: String| println!("{}: {} bytes\n{text}", args.file.display(), bytes());
    if !args.time && !args.json && args.plan.is_none() {
        print(inspect::describe(&args.file, print)?);
        return Ok(());
    }
    if let Some(picture) = &args.plan {
        crate::outputs::extension(picture, &["png"])?;
    }
    let _owner = crate::outputs::take_all(&args.plan, &[&args.file])?;
    let plan = inspect::plan(&args.file, args.time.then_some((kernels::best(), TILES)))?;
    if let Some(path) = &args.plan {
        elunar_picture::write_png(path, arena(&plan)?)?;
    }
    if args.json {
        println!("{}", plan.json()?);
    } else {
        print(plan_text(&plan));
    }
    Ok(())
}
