//! The command line. Each command has a file with its `Args` and its `run`.

pub mod average;
pub mod check;
pub mod demo;
pub mod devices;
pub mod experiment;
pub mod faults;
pub mod init;
pub mod join;
pub mod latency;
pub mod predict;
pub mod report;
pub mod suite;
pub mod train;
pub mod train_speed;

use clap::{CommandFactory, Parser, Subcommand};
use elunar::cli::talk::Talk;
use elunar::cli::{Shared, run_shared};
use elunar_base::Result;

/// Terrain models of the Moon from one orbiter image and a coarse DTM.
#[derive(Debug, Parser)]
#[command(name = "host-train", version, about, arg_required_else_help = false)]
pub struct Cli {
    /// How much is said.
    #[command(flatten)]
    pub talk: Talk,
    /// Command to run; without a command, the tour.
    #[command(subcommand)]
    pub command: Option<Command>,
}

/// The commands: those of `elunar`, and those that need the float network.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Make a scene, train, export, predict and evaluate, with a report (the default).
    Demo(demo::Args),
    /// Write new weights.
    Init(init::Args),
    /// Compare the network with a golden file, map by map.
    Check(check::Args),
    /// Train a network.
    Train(Box<train::Args>),
    /// Take the mean of several weight files.
    Average(average::Args),
    /// Train experiments from their files, test them, and compare them.
    Experiment(experiment::Args),
    /// Predict a DTM from an image and a coarse DTM.
    Predict(Box<predict::Args>),
    /// Join the parts of a DTM that `predict --part` made.
    Join(Box<join::Args>),
    /// Score models on test scenes, with tables and pictures.
    Suite(suite::Args),
    /// Write one page about test suites, experiments and training runs.
    Report(report::Args),
    /// Flip bits while a tile runs, and count the outcomes.
    Faults(faults::Args),
    /// Measure the latency of one tile.
    Latency(latency::Args),
    /// Measure training steps per second, and how fast their tiles are made.
    TrainSpeed(train_speed::Args),
    /// List the devices of every backend.
    Devices(devices::Args),
    /// The commands that `elunar` also has.
    #[command(flatten)]
    Shared(Shared),
}

/// Returns the program's command line. The examples of shared commands show this program's name.
#[must_use]
pub fn command_line() -> clap::Command {
    let named = |command: clap::Command| {
        let here = |text: String| text.replace("  elunar ", "  host-train ");
        match command.get_after_help().map(ToString::to_string) {
            Some(text) => command.after_help(here(text)),
            None => command,
        }
    };
    Cli::command().mut_subcommands(named)
}

/// Runs the parsed command.
///
/// # Errors
/// Errors of the command.
pub fn run(cli: Cli) -> Result<()> {
    cli.talk.begin();
    match cli.command {
        Some(Command::Demo(args)) => demo::run(args),
        None => demo::run(demo::Args::default()),
        Some(Command::Init(args)) => init::run(args),
        Some(Command::Check(args)) => check::run(args),
        Some(Command::Train(args)) => train::run(*args),
        Some(Command::Average(args)) => average::run(args),
        Some(Command::Experiment(args)) => experiment::run(args),
        Some(Command::Predict(args)) => predict::run(*args),
        Some(Command::Join(args)) => join::run(*args),
        Some(Command::Suite(args)) => suite::run(args),
        Some(Command::Report(args)) => report::run(args),
        Some(Command::Faults(args)) => faults::run_command(&args),
        Some(Command::Latency(args)) => latency::run(args),
        Some(Command::TrainSpeed(args)) => train_speed::run(&args),
        Some(Command::Devices(args)) => devices::run(&args),
        Some(Command::Shared(shared)) => run_shared(shared),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_help_ends_with_examples_that_parse() {
        elunar::cli::check_help(&command_line());
    }
}
