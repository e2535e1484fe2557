//! `host-train inspect`: what a file is understood as.

use crate::{Error, Result, inspect};
use std::path::PathBuf;

/// Options of `inspect`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  host-train inspect SLDEM2015_512_00N_30N_000_045_FLOAT.LBL
  host-train inspect nano.eld

Understood are GeoTIFF, PDS3 images and labels, NumPy arrays, tables of laser points, models (.eld), float weights and golden cases
(.safetensors); the content decides. Large rasters are sampled: the range of values is that of rows at even distances.")]
pub struct Args {
    /// Any file.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// Why the file is not understood.
pub fn run(args: Args) -> Result<()> {
    let bytes = std::fs::metadata(&args.file).map_err(Error::io(&args.file))?.len();
    let print = |text: String| println!("{}: {bytes} bytes\n{text}", args.file.display());
    print(inspect::describe(&args.file, print)?);
    Ok(())
}
