//! Normalised tiles that several steps use. Threads share them.

use super::sample::Sample;
use elunar_base::Result;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// One tile, once it is made.
type Place = Arc<Mutex<Option<Arc<Sample>>>>;

/// Tiles by index.
#[derive(Default)]
pub(super) struct Kept(Mutex<BTreeMap<u64, Place>>);

impl Kept {
    /// Returns the tile of an index. It is made at the first request; other threads wait for it.
    ///
    /// # Errors
    /// Those of `make`. The next request tries again.
    pub(super) fn get(&self, index: u64, make: impl FnOnce() -> Result<Sample>) -> Result<Arc<Sample>> {
        // A thread that panicked has left no half-made tile.
        let place = self.0.lock().unwrap_or_else(PoisonError::into_inner).entry(index).or_default().clone();
        let mut place = place.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(sample) = &*place {
            return Ok(sample.clone());
        }
        let sample = Arc::new(make()?);
        *place = Some(sample.clone());
        Ok(sample)
    }

    /// Forgets the tiles below an index.
    pub(super) fn forget_before(&self, first: u64) {
        let mut tiles = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *tiles = tiles.split_off(&first);
    }
}
