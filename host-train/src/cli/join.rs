//! `host-train join`: makes a DTM of parts. It is the command of `elunar`, extended to float networks.

use elunar::cli::join as shared;
use elunar_base::Result;
use elunar_learn::float::open_any;
use elunar_learn::model::backend::Backend;

/// Options of `join`.
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
/// As that of `elunar`.
pub fn run(args: Args) -> Result<()> {
    shared::run_with(args.shared, |path| open_any(path, args.backend))
}
