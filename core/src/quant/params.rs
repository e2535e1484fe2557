//! Conversion of real scales to integer multipliers. Only the tools that make models use it; the runner reads the integers.

/// Largest absolute multiplier of a model: products with any i32 accumulator stay below `2^61`.
pub const MULTIPLIER_LIMIT: i32 = 1 << 30;

/// Largest right shift of a model.
pub const SHIFT_LIMIT: u32 = 60;

/// Returns the shift for which every ratio up to `largest` has a multiplier of at most [`MULTIPLIER_LIMIT`], and `largest` uses 29 bits or
/// more (where [`SHIFT_LIMIT`] allows).
///
/// `None` if `largest` is not finite, not positive, or above `2^29`, where no shift of at least 1 exists.
pub fn shift_for(largest: f64) -> Option<u32> {
    if !(largest.is_finite() && largest > 0.0) {
        return None;
    }
    let limit = MULTIPLIER_LIMIT as f64;
    (1..=SHIFT_LIMIT).rev().find(|&shift| largest * (1u64 << shift) as f64 <= limit)
}

/// Returns `ratio * 2^shift`, rounded to nearest (halves away from zero) and saturated to [`MULTIPLIER_LIMIT`].
pub fn multiplier(ratio: f64, shift: u32) -> i32 {
    let limit = MULTIPLIER_LIMIT as f64;
    libm::round(ratio * (1u64 << shift.min(63)) as f64).clamp(-limit, limit) as i32
}

/// Returns the code of a real value: `value/scale` rounded to nearest (halves up), plus `zero`, saturated to `lo..=hi`. The flag says
/// whether the code was saturated. NaN becomes `zero`. `zero`, `lo` and `hi` are at most 2^20 from 0.
pub fn quantise(value: f32, inverse_scale: f32, zero: i32, lo: i32, hi: i32) -> (i32, bool) {
    // Below 2^24 every step is exact except the product, whose rounding IEEE 754 defines: every machine gets the same code.
    kept_floor(value * inverse_scale + 0.5, zero, lo, hi)
}

/// Returns the floor of a value plus `zero`, saturated to `lo..=hi`, and whether it was.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
fn kept_floor(value: f32, zero: i32, lo: i32, hi: i32) -> (i32, bool) {
    // The floor is a comparison, because processors without a floor instruction would call a function.
    let whole = value as i32;
    let code = whole.saturating_sub((whole as f32 > value) as i32).saturating_add(zero);
    let kept = code.max(lo).min(hi);
    (kept, kept != code)
}

#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn kept_floor(value: f32, zero: i32, lo: i32, hi: i32) -> (i32, bool) {
    // The conversion of any float to an integer is not an instruction here, and the compiler does it one by one: a tile of `nano` would take 3 %
    // longer. All that follows is exact and has vectors: beside 1.5 * 2^23 a float has no fraction, and its low bits are the whole number.
    const LIMIT: f32 = (1 << 22) as f32;
    const WHOLE: f32 = 1.5 * (1 << 23) as f32;
    let value = if value.is_nan() { 0.0 } else { value.clamp(-LIMIT, LIMIT) };
    let near = (value + WHOLE) - WHOLE;
    let floor = if near > value { near - 1.0 } else { near };
    let code = floor + zero as f32;
    let kept = code.max(lo as f32).min(hi as f32);
    ((kept + WHOLE).to_bits() as i32 - WHOLE.to_bits() as i32, kept != code)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn impossible_ratios_are_refused() {
        assert_eq!([shift_for(0.0), shift_for(f64::NAN), shift_for(1e12)], [None, None, None]);
    }

    /// Every 101st float: exact, scaled, far outside, infinite and not a number.
    #[test]
    fn codes_are_those_of_a_conversion() {
        for bits in (0..=u32::MAX).step_by(101).chain([f32::INFINITY, f32::NEG_INFINITY, f32::NAN].map(f32::to_bits)) {
            let moved = f32::from_bits(bits) + 0.5;
            let whole = moved as i32;
            let code = whole.saturating_sub((whole as f32 > moved) as i32).saturating_add(-7);
            let expected = (code.clamp(-32768, 32767), !(-32768..=32767).contains(&code));
            assert_eq!(quantise(f32::from_bits(bits), 1.0, -7, -32768, 32767), expected, "{bits:#x}");
        }
    }

    proptest! {
        #[test]
        fn multipliers_keep_29_bits(exponent in -28i32..=28, fraction in 1.0f64..2.0) {
            let ratio = fraction * libm::pow(2.0, exponent as f64);
            let shift = shift_for(ratio).unwrap();
            let back = multiplier(ratio, shift) as f64 / libm::pow(2.0, shift as f64);
            prop_assert!((back / ratio - 1.0).abs() < 1.0 / (1u64 << 29) as f64);
        }

        #[test]
        fn codes_are_the_nearest(value in -100.0f32..100.0) {
            let (code, clamped) = quantise(value, 10.0, 3, -500, 700);
            prop_assert!(clamped || ((code - 3) as f32 / 10.0 - value).abs() <= 0.0501);
        }
    }
}
