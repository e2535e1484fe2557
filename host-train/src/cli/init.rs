//! `host-train init`: writes new weights.

use elunar::cli::output;
use elunar_learn::model::init::{initial_weights, weights_for};
use elunar_net::config::{NetConfig, Preset, Switches, config_of};
use elunar_net::weights::Weights;
use elunar_raster::Result;
use std::path::PathBuf;

/// Options of `init`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The switches depart from the paper's network; without any, the network is the paper's at the preset's width. `train` without \
--start-from makes its weights itself.

With --from, the weights of another network are kept and only its switches change, as far as its tensors still fit: weights for \
given light, say, also serve weighed maps. Maps that the image gains, a detail stage, and a wider one, change nothing at first.

Examples:
  host-train init --preset tiny --seed 7 -o tiny.safetensors
  host-train init --from nano.safetensors --illumination sloped --detail 16 -o start.safetensors")]
pub struct Args {
    /// Size of the network.
    #[arg(long, default_value = "nano")]
    pub preset: Preset,
    /// Keep the weights and the configuration of this network, and change the switches alone.
    #[arg(long, value_name = "W.safetensors", conflicts_with = "preset")]
    pub from: Option<PathBuf>,
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
/// If the switches contradict each other, the weights of `--from` do not fit them, or a file cannot be read or written.
pub fn run(args: Args) -> Result<()> {
    let _owner = output::take(&args.output, &args.from.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
    let (weights, what) = match &args.from {
        Some(path) => {
            let weights = Weights::read(path)?;
            let config = args.switches.apply(config_of(&weights, path)?)?;
            (weights_for(weights, &config, args.seed, path)?, format!("the weights of {}", path.display()))
        }
        None => {
            let config = args.switches.apply(NetConfig::preset(args.preset))?;
            (initial_weights(&config, args.seed), format!("{:?}", args.preset))
        }
    };
    weights.write(&args.output)?;
    let count: usize = weights.tensors.values().map(|a| a.data.len()).sum();
    println!("{}: {what}, {} tensors, {count} numbers", args.output.display(), weights.tensors.len());
    Ok(())
}
