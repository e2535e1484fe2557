//! The commands that need no training framework. The programs `elunar` and `host-train` share them.

pub mod cli;
pub mod cluster;
pub mod held;
pub mod html;
pub mod inspect;
pub mod job;
pub mod memory;
pub mod outputs;
pub mod picture;
pub mod program;
pub mod threads;
