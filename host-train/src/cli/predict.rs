//! `host-train predict`: an image and a coarse DTM in, a DTM out; `elunar`'s command, for float networks, too.

use elunar::cli::predict as shared;
use elunar_learn::float::open_any;
use elunar_learn::model::backend::Backend;
use elunar_raster::Result;

/// Options of `predict`.
#[derive(Debug, clap::Args)]
#[command(after_help = shared::HELP)]
pub struct Args {
    /// What both programs take.
    #[command(flatten)]
    pub shared: shared::Args,
    /// Where a float network runs.
    #[arg(long, default_value = "flex")]
    pub backend: Backend,
}

/// Runs the command.
///
/// # Errors
/// From reading the inputs, opening the model, predicting and writing; no DTM is left behind then.
pub fn run(args: Args) -> Result<()> {
    shared::run_with(args.shared, |path| open_any(path, args.backend))
}
