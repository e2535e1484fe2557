//! The commands. Each has a file with its `Args` and its `run`.

pub mod batch;
pub mod completions;
pub mod diff;
pub mod evaluate;
pub mod export;
pub mod hillshade;
#[cfg(test)]
mod input;
pub mod inspect;
pub mod join;
pub mod latency;
pub mod lola;
pub mod man;
pub mod manifest;
pub mod mosaic;
pub mod plan;
pub mod predict;
pub mod prepare;
pub mod render;
pub mod sfs;
pub mod status;
pub mod sun;
pub mod synth;
pub mod talk;

use clap::{Parser, Subcommand};
use elunar_base::Result;
use talk::Talk;

/// Terrain models of the Moon from one orbiter image and a coarse DTM.
#[derive(Debug, Parser)]
#[command(name = "elunar", version, about, arg_required_else_help = true)]
pub struct Cli {
    /// How much is said.
    #[command(flatten)]
    pub talk: Talk,
    /// Command to run.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands of `elunar`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Predict a DTM from an image and a coarse DTM.
    Predict(Box<predict::Args>),
    /// Join the parts of a DTM that `predict --part` made.
    Join(Box<join::Args>),
    /// Measure the latency of one tile.
    Latency(latency::Args),
    /// Print completions of the command line for a shell.
    Completions(completions::Args),
    /// Write manual pages of all commands.
    Man(man::Args),
    /// The commands that `elunar` and `host-train` share.
    #[command(flatten)]
    Shared(Shared),
}

/// The commands of both programs. None runs a float network.
#[derive(Debug, Subcommand)]
pub enum Shared {
    /// Make or check a manifest: a line for every image of an archive.
    Manifest(manifest::Args),
    /// Predict the DTMs of a chunk of a manifest, one process an image.
    Batch(batch::Args),
    /// Say what became of the items of a manifest.
    Status(status::Args),
    /// Say beforehand what a manifest takes: core hours, bytes, memory, chunks.
    Plan(plan::Args),
    /// Write synthetic scenes: image, coarse DTM and true DTM as lunar GeoTIFFs.
    Synth(synth::Args),
    /// Make a training set from images, DTMs and coarse DTMs.
    Prepare(prepare::Args),
    /// Make the model file of the int8 runner from weights.
    Export(export::Args),
    /// Make a DTM by shape from shading, for comparison.
    Sfs(Box<sfs::Args>),
    /// Compare a DTM with a truth.
    Evaluate(evaluate::Args),
    /// Shade a DTM, as `gdaldem hillshade` does.
    Hillshade(hillshade::Args),
    /// Render an image of a DTM under a given Sun.
    Render(render::Args),
    /// Subtract one DTM from another, with statistics.
    Diff(diff::Args),
    /// Join overlapping DTMs, as `dem_mosaic` does.
    Mosaic(mosaic::Args),
    /// Compare a DTM with laser altimeter tracks, each shifted to its best fit.
    Lola(lola::Args),
    /// Describe a file: raster, label, track, model or weights.
    Inspect(inspect::Args),
    /// Say where the Sun stands on the Moon or on Mars.
    Sun(sun::Args),
}

/// Runs a command of `elunar`.
///
/// # Errors
/// Errors of the command.
pub fn run(command: Command) -> Result<()> {
    match command {
        Command::Predict(args) => predict::run(*args),
        Command::Join(args) => join::run(*args),
        Command::Latency(args) => latency::run(args),
        Command::Completions(args) => completions::run(&args),
        Command::Man(args) => man::run(&args),
        Command::Shared(shared) => run_shared(shared),
    }
}

/// Runs a command that both programs share.
///
/// # Errors
/// Errors of the command.
pub fn run_shared(command: Shared) -> Result<()> {
    match command {
        Shared::Manifest(args) => manifest::run(args),
        Shared::Batch(args) => batch::run(args),
        Shared::Status(args) => status::run(args),
        Shared::Plan(args) => plan::run(args),
        Shared::Synth(args) => synth::run(args),
        Shared::Prepare(args) => prepare::run(args),
        Shared::Export(args) => export::run(args),
        Shared::Sfs(args) => sfs::run(*args),
        Shared::Evaluate(args) => evaluate::run(args),
        Shared::Hillshade(args) => hillshade::run(args),
        Shared::Render(args) => render::run(args),
        Shared::Diff(args) => diff::run(args),
        Shared::Mosaic(args) => mosaic::run(args),
        Shared::Lola(args) => lola::run(args),
        Shared::Inspect(args) => inspect::run(args),
        Shared::Sun(args) => sun::run(&args),
    }
}

/// Checks that the help of every command of `program` holds no Rust syntax and ends with examples that parse.
///
/// # Panics
/// If a command's help has a defect; the message names it. For tests.
#[doc(hidden)]
pub fn check_help(program: &clap::Command) {
    let name = program.get_name();
    for command in program.get_subcommands() {
        let which = format!("{name} {}", command.get_name());
        let help = command.clone().term_width(0).render_long_help().to_string();
        for code in ["[`", "`]", "::", "Self::"] {
            assert!(!help.contains(code), "{which}: the help holds {code:?}, which is Rust's:\n{help}");
        }
        let (_, examples) = help.rsplit_once("\nExample").unwrap_or_else(|| panic!("{which}: no example:\n{help}"));
        let examples: Vec<&str> = examples.lines().skip(1).filter(|line| !line.trim().is_empty()).collect();
        assert!(!examples.is_empty(), "{which}: no example");
        for line in examples {
            let words: Vec<&str> = line.split_whitespace().collect();
            assert!(line.starts_with(&format!("  {name}")), "{which}: an example of {name} expected, found {line}");
            if let Err(error) = program.clone().try_get_matches_from(&words) {
                panic!("{which}: the example {line} does not parse: {error}");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn every_help_ends_with_examples_that_parse() {
        check_help(&Cli::command());
    }
}
