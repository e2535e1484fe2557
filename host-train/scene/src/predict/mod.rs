//! Prediction of a scene, tile by tile.
//!
//! [`Scene::new`] puts the coarse DTM on the image's grid. [`predict_rows`] cuts the scene into overlapping tiles, runs a
//! [`network::TileModel`] on them and joins the heights, one band of rows at a time. [`PartFile`] keeps finished rows on disk. [`int8`] is the
//! network of a model file.

pub mod correlation;
pub mod errors;
pub mod identity;
pub mod int8;
pub mod job;
mod maps;
pub mod neighbourhoods;
pub mod network;
pub mod notices;
mod output;
mod preview;
pub mod record;
pub mod rows;
mod run;
mod scene;
pub mod sigma;
pub mod span;
pub mod sun;
mod survey;
mod survey_file;
mod tile;
pub mod untrained;
pub mod whole;

#[cfg(test)]
mod half_tests;
#[cfg(test)]
mod light_tests;
#[cfg(test)]
mod strip_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod unrelated_tests;

pub use elunar_base::output::{PartFile, part_path};
pub use identity::sum_path;
pub use maps::{ErrorMaps, Maps};
pub use output::{DtmWriter, Provenance, hillshade_path};
pub use preview::Preview;
pub(crate) use run::{Cut, TileMaker, make_rows};
pub use run::{PredictOptions, Prediction, Tally, TileProgress, predict, predict_rows, predict_span};
pub(crate) use scene::{Band, Cutout};
pub use scene::{NamedRaster, Scene};
pub use survey::{ImageBrightness, Survey};
pub use survey_file::{is_survey, shared_survey, survey_path};
pub(crate) use tile::TileOutcome;
