//! The command line: one file per command, each with its `Args` and its `run`.

pub mod average;
pub mod check;
pub mod demo;
pub mod diff;
pub mod evaluate;
pub mod experiment;
pub mod export;
pub mod faults;
pub mod hillshade;
pub mod init;
pub mod inspect;
pub mod latency;
pub mod lola;
pub mod mosaic;
mod output;
pub mod predict;
pub mod prepare;
pub mod render;
pub mod report;
pub mod sfs;
pub mod suite;
pub mod synth;
pub mod train;

use crate::Result;
use clap::{Parser, Subcommand};

/// Terrain models of the Moon from one orbiter image and a coarse DTM.
#[derive(Debug, Parser)]
#[command(name = "host-train", version, about, arg_required_else_help = false)]
pub struct Cli {
    /// What to do; without a command, the demo.
    #[command(subcommand)]
    pub command: Option<Command>,
}

/// One per file of this folder.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Make a scene, train, export, predict and evaluate, with a report (the default).
    Demo(demo::Args),
    /// Write synthetic scenes: image, coarse DTM and true DTM as lunar GeoTIFFs.
    Synth(synth::Args),
    /// Make a training set from images, DTMs and coarse DTMs.
    Prepare(prepare::Args),
    /// Write freshly initialised weights.
    Init(init::Args),
    /// Compare the network with a golden file, map by map.
    Check(check::Args),
    /// Train a network.
    Train(Box<train::Args>),
    /// Take the mean of several weight files.
    Average(average::Args),
    /// Train experiments from their files, test them, and put them side by side.
    Experiment(experiment::Args),
    /// Turn weights into the model file of the int8 runner.
    Export(export::Args),
    /// Predict a DTM from an image and a coarse DTM.
    Predict(predict::Args),
    /// Make a DTM by shape from shading, for comparison.
    Sfs(Box<sfs::Args>),
    /// Judge a DTM against a truth.
    Evaluate(evaluate::Args),
    /// Judge models on test scenes, with tables and pictures.
    Suite(suite::Args),
    /// Make one page of test suites, experiments and training runs.
    Report(report::Args),
    /// Flip bits while a tile is at work, and count what comes of it.
    Faults(faults::Args),
    /// Shade a DTM, as `gdaldem hillshade` does.
    Hillshade(hillshade::Args),
    /// Take an image of a DTM under a Sun of one's choice.
    Render(render::Args),
    /// Subtract one DTM from another, with statistics.
    Diff(diff::Args),
    /// Join overlapping DTMs, as `dem_mosaic` does.
    Mosaic(mosaic::Args),
    /// Shift laser altimeter tracks over a DTM and say how well they fit.
    Lola(lola::Args),
    /// Say what a file is understood as: raster, label, track, model or weights.
    Inspect(inspect::Args),
    /// Measure the latency of one tile.
    Latency(latency::Args),
}

/// Runs the parsed command.
///
/// # Errors
/// The command's own.
pub fn run(cli: Cli) -> Result<()> {
    match cli.command {
        Some(Command::Demo(args)) => demo::run(args),
        None => demo::run(demo::Args::default()),
        Some(Command::Synth(args)) => synth::run(args),
        Some(Command::Prepare(args)) => prepare::run(args),
        Some(Command::Init(args)) => init::run(args),
        Some(Command::Check(args)) => check::run(args),
        Some(Command::Train(args)) => train::run(*args),
        Some(Command::Average(args)) => average::run(args),
        Some(Command::Experiment(args)) => experiment::run(args),
        Some(Command::Export(args)) => export::run(args),
        Some(Command::Predict(args)) => predict::run(args),
        Some(Command::Sfs(args)) => sfs::run(*args),
        Some(Command::Evaluate(args)) => evaluate::run(args),
        Some(Command::Suite(args)) => suite::run(args),
        Some(Command::Report(args)) => report::run(args),
        Some(Command::Hillshade(args)) => hillshade::run(args),
        Some(Command::Render(args)) => render::run(args),
        Some(Command::Diff(args)) => diff::run(args),
        Some(Command::Mosaic(args)) => mosaic::run(args),
        Some(Command::Lola(args)) => lola::run(args),
        Some(Command::Inspect(args)) => inspect::run(args),
        Some(Command::Faults(args)) => faults::run_command(&args),
        Some(Command::Latency(args)) => latency::run(args),
    }
}
