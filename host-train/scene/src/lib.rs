//! Scenes and DTMs, without a training framework.
//!
//! [`predict`] puts image and coarse DTM on one grid and runs a network on the tiles. [`sfs`] does this without a network. [`mosaic`] joins
//! the tiles, and whole DTMs. [`body`] knows which heights a body has.

pub mod body;
pub mod mosaic;
pub mod predict;
pub mod sfs;
