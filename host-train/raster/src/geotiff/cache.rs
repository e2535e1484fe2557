//! Cache of the latest chunks, up to a number of bytes.

use std::collections::{HashMap, VecDeque};
use std::sync::Arc;

/// Decoded chunks by number. The oldest is dropped first, because scenes are read from top to bottom.
pub(super) struct Cache {
    chunks: HashMap<usize, Arc<Vec<f32>>>,
    by_age: VecDeque<usize>,
    bytes: usize,
    most_bytes: usize,
}

impl Cache {
    pub(super) fn new(most_bytes: usize) -> Self {
        Self { chunks: HashMap::new(), by_age: VecDeque::new(), bytes: 0, most_bytes }
    }

    pub(super) fn get(&self, chunk: usize) -> Option<Arc<Vec<f32>>> {
        self.chunks.get(&chunk).cloned()
    }

    /// Drops the oldest chunks until one more of so many samples has room. Called before it is decoded, so that both never take memory at
    /// once.
    pub(super) fn make_room(&mut self, samples: usize) {
        let bytes = samples * size_of::<f32>();
        while self.bytes + bytes > self.most_bytes {
            let Some(oldest) = self.by_age.pop_front() else { break };
            self.bytes -= self.chunks.remove(&oldest).map_or(0, |gone| size_of_val(&gone[..]));
        }
    }

    /// Stores a chunk that is not in the cache. The latest chunk is stored even if it is larger than the cache, so that a file of one huge
    /// chunk is not decoded for every window. A cache of size 0 stores nothing.
    pub(super) fn insert(&mut self, chunk: usize, samples: &Arc<Vec<f32>>) {
        if self.most_bytes == 0 {
            return;
        }
        self.make_room(samples.len());
        self.bytes += size_of_val(&samples[..]);
        self.by_age.push_back(chunk);
        self.chunks.insert(chunk, Arc::clone(samples));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_goes_first_and_the_bytes_are_bounded() {
        let mut cache = Cache::new(100);
        let chunk: Arc<Vec<f32>> = vec![0.0; 10].into();
        for number in 0..5 {
            cache.insert(number, &chunk);
            assert!(cache.bytes <= 100 && cache.chunks.len() == cache.by_age.len());
        }
        let kept: Vec<usize> = (0..5).filter(|&n| cache.get(n).is_some()).collect();
        assert_eq!(kept, [3, 4]);
        cache.insert(9, &vec![0.0; 26].into());
        assert!(cache.get(9).is_some() && cache.get(4).is_none(), "the last one stays");
        cache.insert(1, &chunk);
        assert!(cache.get(9).is_none() && cache.get(1).is_some() && cache.bytes == 40);
        cache.make_room(16);
        assert!(cache.get(1).is_none() && cache.bytes == 0, "room for 64 bytes beside 40");
        let mut nothing = Cache::new(0);
        nothing.insert(1, &chunk);
        assert!(nothing.get(1).is_none());
    }
}
