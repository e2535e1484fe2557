//! `host-train init`: writes new weights.

use elunar_learn::model::init::initial_weights;
use elunar_net::config::{NetConfig, Preset, Switches};
use elunar_raster::Result;
use std::path::PathBuf;

/// Options of `init`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The switches depart from the paper's network; without any, the network is the paper's at the preset's width. `train` without \
--start-from makes its weights itself.

Example:
  host-train init --preset tiny --seed 7 -o tiny.safetensors")]
pub struct Args {
    /// Size of the network.
    #[arg(long, default_value = "nano")]
    pub preset: Preset,
    /// Changes to the paper's network.
    #[command(flatten)]
    pub switches: Switches,
    /// Seed of the random weights.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// File to write.
    #[arg(short, long, value_name = "W.safetensors")]
    pub output: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// If the switches contradict each other or the file cannot be written.
pub fn run(args: Args) -> Result<()> {
    let config = args.switches.apply(NetConfig::preset(args.preset))?;
    let weights = initial_weights(&config, args.seed);
    weights.write(&args.output)?;
    let count: usize = weights.tensors.values().map(|a| a.data.len()).sum();
    println!("{}: {:?}, {} tensors, {count} numbers", args.output.display(), args.preset, weights.tensors.len());
    Ok(())
}
