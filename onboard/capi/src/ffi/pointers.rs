//! Pointers and lengths of the caller, which become slices.

use crate::context::Outcome;
use crate::status::*;
use crate::types::eld_status_t;
use core::ffi::c_void;
use core::ops::Range;

/// Returns the addresses of `len` values; an error if there is no such range.
pub(super) fn span<T>(pointer: *const T, len: usize) -> Result<Range<usize>, eld_status_t> {
    if pointer.is_null() {
        return Err(ELD_REFUSED_NULL);
    }
    if !pointer.is_aligned() {
        return Err(ELD_REFUSED_ALIGNMENT);
    }
    let bytes = len.checked_mul(size_of::<T>()).filter(|bytes| *bytes <= isize::MAX as usize);
    let end = bytes.and_then(|bytes| pointer.addr().checked_add(bytes)).ok_or(ELD_REFUSED_LENGTH)?;
    Ok(pointer.addr()..end)
}

pub(super) fn bytes_of(pointer: *const c_void, len: usize) -> Result<Range<usize>, eld_status_t> {
    span(pointer.cast::<u8>(), len)
}

/// Returns the addresses of `len` bytes for a comparison only: none for NULL, up to the last address if the length wraps.
pub(super) fn reach(pointer: *const c_void, len: usize) -> Range<usize> {
    let start = pointer.addr();
    if pointer.is_null() { 0..0 } else { start..start.saturating_add(len) }
}

/// Returns an error if two spans share a byte.
pub(super) fn apart(a: &Range<usize>, b: &Range<usize>) -> Result<(), eld_status_t> {
    if a.end <= b.start || b.end <= a.start { Ok(()) } else { Err(ELD_REFUSED_OVERLAP) }
}

/// Returns the values at `pointer`.
///
/// # Safety
/// The caller's promise holds for the pointer.
pub(super) unsafe fn slice<'a, T>(pointer: *const T, len: usize) -> Result<&'a [T], eld_status_t> {
    span(pointer, len)?;
    // SAFETY: not NULL, aligned, and short enough. The caller promises that the memory exists and does not change. `T` is a plain number.
    Ok(unsafe { core::slice::from_raw_parts(pointer, len) })
}

/// Returns the values at `pointer` as a writable slice.
///
/// # Safety
/// The caller's promise holds for the pointer, and no other live reference refers to these bytes.
pub(super) unsafe fn slice_mut<'a, T>(pointer: *mut T, len: usize) -> Result<&'a mut [T], eld_status_t> {
    span(pointer, len)?;
    // SAFETY: as above; the second condition excludes sharing.
    Ok(unsafe { core::slice::from_raw_parts_mut(pointer, len) })
}

/// As [`span`]; NULL stands for none.
pub(super) fn optional_span<T>(pointer: *const T, len: usize) -> Result<Range<usize>, eld_status_t> {
    if pointer.is_null() { Ok(0..0) } else { span(pointer, len) }
}

/// As [`slice_mut`]; NULL stands for none.
///
/// # Safety
/// As [`slice_mut`].
pub(super) unsafe fn optional_slice_mut<'a, T>(
    pointer: *mut T,
    len: usize,
) -> Result<Option<&'a mut [T]>, eld_status_t> {
    // SAFETY: the caller's promise.
    if pointer.is_null() { Ok(None) } else { unsafe { slice_mut(pointer, len) }.map(Some) }
}

/// Reads a structure of the caller whose first field is its size.
///
/// # Safety
/// The caller's promise holds for the pointer.
pub(super) unsafe fn structure<T: Copy>(pointer: *const T) -> Result<T, eld_status_t> {
    span(pointer, 1)?;
    // SAFETY: every structure begins with `struct_bytes`, also a shorter one of another version.
    let struct_bytes = unsafe { pointer.cast::<u32>().read() };
    if struct_bytes as usize != size_of::<T>() {
        return Err(ELD_REFUSED_STRUCT_BYTES);
    }
    // SAFETY: as large as the caller says; plain numbers and pointers.
    Ok(unsafe { pointer.read() })
}

pub(super) fn status_of(outcome: Outcome) -> eld_status_t {
    match outcome {
        Ok(status) | Err(status) => status,
    }
}
