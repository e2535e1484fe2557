//! `host-train init`.

use crate::{Error, Result};

/// Options of `init`.
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// Always: not built yet.
pub fn run(_args: Args) -> Result<()> {
    Err(Error::usage("init: not built yet"))
}
