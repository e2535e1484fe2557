//! A folder of GeoTIFF triples as a source of tiles.

use super::feed::TileSource;
use super::sample::RawTile;
use crate::{Error, Result};
use std::path::Path;

/// Triples read into memory.
pub struct FolderSource {}

impl FolderSource {
    /// x
    pub fn open(path: &Path) -> Result<Self> {
        Err(Error::usage(format!("{}: later", path.display())))
    }
}
impl TileSource for FolderSource {
    fn tile(&self, _index: u64) -> Result<RawTile> {
        Err(Error::usage("later"))
    }
}
