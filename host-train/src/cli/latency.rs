//! `host-train latency`: measures the time of a tile. It is the command of `elunar`, extended to float networks.

use elunar::cli::latency as shared;
use elunar_base::Result;
use elunar_learn::float::{is_float, open};
use elunar_learn::model::backend::Backend;

/// Options of `latency`.
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
/// If the model cannot be read or fails its self test.
pub fn run(args: Args) -> Result<()> {
    if !is_float(&args.shared.model) {
        return shared::run(args.shared);
    }
    let model = open(&args.shared.model, args.backend)?;
    let kernel = format!("float, {}", args.backend.name());
    shared::run_other(&args.shared, &model, kernel)
}
