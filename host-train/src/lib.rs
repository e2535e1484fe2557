//! The program with every command: what `elunar` has, and training, the float network, and what is built on it.
//!
//! [`demo`] does all of it once, with a report; [`suite`] compares models on test scenes, [`experiment`] trains and compares, [`report`] makes a page
//! of the results; [`faults`] flips bits under the int8 runner.

pub mod cli;
pub mod demo;
pub mod experiment;
pub mod faults;
pub mod report;
pub mod suite;
pub mod toml_file;

use elunar_net::{digest, export, illumination};
use elunar_raster as raster;
use elunar_raster::{Error, Result};
use elunar_scene::{evaluate, interrupt, picture, predict, prepare};
use elunar_synth as synth;

mod model {
    pub(crate) use elunar_learn::model::{backend, init, store};
    pub(crate) use elunar_net::{config, published, weights};
}

mod train {
    pub(crate) use elunar_learn::train::{curves, journal, loss, recipe, run, validate};
    pub(crate) use elunar_scene::data::source;
}
