//! From lists of (image, DTM, coarse DTM) to a training set (Sec. III-A, IV-A): both DTMs on the image's grid, tiles of 256 x 320
//! without overlap, what cannot teach anything dropped and counted, the rest split by region and written as shards.
//!
//! In the order of work: [`list`] reads which files belong together, `scene` puts them on one grid, `inspect` looks at every tile
//! with `offset` measuring how far image and DTM lie apart, `filter` applies the 3-sigma rule (Eq. 9–10), `split` divides the
//! ground, [`shard`] writes tiles, [`manifest`] says what was done, `pictures` shows it; [`run()`] is all of it.
//!
//! Shards are safetensors files: this project reads them already, Python and PyTorch open them with one line, every sample has
//! a fixed place in the file, so that a tile is read without its neighbours, and there is nothing in them but numbers.

mod filter;
mod inspect;
pub mod list;
pub mod manifest;
mod offset;
mod pictures;
mod run;
mod scene;
pub mod shard;
mod split;

pub use manifest::{Manifest, Parameters, Split};
pub use offset::{Offset, measure};
pub use run::run;

#[cfg(test)]
mod tests;
