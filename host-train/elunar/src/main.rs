//! The program without a training framework: everything but training, float networks and what is built on them.

use clap::Parser;
use elunar::cli::{Cli, run};
use elunar::program::finish;
use std::process::ExitCode;

fn main() -> ExitCode {
    finish(|| run(Cli::parse().command))
}
