//! The program without a training framework: all commands except training, float networks and commands that need them.

use clap::Parser;
use elunar::cli::{Cli, run};
use elunar::program::finish;
use std::process::ExitCode;

fn main() -> ExitCode {
    finish(|| run(Cli::parse().command))
}
