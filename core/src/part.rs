//! Parts of slices without a panic. After validation every part exists. If memory changes later, a missing part is empty, and the linker
//! finds no path to a panic. What has changed is reported by the comparisons of a run, not from here: records by their seals before use, rows at
//! every read, the model after the last step. A report from here would need a global (the interface promises none) or an argument of every
//! function that reads a slice.
//!
//! In this crate's tests a missing part fails the test and names its place ([`defaults`]), because an intact model has none.

/// Returns `len` items from `at` on; an empty slice unless all of them exist.
#[inline(always)]
#[cfg_attr(test, track_caller)]
pub(crate) fn part<T>(all: &[T], at: usize, len: usize) -> &[T] {
    match all.get(at..).and_then(|rest| rest.get(..len)) {
        Some(part) => part,
        None => absent(&[]),
    }
}

/// Writable version of [`part`].
#[inline(always)]
#[cfg_attr(test, track_caller)]
pub(crate) fn part_mut<T>(all: &mut [T], at: usize, len: usize) -> &mut [T] {
    match all.get_mut(at..).and_then(|rest| rest.get_mut(..len)) {
        Some(part) => part,
        None => absent(&mut []),
    }
}

/// Returns the first `len` items; an empty slice if there are fewer.
#[inline(always)]
#[cfg_attr(test, track_caller)]
pub(crate) fn head<T>(all: &[T], len: usize) -> &[T] {
    match all.get(..len) {
        Some(head) => head,
        None => absent(&[]),
    }
}

/// Writable version of [`head`].
#[inline(always)]
#[cfg_attr(test, track_caller)]
pub(crate) fn head_mut<T>(all: &mut [T], len: usize) -> &mut [T] {
    match all.get_mut(..len) {
        Some(head) => head,
        None => absent(&mut []),
    }
}

/// Returns item `index`, or the default beyond the end.
#[inline(always)]
#[cfg_attr(test, track_caller)]
pub(crate) fn item<T: Copy + Default>(all: &[T], index: usize) -> T {
    match all.get(index) {
        Some(item) => *item,
        None => absent(T::default()),
    }
}

/// Writes item `index`, if it exists.
#[inline(always)]
#[cfg_attr(test, track_caller)]
pub(crate) fn put<T>(all: &mut [T], index: usize, value: T) {
    match all.get_mut(index) {
        Some(item) => *item = value,
        None => absent(()),
    }
}

/// Returns `N` items from `at` on, or defaults unless all of them exist. A constant number needs no call to copy.
#[inline(always)]
#[cfg_attr(test, track_caller)]
pub(crate) fn few<T: Copy + Default, const N: usize>(all: &[T], at: usize) -> [T; N] {
    match all.get(at..).and_then(|rest| rest.first_chunk()) {
        Some(few) => *few,
        None => absent([T::default(); N]),
    }
}

/// Writes items from `at` on, if all of them exist.
#[inline(always)]
#[cfg_attr(test, track_caller)]
pub(crate) fn put_few<T, const N: usize>(all: &mut [T], at: usize, values: [T; N]) {
    match all.get_mut(at..).and_then(|rest| rest.first_chunk_mut()) {
        Some(few) => *few = values,
        None => absent(()),
    }
}

/// Copies as many items as both slices have: all of `to`, unless memory has changed.
#[inline(always)]
#[cfg_attr(test, track_caller)]
pub(crate) fn copy<T: Copy>(to: &mut [T], from: &[T]) {
    if to.len() > from.len() {
        absent(());
    }
    let len = to.len().min(from.len());
    if let (Some(to), Some(from)) = (to.get_mut(..len), from.get(..len)) {
        to.copy_from_slice(from);
    }
}

/// Returns `default` in place of a missing part. In tests each default is counted, and fails the test unless a [`defaults::Expected`]
/// exists.
#[inline(always)]
#[cfg_attr(test, track_caller)]
fn absent<T>(default: T) -> T {
    #[cfg(test)]
    defaults::count();
    default
}

/// Counts the defaults that this module returns in place of missing parts, per thread of a test.
#[cfg(test)]
pub(crate) mod defaults {
    use std::cell::Cell;
    use std::panic::Location;

    std::thread_local! {
        /// Number of defaults returned while they were expected; `None` if they are not expected.
        static COUNT: Cell<Option<u32>> = const { Cell::new(None) };
    }

    /// Counts one default.
    ///
    /// # Panics
    /// If defaults are not expected. The message names the place in the crate that asked for the missing part.
    #[track_caller]
    pub(super) fn count() {
        match COUNT.get() {
            Some(count) => COUNT.set(Some(count + 1)),
            None => panic!("a part of a slice that is not there: {}", Location::caller()),
        }
    }

    /// While this value exists, defaults are legal on its thread: for tests of damaged memory and of arguments beyond the end.
    pub(crate) struct Expected(());

    impl Expected {
        pub(crate) fn new() -> Self {
            COUNT.set(Some(0));
            Self(())
        }

        /// Number of defaults returned so far.
        pub(crate) fn count(&self) -> u32 {
            COUNT.get().unwrap_or_default()
        }
    }

    impl Drop for Expected {
        fn drop(&mut self) {
            COUNT.set(None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every function on three items; with `more` of 1 each asks for one missing item.
    const USES: [fn(usize); 9] = [
        |more| assert_eq!(part(&[1, 2, 3], 1, 2 + more).len(), 2 - 2 * more),
        |more| assert_eq!(part_mut(&mut [1, 2, 3], 1 + more, 2).len(), 2 - 2 * more),
        |more| assert_eq!(head(&[1, 2, 3], 3 + more).len(), 3 - 3 * more),
        |more| assert_eq!(head_mut(&mut [1, 2, 3], 3 + more).len(), 3 - 3 * more),
        |more| assert_eq!(item(&[1, 2, 3], 2 + more), 3 - 3 * more),
        |more| put(&mut [1, 2, 3], 2 + more, 7),
        |more| copy(&mut [1, 2, 3], head(&[4, 5, 6], 3 - more)),
        |more| assert_eq!(few(&[1, 2, 3], 1 + more), [2 - 2 * more, 3 - 3 * more]),
        |more| put_few(&mut [1, 2, 3], 1 + more, [7, 8]),
    ];

    #[test]
    fn every_default_fails_a_test_that_does_not_expect_it() {
        for (number, one) in USES.into_iter().enumerate() {
            one(0);
            let report = std::panic::catch_unwind(|| one(1)).expect_err("a default");
            let text = report.downcast::<String>().expect("a message");
            assert!(text.contains("not there: core/src/part.rs:"), "function {number}: {text}");
            let expected = defaults::Expected::new();
            one(1);
            assert_eq!(expected.count(), 1, "function {number}");
        }
    }
}
