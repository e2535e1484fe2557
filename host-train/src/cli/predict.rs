//! `host-train predict`: makes a DTM from an image and a coarse DTM. It is the command of `elunar`, extended to float networks.

use elunar::cli::predict as shared;
use elunar_base::Result;
use elunar_learn::float::open_any;
use elunar_learn::model::backend::Backend;

/// Options of `predict`.
#[derive(Debug, clap::Args)]
#[command(after_help = shared::HELP)]
pub struct Args {
    /// Options of both programs.
    #[command(flatten)]
    pub shared: shared::Args,
    /// Backend of a float network.
    #[arg(long, default_value = "flex", value_parser = Backend::parser())]
    pub backend: Backend,
}

/// Runs the command.
///
/// # Errors
/// If an input cannot be read, the model cannot be opened, or predicting or writing fails. Then no DTM exists.
pub fn run(args: Args) -> Result<()> {
    shared::run_with(args.shared, |path| open_any(path, args.backend))
}
