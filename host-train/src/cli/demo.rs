//! `host-train demo`.

use crate::{Error, Result};

/// Options of `demo`.
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// Always: not built yet.
pub fn run(_args: Args) -> Result<()> {
    Err(Error::usage("demo: not built yet"))
}
