//! The program without a training framework: all commands except training, float networks and commands that need them.

use clap::Parser;
use elunar::cli::{Cli, run};
use elunar::memory::Memory;
use elunar::program::{finish, read_command_line};
use std::process::ExitCode;

/// Refused memory is one error line.
#[global_allocator]
static MEMORY: Memory = Memory;

fn main() -> ExitCode {
    let parsed = read_command_line(Cli::try_parse);
    parsed.talk.begin();
    finish(|| run(parsed.command))
}
