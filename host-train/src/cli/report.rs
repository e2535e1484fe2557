//! `host-train report`: writes one page about suites, experiments, training runs and records.

use crate::report;
use elunar::outputs as output;
use elunar_base::Result;
use std::path::{Path, PathBuf};

/// Options of `report`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The page contains its tables and pictures: one file to send and to open anywhere.

Example:
  host-train report out/suite out/experiments runs/nano -o report.html
  host-train report out/experiments -o experiments.html")]
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
    let read = args.folders.iter().flat_map(|folder| files(folder)).collect::<Vec<_>>();
    let _owner = output::take(&args.output, &read.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
    report::write(&args.folders, &args.output)?;
    println!("{}", args.output.display());
    Ok(())
}

/// Returns the files of a folder and the folders in it but for pages, which are written and not read.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut all = vec![];
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let (path, kind) = (entry.path(), entry.file_type());
        if kind.is_ok_and(|kind| kind.is_dir()) {
            all.extend(files(&path));
        } else if path.extension().is_none_or(|end| end != "html") {
            all.push(path);
        }
    }
    all
}
