//! The commands that need no training framework, for the programs `elunar` and `host-train`, which share them.

pub mod cli;
pub mod picture;
pub mod program;
