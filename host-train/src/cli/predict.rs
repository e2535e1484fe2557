//! `host-train predict`.

use crate::{Error, Result};

/// Options of `predict`.
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// Always: not built yet.
pub fn run(_args: Args) -> Result<()> {
    Err(Error::usage("predict: not built yet"))
}
