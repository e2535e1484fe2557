//! `host-train check`.

use crate::{Error, Result};

/// Options of `check`.
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// Always: not built yet.
pub fn run(_args: Args) -> Result<()> {
    Err(Error::usage("check: not built yet"))
}
