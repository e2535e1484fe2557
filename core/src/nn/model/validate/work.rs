//! Counts the work of a validation, so that its time is proportional to the file's length.

use crate::nn::file::{MAX_WORK, ModelError, OperatorFault};
use core::cell::Cell;

/// Work of one look at a pair of tensors, or at one link of a line of heirs.
pub(super) const LINK: usize = 8;

/// Bytes of a file that were read, each time counted, and [`LINK`] for each look at a pair or a link.
pub(super) struct Work {
    limit: u64,
    spent: Cell<u64>,
}

/// More work than the limit.
pub(super) struct TooMuch;

impl Work {
    /// Returns the account for a file of this length.
    pub(super) fn new(file_bytes: usize) -> Self {
        Self { limit: MAX_WORK * file_bytes as u64, spent: Cell::new(0) }
    }

    /// Counts work before it is done.
    pub(super) fn spend(&self, bytes: usize) -> Result<(), TooMuch> {
        let spent = self.spent.get().saturating_add(bytes as u64);
        if spent > self.limit {
            return Err(TooMuch);
        }
        self.spent.set(spent);
        Ok(())
    }

    /// Returns the work that was done.
    pub(super) fn spent(&self) -> u64 {
        self.spent.get()
    }
}

impl From<TooMuch> for ModelError {
    fn from(_: TooMuch) -> Self {
        Self::Work
    }
}

impl From<TooMuch> for OperatorFault {
    fn from(_: TooMuch) -> Self {
        Self::Work
    }
}
