//! `host-train demo`: the tour.

use crate::demo::{InitialWeights, SHIPPED_MODEL, TourSettings, run as tour};
use elunar_base::Result;
use std::path::PathBuf;

/// Options of `demo`.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(after_help = "\
Makes a synthetic scene, fine-tunes the network that comes with this program, and exports it for the int8 runner. Predicts the \
scene with both networks, compares them and the coarse DTM with the truth, and writes report.html. Replaces the files of an \
earlier tour in the folder and leaves all others alone.

Examples:
  host-train
  host-train demo --out out --seed 7
  host-train demo --from-scratch --steps 300")]
pub struct Args {
    /// Folder to write into [default: out].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Seed of the tour. Each seed has another scene and other training tiles [default: 0].
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u64).range(..TourSettings::SEEDS))]
    pub seed: Option<u64>,
    /// Number of training steps [default: 24, or 300 from scratch].
    #[arg(long, value_name = "N")]
    pub steps: Option<usize>,
    /// Train nano from random weights instead of fine-tuning.
    #[arg(long)]
    pub from_scratch: bool,
}

/// Runs the command.
///
/// # Errors
/// Errors of the tour.
pub fn run(args: Args) -> Result<()> {
    let start = if args.from_scratch { TourSettings::scratch() } else { InitialWeights::Weights(SHIPPED_MODEL.into()) };
    let out = args.out.unwrap_or_else(|| "out".into());
    let settings = TourSettings::new(out, start, args.seed.unwrap_or(0), args.steps);
    tour(&settings).map(drop)
}
