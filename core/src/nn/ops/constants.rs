//! The constants of a model: weights, biases, multipliers, tables.

use crate::nn::file::i32_at;
use crate::part::part;

/// The bytes of the constants; offsets and lengths come from validated operators.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Constants<'a>(pub(crate) &'a [u8]);

impl<'a> Constants<'a> {
    /// Returns `len` bytes from `offset` on.
    #[inline]
    pub(crate) fn slice(&self, offset: usize, len: usize) -> &'a [u8] {
        part(self.0, offset, len)
    }

    /// Returns i32 number `index` of the list at `offset`.
    #[inline]
    pub(crate) fn i32_at(&self, offset: usize, index: usize) -> i32 {
        i32_at(self.0, offset + 4 * index)
    }
}
