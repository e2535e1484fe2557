//! Main function: parses the arguments, runs the command, prints errors.

use clap::FromArgMatches;
use elunar::memory::Memory;
use elunar::program::finish;
use host_train::cli::{Cli, command_line, run};
use std::process::ExitCode;

/// Refused memory is one error line.
#[global_allocator]
static MEMORY: Memory = Memory;

fn main() -> ExitCode {
    let parsed = Cli::from_arg_matches(&command_line().get_matches()).unwrap_or_else(|error| error.exit());
    finish(|| run(parsed))
}
