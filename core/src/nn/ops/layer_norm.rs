//! Layer norm over channels in integers: one row of pixels.
//!
//! With S = Σx, Q = Σx² over the C channels of a pixel (x in code steps): C·Q − S² is C² times the variance, exact in i64, and
//! d = C·x − S is C times the distance from the mean. So y = d / √(C·Q − S² + C²ε), without any division by C.

use super::saturate;
use crate::nn::arena::Arena;
use crate::nn::model::Model;
use crate::nn::program::LayerNorm;
use crate::quant::round_shift;

/// Fraction bits of the normalised value y, whose absolute value is at most √C.
pub(crate) const FRACTION_BITS: u32 = 16;

/// Runs unit `row`.
pub(crate) fn run(model: &Model<'_>, norm: &LayerNorm, arena: &mut Arena<'_>, row: usize) -> u64 {
    let (input, out) = (model.tensor(norm.input), model.tensor(norm.out));
    let channels = out.channels;
    let mut saturated = 0;
    for col in 0..out.cols {
        let (mut sum, mut squares) = (0i64, 0i64);
        for place in 0..norm.merge * norm.merge {
            // Order 00, 10, 01, 11: rows fastest, as in the reference.
            let (r, c) = (row * norm.merge + place % norm.merge, col * norm.merge + place / norm.merge);
            let source = (r * input.cols + c) * input.channels;
            for channel in 0..input.channels {
                let x = arena.value(&input, source + channel);
                arena.scratch[place * input.channels + channel] = (x as i16).to_le_bytes();
                sum += x as i64;
                squares += x as i64 * x as i64;
            }
        }
        let root = Reciprocal::of_root(channels as i64 * squares - sum * sum + norm.epsilon);
        for channel in 0..channels {
            let x = i16::from_le_bytes(arena.scratch[channel]) as i64;
            let y = root.times(channels as i64 * x - sum);
            let gain = model.constant_i32(norm.gains, channel) as i64;
            let v = round_shift(y * gain + model.constant_i64(norm.biases, channel), norm.shift);
            let (code, cut) = saturate(v, &out);
            arena.store(&out, (row * out.cols + col) * channels + channel, code);
            saturated += cut as u64;
        }
    }
    saturated
}

/// `1 / √v` as a 33-bit integer and a shift.
#[derive(Clone, Copy)]
struct Reciprocal {
    value: i64,
    shift: u32,
}

impl Reciprocal {
    /// For `v` in `1..2^62`.
    fn of_root(v: i64) -> Self {
        let zeros = (v as u64).leading_zeros() & !1;
        // In 2^31..2^32, as v << zeros has its top bit in one of the two highest places.
        let root = integer_sqrt((v as u64) << zeros).max(1);
        Self { value: ((1u64 << 63) / root) as i64, shift: 63 - FRACTION_BITS - zeros / 2 }
    }

    /// `d / √v` with [`FRACTION_BITS`]; `|d|` below `2^30`.
    #[inline(always)]
    fn times(self, d: i64) -> i64 {
        round_shift(d * self.value, self.shift)
    }
}

/// The largest r with r² <= v, by 32 fixed steps.
fn integer_sqrt(v: u64) -> u64 {
    let (mut rest, mut root, mut bit) = (v, 0u64, 1u64 << 62);
    while bit != 0 {
        if rest >= root + bit {
            rest -= root + bit;
            root = (root >> 1) + bit;
        } else {
            root >>= 1;
        }
        bit >>= 2;
    }
    root
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sqrt_is_the_floor(v: u64) {
            let r = integer_sqrt(v) as u128;
            prop_assert!(r * r <= v as u128 && (r + 1) * (r + 1) > v as u128);
        }

        #[test]
        fn division_by_the_root_is_close(d in -(1i64 << 29)..(1i64 << 29), bits in 0u32..62, low: u64) {
            let v = ((1u64 << bits) | (low & ((1u64 << bits) - 1))) as i64;
            // Only quotients that occur: |d| <= √C·√v.
            prop_assume!((d as f64).abs() <= 90.6 * (v as f64).sqrt());
            let exact = d as f64 / (v as f64).sqrt() * 65536.0;
            prop_assert!((Reciprocal::of_root(v).times(d) as f64 - exact).abs() <= 0.51 + exact.abs() * 2f64.powi(-30));
        }
    }
}
