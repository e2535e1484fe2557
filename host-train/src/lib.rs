//! The program with every command: those of `elunar`, training, the float network, and commands that need it.
//!
//! [`config`] is the document that determines a training. [`demo`] runs all steps once and writes a report. [`suite`] compares models on test scenes. [`experiment`] trains and compares
//! experiments. [`report`] makes a page of the results. [`faults`] flips bits in the int8 runner's memory.

pub mod cli;
pub mod config;
pub mod demo;
pub mod experiment;
pub mod faults;
mod inner;
pub mod report;
pub mod suite;
pub mod toml_file;
