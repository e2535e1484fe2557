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
/// whether the code was saturated. NaN becomes `zero`.
#[inline]
pub fn quantise(value: f32, inverse_scale: f32, zero: i32, lo: i32, hi: i32) -> (i32, bool) {
    // Below 2^24 every step is exact except the product, whose rounding IEEE 754 defines: every machine gets the same code. The floor is a
    // comparison, because processors without a floor instruction would call a function.
    let moved = value * inverse_scale + 0.5;
    let whole = moved as i32;
    let code = whole.saturating_sub((whole as f32 > moved) as i32).saturating_add(zero);
    let kept = code.max(lo).min(hi);
    (kept, kept != code)
}

/// Number of values that are quantised together.
pub(crate) const TOGETHER: usize = 64;

/// How values become codes: the numbers of [`quantise`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Codes {
    pub(crate) inverse_scale: f32,
    pub(crate) zero: i32,
    pub(crate) lo: i32,
    pub(crate) hi: i32,
}

impl Codes {
    /// Quantises values. Returns how many of the first `count` codes were saturated.
    #[inline(always)]
    pub(crate) fn of(&self, values: &[f32; TOGETHER], codes: &mut [i32; TOGETHER], count: usize) -> u32 {
        let Self { inverse_scale, zero, lo, hi } = *self;
        let mut clamps = [0u32; TOGETHER];
        // The compiler vectorises a loop with constant bounds and without checks.
        for i in 0..TOGETHER {
            let (kept, clamped) = quantise(values[i], inverse_scale, zero, lo, hi);
            (codes[i], clamps[i]) = (kept, clamped as u32);
        }
        clamps.iter().take(count).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn impossible_ratios_are_refused() {
        assert_eq!([shift_for(0.0), shift_for(f64::NAN), shift_for(1e12)], [None, None, None]);
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
