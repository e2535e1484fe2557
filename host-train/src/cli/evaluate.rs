//! `host-train evaluate`.

use crate::{Error, Result};

/// Options of `evaluate`.
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// Always: not built yet.
pub fn run(_args: Args) -> Result<()> {
    Err(Error::usage("evaluate: not built yet"))
}
