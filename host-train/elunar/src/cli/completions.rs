//! `elunar completions`: completions of the command line for a shell.

use super::Cli;
use clap::CommandFactory;
use clap_complete::Shell;
use elunar_base::{Error, Result};
use std::io::Write;

/// Options of `completions`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  elunar completions bash")]
pub struct Args {
    /// The shell.
    pub shell: Shell,
}

/// Runs the command: prints the completions.
///
/// # Errors
/// [`Error::Io`] if standard output cannot be written.
pub fn run(args: &Args) -> Result<()> {
    let mut script = vec![];
    clap_complete::generate(args.shell, &mut Cli::command(), "elunar", &mut script);
    std::io::stdout().write_all(&script).map_err(Error::io("standard output"))
}
