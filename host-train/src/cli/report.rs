//! `host-train report`: writes one page about suites, experiments, training runs and records.

use crate::report;
use elunar::cli::output;
use elunar_raster::Result;
use std::path::PathBuf;

/// Options of `report`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The page contains its tables and pictures: one file to send and to open anywhere.

Example:
  host-train report out/suite out/experiments runs/nano -o report.html
  host-train report host-train/experiments/record -o record.html")]
pub struct Args {
    /// Folders that `suite`, `experiment` or `train` has written, or folders with CSV tables.
    #[arg(required = true, value_name = "DIR")]
    pub folders: Vec<PathBuf>,
    /// Page to write.
    #[arg(short, long, value_name = "PAGE.html")]
    pub output: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// If a folder holds no results, or the page cannot be written.
pub fn run(args: Args) -> Result<()> {
    let _owner = output::take(&args.output, &[])?;
    report::write(&args.folders, &args.output)?;
    println!("{}", args.output.display());
    Ok(())
}
