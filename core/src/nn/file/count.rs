//! Counts in constant functions.

/// Returns `n`, or 1 for 0.
pub(crate) const fn at_least_one(n: usize) -> usize {
    if n == 0 { 1 } else { n }
}

/// Returns the smaller number.
pub(crate) const fn min(a: usize, b: usize) -> usize {
    if a < b { a } else { b }
}
