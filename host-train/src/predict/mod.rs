//! A scene through the network, tile by tile.
//!
//! [`Scene::new`] puts the coarse DTM on the image's grid; [`predict_rows`] cuts the scene into overlapping tiles, runs a
//! [`network::Model`] over them and joins the heights, a band of rows at a time; [`Part`] keeps finished rows on disk. The network is float or int8: [`open`] looks at the file's extension.

pub mod float;
pub mod int8;
pub mod network;
mod output;
mod part;
mod preview;
mod run;
mod scene;
mod tile;

#[cfg(test)]
mod strip_tests;
#[cfg(test)]
mod tests;

pub use output::{DtmWriter, Provenance, hillshade_path};
pub use part::Part;
pub(crate) use run::{Cut, TileMaker, make_rows};
pub use run::{Options, Prediction, Progress, Tally, predict, predict_rows};
pub(crate) use scene::{Band, Cutout};
pub use scene::{Input, Scene, Survey};
pub(crate) use tile::Outcome;

use crate::model::backend::Backend;
use crate::{Error, Result};
use network::Model;
use std::path::Path;

/// Opens a model: `.safetensors` is a float network, run on `backend`; `.eld` an exported one for the int8 runner.
///
/// # Errors
/// [`Error::Unsupported`] for another extension; [`Error::Io`] and [`Error::Broken`] from reading the file.
pub fn open(path: &Path, backend: Backend) -> Result<Box<dyn Model>> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("safetensors") => Ok(Box::new(float::open(path, backend)?)),
        Some("eld") => Ok(Box::new(int8::open(path)?)),
        _ => Err(Error::unsupported(path, "expected a model with extension .eld or .safetensors")),
    }
}
