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
