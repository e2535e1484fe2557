//! `host-train check`: the network against a golden file, map by map.

use elunar_base::{Error, Result};
use elunar_learn::check::compare;
use elunar_learn::model::backend::Backend;
use std::path::PathBuf;

/// Options of `check`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  host-train check tests/golden/mini/case.safetensors")]
pub struct Args {
    /// Golden files: weights, inputs, traced maps, output, loss terms and metrics.
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Backend to run on.
    #[arg(long, default_value = "flex", value_parser = Backend::parser())]
    pub backend: Backend,
}

/// Runs the command.
///
/// # Errors
/// If a file is unreadable or broken, or any quantity leaves its tolerance.
pub fn run(args: Args) -> Result<()> {
    let device = args.backend.device()?;
    let mut failed = Vec::new();
    for path in &args.files {
        println!("{} on {}", path.display(), args.backend.name());
        for line in compare(path, &device)? {
            let ok = line.error <= line.tolerance;
            println!("  {:24} {:10.3e}  {}  {}", line.name, line.error, if ok { "ok" } else { "FAILED" }, line.note);
            if !ok {
                failed.push(format!(
                    "{}: {} off by {:.3e}: expected at most {:e}",
                    path.display(),
                    line.name,
                    line.error,
                    line.tolerance
                ));
            }
        }
    }
    match failed.first() {
        None => Ok(()),
        Some(first) if failed.len() == 1 => Err(Error::usage(first)),
        Some(first) => Err(Error::usage(format!("{first}; {} more", failed.len() - 1))),
    }
}
