//! `host-train latency`.

use crate::{Error, Result};

/// Options of `latency`.
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// Always: not built yet.
pub fn run(_args: Args) -> Result<()> {
    Err(Error::usage("latency: not built yet"))
}
