//! Random choices.

use super::Sizes;
use crate::Random;
use elunar_core::nn::file::Dtype;

/// Random choices within sizes.
pub(super) struct Dice<'r> {
    pub(super) random: &'r mut Random,
    pub(super) sizes: &'r Sizes,
}

impl Dice<'_> {
    /// Returns a number of `low..=high`.
    pub(super) fn size(&mut self, low: usize, high: usize) -> usize {
        // In 64 bits, so that boards draw the same.
        low + ((self.random.number() >> 11) % ((high - low) as u64 + 1)) as usize
    }

    /// Returns `true` `percent` times in a hundred.
    pub(super) fn chance(&mut self, percent: usize) -> bool {
        self.size(0, 99) < percent
    }

    pub(super) fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.size(0, from.len() - 1)]
    }

    /// Returns a number of `-size..=size`.
    pub(super) fn signed(&mut self, size: i64) -> i64 {
        (self.random.number() >> 1) as i64 % (size + 1) * if self.chance(50) { 1 } else { -1 }
    }
}

/// Returns the legal ends of codes of a type.
pub(super) fn ends(dtype: Dtype) -> (i32, i32) {
    match dtype {
        Dtype::U8 => (0, 255),
        Dtype::I16 => (-32767, 32767),
        Dtype::F32 => (0, 0),
    }
}
