//! Minimum, maximum and clamp with a number of instructions that does not depend on the values.
//!
//! Where processors have conditional instructions or vectors, the compiler uses them for `min` and `max`. Elsewhere it makes branches, and
//! a step would take longer for one tile than for another. There the sign of a difference serves as a mask.

use core::hint::black_box;

/// Whether the compiler makes branches of `min` and `max`.
const BRANCHES: bool =
    cfg!(any(target_arch = "riscv32", target_arch = "riscv64", target_arch = "sparc", target_arch = "powerpc"));

/// Returns the larger number.
#[inline(always)]
pub fn larger(a: i32, b: i32) -> i32 {
    if BRANCHES { larger_by_sign(a as i64, b as i64) as i32 } else { a.max(b) }
}

/// Returns `v` clamped to `lo..=hi`.
#[inline(always)]
pub fn limit(v: i32, lo: i32, hi: i32) -> i32 {
    if BRANCHES { limit_by_sign(v as i64, lo as i64, hi as i64) as i32 } else { v.max(lo).min(hi) }
}

/// As [`limit`], for `|v| < 2^62` and limits that are codes.
#[inline(always)]
pub fn limit_wide(v: i64, lo: i64, hi: i64) -> i64 {
    if BRANCHES { limit_by_sign(v, lo, hi) } else { v.max(lo).min(hi) }
}

/// [`limit_wide`] for numbers that no vector holds. Compilers for x86 make branches of their minimum and maximum, and of a mask that they
/// see through. So its shift is a number that they do not know.
#[derive(Clone, Copy)]
pub(crate) struct Alone {
    sign: u32,
}

impl Alone {
    /// Makes the shift: once, in front of a loop.
    #[inline(always)]
    pub(crate) fn new() -> Self {
        Self { sign: if cfg!(target_arch = "x86_64") { black_box(63) } else { 63 } }
    }

    /// As [`limit_wide`].
    #[inline(always)]
    pub(crate) fn limit(self, v: i64, lo: i64, hi: i64) -> i64 {
        if cfg!(target_arch = "x86_64") { limit_by(v, lo, hi, self.sign & 63) } else { limit_wide(v, lo, hi) }
    }
}

#[inline(always)]
fn larger_by_sign(a: i64, b: i64) -> i64 {
    let d = a.wrapping_sub(b);
    b.wrapping_add(d & !(d >> 63))
}

#[inline(always)]
fn limit_by_sign(v: i64, lo: i64, hi: i64) -> i64 {
    limit_by(v, lo, hi, 63)
}

/// `sign` is 63.
#[inline(always)]
fn limit_by(v: i64, lo: i64, hi: i64, sign: u32) -> i64 {
    let d = v.wrapping_sub(lo);
    let d = lo.wrapping_add(d & !(d >> sign)).wrapping_sub(hi);
    hi.wrapping_add(d & (d >> sign))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn they_are_max_and_clamp(a in -(1i32 << 30)..1 << 30, b in -(1i32 << 30)..1 << 30, v in -(1i64 << 62)..1 << 62, lo in -40000i32..0, hi in 0i32..40000) {
            let (lo64, hi64) = (lo as i64, hi as i64);
            prop_assert_eq!((larger(a, b), larger_by_sign(a as i64, b as i64)), (a.max(b), a.max(b) as i64));
            prop_assert_eq!(limit(a, lo, hi), a.clamp(lo, hi));
            prop_assert_eq!(limit_wide(v, lo64, hi64), v.clamp(lo64, hi64));
            prop_assert_eq!(Alone::new().limit(v, lo64, hi64), v.clamp(lo64, hi64));
            prop_assert_eq!(limit_by_sign(v, lo64, hi64), v.clamp(lo64, hi64));
        }
    }
}
