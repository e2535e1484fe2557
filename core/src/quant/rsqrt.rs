//! Division by a square root in integers, as a layer norm needs it, with a fixed number of multiplications.

use super::round_shift;

/// Fraction bits of [`ReciprocalRoot::times`].
pub const FRACTION_BITS: u32 = 16;

/// First approximations of 1/√x for x in [0.25, 1), indexed by the seven leading bits of x, with 8 fraction bits.
const GUESSES: [u16; 96] = guesses();

const fn guesses() -> [u16; 96] {
    let mut table = [0; 96];
    let mut i = 0;
    while i < 96 {
        // x = (32.5 + i) / 128; 256/√x rounded down: the largest g with g² (2i + 65) <= 2^16 * 256.
        let mut g = 256u64;
        while (g + 1) * (g + 1) * (2 * i as u64 + 65) <= 1 << 24 {
            g += 1;
        }
        table[i] = g as u16;
        i += 1;
    }
    table
}

/// `1 / √v` as an integer and a shift.
#[derive(Debug, Clone, Copy)]
pub struct ReciprocalRoot {
    /// `d * value / 2^shift` is d/√v with [`FRACTION_BITS`] fraction bits.
    pub(crate) value: i32,
    pub(crate) shift: u32,
}

impl ReciprocalRoot {
    /// Computes it for `v` in `1..2^62`; smaller values count as 1.
    #[inline(always)]
    pub const fn of(v: i64) -> Self {
        let v = if v < 1 { 1u64 } else { v as u64 };
        let zeros = v.leading_zeros() & !1;
        // x = m / 2^32 in [0.25, 1).
        let m = (v << zeros) >> 32;
        // Newton's iteration y' = y (3 - x y²) / 2 doubles the correct bits: 7, 13, 26, then all of the 30 fraction bits.
        let mut y = (GUESSES[((m >> 25) as usize).saturating_sub(32) % 96] as u64) << 22;
        let mut i = 0;
        while i < 3 {
            let xyy = (m * ((y * y) >> 32)) >> 30;
            y = (y * ((3 << 30) - xyy)) >> 31;
            i += 1;
        }
        // With one bit less the value is a positive i32.
        Self { value: (y >> 1) as i32, shift: 61 - FRACTION_BITS - zeros / 2 }
    }

    /// Returns `d / √v` with [`FRACTION_BITS`] fraction bits. `|d|` is below `2^30`, so that one product of two 32-bit numbers is enough.
    #[inline(always)]
    pub const fn times(self, d: i64) -> i64 {
        round_shift(d as i32 as i64 * self.value as i64, self.shift)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn values_below_one_count_as_one() {
        let one = ReciprocalRoot::of(1);
        for v in [0, -1, i64::MIN] {
            let found = ReciprocalRoot::of(v);
            assert_eq!((found.value, found.shift), (one.value, one.shift), "{v}");
        }
    }

    /// Newton's iteration hides a guess that is a little worse, and then has fewer correct bits for some values.
    #[test]
    fn guesses_are_the_roots_rounded_down() {
        for (i, &guess) in GUESSES.iter().enumerate() {
            let x = (i as f64 + 32.5) / 128.0;
            assert_eq!(guess as f64, (256.0 / x.sqrt()).floor(), "{x}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(5000))]
        #[test]
        fn division_by_the_root_is_close(share in -1.0f64..=1.0, bits in 0u32..62, low: u64) {
            let v = ((1u64 << bits) | (low & ((1u64 << bits) - 1))) as i64;
            // Only quotients that occur: |d| <= √C·√v.
            let d = (share * (90.6 * (v as f64).sqrt()).min((1u64 << 29) as f64)) as i64;
            let exact = d as f64 / (v as f64).sqrt() * 65536.0;
            let found = ReciprocalRoot::of(v).times(d) as f64;
            prop_assert!((found - exact).abs() <= 0.51 + exact.abs() * 2f64.powi(-26), "{found} {exact}");
        }
    }

    /// The value depends on the 32 leading bits, from an even place on, alone: these are all that there are.
    #[test]
    #[ignore = "takes a minute"]
    fn every_root_is_within_one_and_a_half_units() {
        let mut worst = 0.0f64;
        for m in 1u64 << 30..1 << 32 {
            let found = ReciprocalRoot::of((m << 28) as i64).value as f64;
            // 2^29 / √(m / 2^32)
            let exact = (1u64 << 45) as f64 / (m as f64).sqrt();
            worst = worst.max((found - exact).abs());
        }
        println!("rsqrt: {} mantissas, at most {worst:.3} units of 2^-29", 3u64 << 30);
        assert!(worst <= 1.5, "{worst}");
    }
}
