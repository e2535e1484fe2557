//! `host-train train`.

use crate::{Error, Result};

/// Options of `train`.
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// Always: not built yet.
pub fn run(_args: Args) -> Result<()> {
    Err(Error::usage("train: not built yet"))
}
