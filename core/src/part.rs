//! Parts of slices without a way to panic. What validation has proven cannot fail; should memory change afterwards, a part that is not there
//! is empty, and the linker sees that nothing panics.

/// `len` items from `at` on; none if they are not all there.
#[inline(always)]
pub(crate) fn part<T>(all: &[T], at: usize, len: usize) -> &[T] {
    all.get(at..).and_then(|rest| rest.get(..len)).unwrap_or_default()
}

/// As [`part`], to write.
#[inline(always)]
pub(crate) fn part_mut<T>(all: &mut [T], at: usize, len: usize) -> &mut [T] {
    all.get_mut(at..).and_then(|rest| rest.get_mut(..len)).unwrap_or_default()
}

/// The first `len` items; none if there are fewer.
#[inline(always)]
pub(crate) fn head<T>(all: &[T], len: usize) -> &[T] {
    all.get(..len).unwrap_or_default()
}

/// As [`head`], to write.
#[inline(always)]
pub(crate) fn head_mut<T>(all: &mut [T], len: usize) -> &mut [T] {
    all.get_mut(..len).unwrap_or_default()
}

/// Item `index`, or the default beyond the end.
#[inline(always)]
pub(crate) fn item<T: Copy + Default>(all: &[T], index: usize) -> T {
    all.get(index).copied().unwrap_or_default()
}

/// Writes item `index`, if there is one.
#[inline(always)]
pub(crate) fn put<T>(all: &mut [T], index: usize, value: T) {
    if let Some(item) = all.get_mut(index) {
        *item = value;
    }
}

/// Copies as many items as both have.
#[inline(always)]
pub(crate) fn copy<T: Copy>(to: &mut [T], from: &[T]) {
    let len = to.len().min(from.len());
    if let (Some(to), Some(from)) = (to.get_mut(..len), from.get(..len)) {
        to.copy_from_slice(from);
    }
}
