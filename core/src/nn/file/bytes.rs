//! Little-endian numbers at any offset.

/// Returns the little-endian u32 at `offset`; 0 beyond the end, which callers exclude.
#[inline(always)]
pub fn u32_at(bytes: &[u8], offset: usize) -> u32 {
    bytes.get(offset..).and_then(|rest| rest.first_chunk()).map_or(0, |&word| u32::from_le_bytes(word))
}

/// Returns the little-endian i32 at `offset`, as [`u32_at`].
#[inline(always)]
pub fn i32_at(bytes: &[u8], offset: usize) -> i32 {
    u32_at(bytes, offset) as i32
}

/// Returns the little-endian i64 at `offset`, as [`u32_at`].
#[inline(always)]
pub fn i64_at(bytes: &[u8], offset: usize) -> i64 {
    bytes.get(offset..).and_then(|rest| rest.first_chunk()).map_or(0, |&word| i64::from_le_bytes(word))
}
