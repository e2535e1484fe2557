//! The program of the page: `predict` and `latency` as `elunar` has them, and `view`, which writes the maps that the page draws. It is compiled for WebAssembly with
//! WASI; its files are in the page's memory.

mod view;

use clap::{Parser, Subcommand};
use elunar::cli::talk::Talk;
use elunar::cli::{latency, predict};
use elunar::memory::Memory;
use elunar::program::{finish, read_command_line};
use std::process::ExitCode;

/// Refused memory is one error line.
#[global_allocator]
static MEMORY: Memory = Memory;

/// Terrain models of the Moon in a browser.
#[derive(Debug, Parser)]
#[command(name = "elunar-web", version, about, arg_required_else_help = true)]
struct Cli {
    /// How much is said.
    #[command(flatten)]
    talk: Talk,
    /// Command to run.
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Predict a DTM from an image and a coarse DTM.
    Predict(Box<predict::Args>),
    /// Measure the latency of one tile.
    Latency(latency::Args),
    /// Write the maps that the page draws.
    View(Box<view::Args>),
}

fn main() -> ExitCode {
    let parsed = read_command_line(Cli::try_parse);
    parsed.talk.begin();
    finish(|| match parsed.command {
        Command::Predict(args) => predict::run(*args),
        Command::Latency(args) => latency::run(args),
        Command::View(args) => view::run(&args),
    })
}
