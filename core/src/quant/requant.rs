//! The rounding rule of the flight path. The runner rounds in no other way.

use super::limit::limit_wide;

/// Returns `(v + 2^(shift-1)) >> shift`: division by `2^shift`, rounded to nearest, ties towards plus infinity.
///
/// `shift` is in `0..=62`; 0 returns `v`. The addition cannot overflow for `|v| < 2^62`, which the validated limits of every caller
/// guarantee. If it does overflow, it wraps, on every machine in the same way.
#[inline(always)]
pub const fn round_shift(v: i64, shift: u32) -> i64 {
    let half = if shift == 0 { 0 } else { 1i64 << ((shift - 1) & 63) };
    v.wrapping_add(half) >> (shift & 63)
}

/// Returns the code of an accumulator: `(acc*multiplier + 2^(shift-1)) >> shift`, plus `zero`, saturated to `lo..=hi`.
///
/// With `|multiplier|` at most [`crate::quant::MULTIPLIER_LIMIT`] the product stays below `2^61`.
#[inline(always)]
pub fn requantise(acc: i32, multiplier: i32, shift: u32, zero: i32, lo: i32, hi: i32) -> i32 {
    let v = round_shift(acc as i64 * multiplier as i64, shift).wrapping_add(zero as i64);
    limit_wide(v, lo as i64, hi as i64) as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn ties_round_up() {
        assert_eq!([round_shift(3, 1), round_shift(-3, 1), round_shift(-1, 1), round_shift(1, 1)], [2, -1, 0, 1]);
        assert_eq!(round_shift(-7, 0), -7);
    }

    proptest! {
        #[test]
        fn equals_floor_of_the_exact_quotient_plus_half(acc: i32, m in -(1i32 << 30)..=(1i32 << 30), s in 1u32..=60) {
            // Twin in i128: floor((2*acc*m + 2^s) / 2^(s+1)).
            let exact = (2 * acc as i128 * m as i128 + (1i128 << s)).div_euclid(1i128 << (s + 1));
            prop_assert_eq!(round_shift(acc as i64 * m as i64, s) as i128, exact);
            prop_assert_eq!(requantise(acc, m, s, 7, -128, 255) as i128, (exact + 7).clamp(-128, 255));
        }

        #[test]
        fn saturates_and_is_monotonic(a: i32, b: i32, m in 0i32..=(1i32 << 30), s in 1u32..=60, zero in -128i32..=255) {
            let code = |acc| requantise(acc, m, s, zero, -5, 250);
            prop_assert!((-5..=250).contains(&code(a)));
            prop_assert!(a > b || code(a) <= code(b));
        }
    }
}
