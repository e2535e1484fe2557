//! `host-train init`: writes new weights.

use crate::config::Configuration;
use elunar::outputs as output;
use elunar_base::{Error, Result};
use elunar_learn::model::init::{initial_weights, weights_for};
use elunar_net::config::{Preset, config_of};
use elunar_net::weights::NetWeights;
use std::path::PathBuf;

/// Options of `init`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
`train` without --start-from makes its weights itself.

With --from, the weights of another network are kept and only its configuration changes, as far as its tensors still fit: weights for \
given light, say, also serve weighed maps. Maps that the image gains, a detail stage, and a wider one, change nothing at first.

Examples:
  host-train init --preset tiny --seed 7 -o tiny.safetensors
  host-train init --from nano.safetensors --set network.detail=32 network.detail_inner=16 -o start.safetensors")]
pub struct Args {
    /// Network of a preset [default: nano].
    #[arg(long, conflicts_with = "from")]
    pub preset: Option<Preset>,
    /// Network of a configuration file.
    #[arg(long, value_name = "FILE.toml", conflicts_with_all = ["preset", "from"])]
    pub config: Option<PathBuf>,
    /// Keep the weights and the network of this file, and change only what is set.
    #[arg(long, value_name = "W.safetensors")]
    pub from: Option<PathBuf>,
    /// Change keys of the network, as network.head=relu.
    #[arg(long = "set", value_name = "KEY=VALUE", num_args = 1..)]
    pub settings: Vec<String>,
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
/// If settings are unknown or contradict each other, the weights of `--from` do not fit them, or a file cannot be read or written.
pub fn run(args: Args) -> Result<()> {
    let _owner = output::take(&args.output, &args.from.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
    let loaded = args.from.as_ref().map(|path| NetWeights::read(path)).transpose()?;
    let mut made = match &args.config {
        Some(path) => Configuration::read(path)?,
        None => Configuration::preset(args.preset.unwrap_or(Preset::Nano))?,
    };
    if let (Some(weights), Some(path)) = (&loaded, &args.from) {
        made.network = config_of(weights, path)?;
    }
    for setting in &args.settings {
        made = made.set(setting)?;
    }
    let Configuration { network, like, name, .. } = made;
    network.check().map_err(Error::usage)?;
    let (weights, what) = match (loaded, &args.from) {
        (Some(weights), Some(path)) => {
            (weights_for(weights, &network, args.seed, path)?, format!("the weights of {}", path.display()))
        }
        _ => (initial_weights(&network, args.seed), if name.is_empty() { like } else { name }),
    };
    weights.write(&args.output)?;
    let count: usize = weights.tensors.values().map(|a| a.data.len()).sum();
    println!("{}: {what}, {} tensors, {count} numbers", args.output.display(), weights.tensors.len());
    Ok(())
}
