//! Main function: parses the arguments, runs the command, prints errors.

use clap::FromArgMatches;
use elunar::memory::Memory;
use elunar::program::{finish, read_command_line};
use host_train::cli::{Cli, command_line, run};
use std::process::ExitCode;

/// Refused memory is one error line.
#[global_allocator]
static MEMORY: Memory = Memory;

fn main() -> ExitCode {
    let parsed = read_command_line(|| command_line().try_get_matches().and_then(|found| Cli::from_arg_matches(&found)));
    finish(|| run(parsed))
}
