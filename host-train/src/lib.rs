//! The ground side of ELunarDTM: makes and reads data, trains the network, exports it for flight, predicts and evaluates.
//!
//! In the order data meets the modules: [`raster`] reads files, [`synth`] makes scenes, [`prepare`] makes training sets, [`model`] is the float network,
//! [`train`] teaches it, [`export`] turns it into the file the int8 runner executes, [`predict`] runs either over a scene ([`sfs`] needs no network),
//! [`mosaic`] joins the tiles, [`evaluate`] judges the result by a truth and [`lola`] by laser tracks, [`picture`] shows it, [`demo`]
//! does all of this once. [`inspect`] says what a file is.

pub mod cli;
pub mod demo;
pub mod diff;
pub mod digest;
pub mod error;
pub mod evaluate;
pub mod experiment;
pub mod export;
pub mod faults;
pub mod hillshade;
pub mod illumination;
pub mod inspect;
pub mod interrupt;
pub mod lola;
pub mod model;
pub mod mosaic;
pub mod picture;
pub mod predict;
pub mod prepare;
pub mod quantile;
pub mod raster;
pub mod report;
pub mod sfs;
pub mod stopwatch;
pub mod suite;
pub mod synth;
#[cfg(test)]
mod testing;
pub mod toml_file;
pub mod train;

pub use error::{Error, Result};
