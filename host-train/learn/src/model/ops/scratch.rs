//! Working memory that is reused, because new pages from the system cost more time than filling them.

use std::ops::{Deref, DerefMut};
use std::sync::Mutex;

/// Unused buffers.
static POOL: Mutex<Vec<Vec<f32>>> = Mutex::new(Vec::new());

/// Greatest number of unused buffers. It is more than one training step needs at once.
const KEPT: usize = 16;

/// A buffer of arbitrary numbers. It returns to the pool when dropped.
///
/// It begins at a cache line, because a vector across two lines needs two reads.
pub(super) struct Scratch {
    buffer: Vec<f32>,
    start: usize,
    length: usize,
}

/// Bytes of a cache line.
const LINE_BYTES: usize = 64;

impl Scratch {
    /// Takes a buffer of `length` numbers with arbitrary content.
    pub(super) fn new(length: usize) -> Self {
        let needed = length + LINE_BYTES / size_of::<f32>();
        let mut pool = POOL.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        // The smallest sufficient buffer, otherwise the largest, which grows.
        let best = (0..pool.len()).min_by_key(|&i| {
            let capacity = pool[i].capacity();
            if capacity >= needed { (0, capacity) } else { (1, usize::MAX - capacity) }
        });
        let mut buffer = best.map(|i| pool.swap_remove(i)).unwrap_or_default();
        drop(pool);
        if buffer.len() < needed {
            buffer.resize(needed, 0.0);
        }
        let start = buffer.as_ptr().align_offset(LINE_BYTES).min(LINE_BYTES / size_of::<f32>());
        Self { buffer, start, length }
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let mut pool = POOL.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if pool.len() < KEPT {
            pool.push(std::mem::take(&mut self.buffer));
        }
    }
}

impl Deref for Scratch {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.buffer[self.start..][..self.length]
    }
}

impl DerefMut for Scratch {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.buffer[self.start..][..self.length]
    }
}
