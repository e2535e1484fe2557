//! Preparation of a training set from lists of (image, DTM, coarse DTM) (Sec. III-A, IV-A). Both DTMs are put on the image's grid and cut
//! into tiles of 256 x 320 without overlap. Useless tiles are dropped and counted. The others are split by region and written as shards.
//!
//! In the order of work: [`list`] reads the files of the scenes. `scene` puts them on one grid. `inspect` checks every tile, and `offset`
//! measures the offset between image and DTM. `filter` applies the 3-sigma rule (Eq. 9–10). `split` divides the ground. [`shard`] writes
//! tiles, [`manifest`] records the preparation, `pictures` draws it. [`run()`] does all of this.
//!
//! Shards are safetensors files, because this project reads them already, Python and PyTorch open them with one line, and they hold only
//! numbers. Every sample has a fixed place in the file, so that a tile is read without its neighbours.

mod filter;
mod finished;
mod inspect;
pub mod list;
pub mod manifest;
mod offset;
mod pictures;
mod run;
mod scene;
pub mod shard;
mod split;

pub use manifest::{PrepareOptions, Split, TrainingSetManifest};
pub use offset::{Offset, measure};
pub use run::run;

#[cfg(test)]
mod tests;
