//! Scenes and DTMs, without a training framework.
//!
//! [`predict`] puts image and coarse DTM on one grid and runs a network on the tiles. [`sfs`] does this without a network. [`mosaic`] joins
//! the tiles. [`evaluate`] compares the result with a truth, and [`lola`] compares it with laser tracks. [`diff`] and [`hillshade`] make
//! rasters from it. [`picture`] draws it. [`prepare`] makes training sets, and [`data`] reads their tiles. [`inspect`] describes a file.

pub mod body;
pub mod data;
pub mod diff;
pub mod evaluate;
pub mod hillshade;
pub mod inspect;
pub mod lola;
mod maps;
pub mod mosaic;
pub mod picture;
pub mod predict;
pub mod prepare;
pub mod sfs;
