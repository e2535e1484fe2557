//! Scenes and DTMs, without a training framework.
//!
//! In the order data meets the modules: [`predict`] puts image and coarse DTM on one grid and runs a network over the tiles ([`sfs`] needs none),
//! [`mosaic`] joins them, [`evaluate`] compares the result with a truth and [`lola`] with laser tracks, [`diff`] and [`hillshade`] make rasters of it,
//! [`picture`] shows it. [`prepare`] makes training sets, [`data`] hands out their tiles. [`inspect`] says what a file is.

pub mod data;
pub mod diff;
pub mod evaluate;
pub mod hillshade;
pub mod inspect;
pub mod interrupt;
pub mod lola;
mod maps;
pub mod mosaic;
pub mod picture;
pub mod predict;
pub mod prepare;
pub mod progress;
pub mod sfs;
pub mod table;
