//! Allocations that may fail, and those that may not.

use std::cell::Cell;

thread_local! {
    static MAY_FAIL: Cell<bool> = const { Cell::new(false) };
}

/// Runs `work`, which handles allocations that fail (`Vec::try_reserve` and the like). Elsewhere the program ends if memory is refused.
pub fn may_fail<T>(work: impl FnOnce() -> T) -> T {
    let before = MAY_FAIL.replace(true);
    let done = work();
    MAY_FAIL.set(before);
    done
}

/// Returns whether this thread handles allocations that fail.
#[must_use]
pub fn is_fallible() -> bool {
    MAY_FAIL.get()
}
