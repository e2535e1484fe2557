//! `host-train inspect`.

use crate::{Error, Result};

/// Options of `inspect`.
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// Always: not built yet.
pub fn run(_args: Args) -> Result<()> {
    Err(Error::usage("inspect: not built yet"))
}
