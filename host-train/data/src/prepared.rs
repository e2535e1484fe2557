//! A prepared folder as a source of tiles. Shards stay on disk; a tile is read when it is needed.

use super::sample::RawTile;
use super::source::TileSource;
use crate::prepare::shard::ShardFile;
use crate::prepare::{Split, TrainingSetManifest};
use elunar_base::{Error, Result};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// One split of a prepared folder. Each pass over its tiles has a different order. The order of a pass is always the same.
pub struct PreparedSource {
    shards: Vec<ShardFile>,
    /// Index of the shard, and of the tile within it.
    tiles: Vec<(usize, usize)>,
    /// Number of the latest pass, and its order.
    order: Mutex<(u64, Vec<u32>)>,
}

impl PreparedSource {
    /// Opens the shards of a split.
    ///
    /// # Errors
    /// [`Error::Input`] if the folder has no manifest of prepared tiles, or no tile in that split; otherwise, if a shard is broken.
    pub fn open(folder: &Path, split: Split) -> Result<Self> {
        let at = folder.display();
        let manifest = TrainingSetManifest::find(folder)?
            .ok_or_else(|| Error::input(format!("{at}: a manifest of prepared tiles expected, none found")))?;
        let records = manifest.splits.get(&split).map_or(&[][..], |record| &record.shards);
        let shards: Vec<ShardFile> =
            records.iter().map(|record| ShardFile::open(&folder.join(&record.file))).collect::<Result<_>>()?;
        for (record, shard) in records.iter().zip(&shards) {
            if record.tiles != shard.len() {
                let what = format!("{} tiles expected, {} found", record.tiles, shard.len());
                return Err(Error::broken(folder.join(&record.file), what));
            }
        }
        let tiles: Vec<(usize, usize)> =
            shards.iter().enumerate().flat_map(|(k, shard)| (0..shard.len()).map(move |tile| (k, tile))).collect();
        if tiles.is_empty() {
            return Err(Error::input(format!("{at}: tiles for {} expected, none found", split.name())));
        }
        let order = Mutex::new((0, order(0, tiles.len())));
        Ok(Self { shards, tiles, order })
    }
}

impl TileSource for PreparedSource {
    fn tile(&self, index: u64) -> Result<RawTile> {
        let count = self.tiles.len() as u64;
        let (pass, position) = (index / count, (index % count) as usize);
        let place = {
            let mut known = self.order.lock().unwrap_or_else(PoisonError::into_inner);
            if known.0 != pass {
                *known = (pass, order(pass, self.tiles.len()));
            }
            known.1[position] as usize
        };
        let (shard, tile) = self.tiles[place];
        self.shards[shard].tile(tile)
    }

    fn count(&self) -> Option<usize> {
        Some(self.tiles.len())
    }
}

/// Returns the order of a pass. It is shuffled, so that neighbours of one scene do not fill a batch.
fn order(pass: u64, count: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..count as u32).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(pass));
    order
}
