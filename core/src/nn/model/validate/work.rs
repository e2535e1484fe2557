//! Counts the work of a validation, so that its time is proportional to the file's length.

use crate::nn::file::{ENTRY_BYTES, MAX_WORK, ModelError, OPERATOR_BYTES, OperatorFault, TENSOR_BYTES};
use core::cell::Cell;

/// Work of reading the record of a tensor, of an operator, and of an entry: its words.
pub(super) const TENSOR: usize = TENSOR_BYTES / 4;
pub(super) const OPERATOR: usize = OPERATOR_BYTES / 4;
pub(super) const ENTRY: usize = ENTRY_BYTES / 4;
/// Work of one look at a pair of tensors, or at one link of a line of heirs.
pub(super) const LINK: usize = 2;

/// What was read of a file, each time counted: bytes of constants, words of records, and [`LINK`] for each look at a pair or a link. A byte
/// of constants takes longer than a word of a record, because every weight is compared and summed.
pub(super) struct Work {
    limit: u64,
    spent: Cell<u64>,
}

/// More work than the limit.
pub(super) struct TooMuch;

impl Work {
    /// Returns the account for a file of this length, of which so much is spent.
    pub(super) fn new(file_bytes: usize, spent: u64) -> Self {
        Self { limit: MAX_WORK * file_bytes as u64, spent: Cell::new(spent) }
    }

    /// Counts work before it is done.
    pub(super) fn spend(&self, work: usize) -> Result<(), TooMuch> {
        let spent = self.spent.get().saturating_add(work as u64);
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
