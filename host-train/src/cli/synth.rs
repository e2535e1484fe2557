//! `host-train synth`.

use crate::{Error, Result};

/// Options of `synth`.
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// Always: not built yet.
pub fn run(_args: Args) -> Result<()> {
    Err(Error::usage("synth: not built yet"))
}
