//! `host-train export`.

use crate::{Error, Result};

/// Options of `export`.
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// Always: not built yet.
pub fn run(_args: Args) -> Result<()> {
    Err(Error::usage("export: not built yet"))
}
