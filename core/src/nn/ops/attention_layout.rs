//! The scratch memory of window attention.

use crate::nn::arena::OVERREAD;
use crate::nn::file::MAX_WINDOW;
use crate::nn::panels::{groups, panelled};

/// Sizes of the parts of the scratch memory, bytes.
#[derive(Clone, Copy)]
pub(super) struct Layout {
    pub(super) keys: usize,
    pub(super) values: usize,
    pub(super) row: usize,
}

impl Layout {
    /// Returns the sizes for windows of `tokens` tokens and heads of `channels` channels.
    #[inline(always)]
    pub(super) const fn new(tokens: usize, channels: usize) -> Self {
        Self {
            keys: 4 * groups(channels) * panelled(tokens),
            values: 4 * groups(tokens) * panelled(channels),
            row: 4 * groups(tokens),
        }
    }

    /// Total bytes: packed keys, packed values, two planes of exponentials for a row of queries.
    pub(super) const fn bytes(&self) -> usize {
        self.keys + self.values + 2 * MAX_WINDOW * self.row + OVERREAD
    }
}
