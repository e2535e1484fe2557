//! From one image to an archive: a manifest with a line an image, and what an engine of a cluster needs around it.
//!
//! The contract with the engine is neutral: a line of a manifest goes in, an exit code comes out. [`manifest`] reads and checks lines, [`apart`] what they read and write, [`foreign`] what lies there,
//! [`batch`] runs a chunk of them, [`status`] reads what the batches said, [`plan`] says beforehand what a run takes.

pub mod apart;
pub mod batch;
pub mod foreign;
pub mod item;
pub mod manifest;
pub mod outcome;
pub mod plan;
pub mod status;
