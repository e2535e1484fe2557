//! `elunar predict`: makes a DTM from an image and a coarse DTM.

use crate::job::{self, Request};
use elunar_base::Result;
use elunar_scene::predict::network::TileModel;
use elunar_scene::predict::span::PartOf;
use std::path::Path;

/// Help text below the options.
pub const HELP: &str = "\
Image and coarse DTM are GeoTIFFs or PDS3 products, each on a grid of its own and in a projection of its own, on \
one sphere. The DTM gets the image's grid. Pixels without a valid image sample or coarse height become nodata. A hillshade is \
written beside the DTM (dtm_hillshade.png).

Finished rows wait in dtm.tif.part until all are done: after Ctrl-C or a kill the same command goes on from there. A DTM that the \
same job has finished, with the SHA-256 that lies beside it (dtm.tif.sha256), is not made again.

Example:
  elunar predict --image scene_0000_image.tif --coarse scene_0000_coarse.tif --model ground -o dtm.tif";

/// Options of `predict`.
#[derive(Debug, clap::Args)]
#[command(after_help = HELP)]
pub struct Args {
    /// What is wanted.
    #[command(flatten)]
    pub request: Request,
    /// Make only the rows of part K of N, in dtm.tif.K-of-N.rows; `join` makes the DTM of all parts.
    #[arg(long, value_name = "K/N")]
    pub part: Option<PartOf>,
    /// Print what was taken and found as one JSON object on stdout; the text goes to stderr.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// If an input cannot be read, the model cannot be opened, or predicting or writing fails. Then no DTM exists.
pub fn run(args: Args) -> Result<()> {
    run_with(args, job::open)
}

/// Runs the command with models from `open`.
///
/// # Errors
/// As [`run`].
pub fn run_with(args: Args, open: impl FnOnce(&Path) -> Result<Box<dyn TileModel>>) -> Result<()> {
    job::run(&args.request, args.part, open).map(|done| done.print(args.json))
}
