//! `elunar join`: makes a DTM of parts that `predict --part` made.

use crate::job::{self, Request};
use elunar_base::Result;
use elunar_scene::predict::network::TileModel;
use std::path::Path;

/// Help text below the options.
pub const HELP: &str = "\
Give the options of the parts, without --part. The DTM has the bytes that `predict` alone would write, whatever the number of parts. \
The parts are removed once it is written.

Example:
  elunar join --parts 5 --image strip.tif --coarse coarse.tif --model nano.eld -o dtm.tif";

/// Options of `join`.
#[derive(Debug, clap::Args)]
#[command(after_help = HELP)]
pub struct Args {
    /// Number of parts.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub parts: u32,
    /// What the parts were asked for.
    #[command(flatten)]
    pub request: Request,
    /// Print what was taken and found as one JSON object on stdout; the text goes to stderr.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// If a part is missing or of another job, or the DTM cannot be written. Then no DTM exists, and the parts stay.
pub fn run(args: Args) -> Result<()> {
    run_with(args, job::open)
}

/// Runs the command with models from `open`.
///
/// # Errors
/// As [`run`].
pub fn run_with(args: Args, open: impl FnOnce(&Path) -> Result<Box<dyn TileModel>>) -> Result<()> {
    job::join(&args.request, args.parts as usize, open).map(|done| done.print(args.json))
}
