//! A mean height in five bytes.
//!
//! ```text
//! piece of 128 means    | first 4 bytes of each: f32, rounded towards zero | fifth byte of each: 8 further bits |
//! ```
//! A height is a float of 24 bits; a mean of heights is kept to 32. The last of its bits is 1 if any bit beyond it is: so the mean, rounded to a
//! float at last, is the float next to it. One height, and the mean of two, have the bits of sums in double precision.

use super::ring::PIECE;

/// Number of bytes of a mean.
pub(super) const MEAN_BYTES: usize = 5;
/// Number of means under one checksum.
pub(super) const MEANS: usize = PIECE / MEAN_BYTES;
/// Number of the last bits of a double that are not kept.
const DROPPED: u32 = 21;

/// The bytes of a mean.
#[derive(Debug)]
pub(super) struct Mean<'p> {
    float: &'p mut [u8; 4],
    fine: &'p mut u8,
}

impl Mean<'_> {
    /// Returns the mean; NaN if there is none yet.
    #[inline]
    pub(super) fn get(&self) -> f64 {
        let float = f32::from_ne_bytes(*self.float);
        f64::from_bits(f64::from(float).to_bits() | u64::from(*self.fine) << DROPPED)
    }

    /// Stores a mean.
    #[inline]
    pub(super) fn set(&mut self, mean: f64) {
        let bits = mean.to_bits();
        let rest = bits & ((1 << DROPPED) - 1);
        let kept = bits >> DROPPED | u64::from(rest != 0);
        *self.float = (f64::from_bits((kept & !0xff) << DROPPED) as f32).to_ne_bytes();
        *self.fine = kept as u8;
    }
}

/// Returns the means of a piece.
#[inline]
pub(super) fn means(piece: &mut [u8]) -> impl ExactSizeIterator<Item = Mean<'_>> {
    let count = piece.len() / MEAN_BYTES;
    let (floats, fine) = piece.split_at_mut_checked(4 * count).unwrap_or_default();
    floats.as_chunks_mut::<4>().0.iter_mut().zip(fine).map(|(float, fine)| Mean { float, fine })
}

/// Makes all means of a piece absent.
pub(super) fn clear(piece: &mut [u8]) {
    means(piece).for_each(|mut mean| mean.set(f64::NAN));
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn means_keep_32_bits_and_round_as_doubles_do(height in -2e4f32..2e4, other in -2e4f32..2e4, weight in 1e-6f64..1.0) {
            let mut piece = [0; 7 * MEAN_BYTES];
            let mean_m = (f64::from(height) + weight * f64::from(other)) / (1.0 + weight);
            means(&mut piece).zip([f64::from(height), mean_m, -0.0, f64::NAN]).for_each(|(mut mean, z)| mean.set(z));
            let found: Vec<f64> = means(&mut piece).map(|mean| mean.get()).collect();
            prop_assert_eq!(found[0].to_bits(), f64::from(height).to_bits());
            prop_assert_eq!((found[1] as f32).to_bits(), (mean_m as f32).to_bits());
            prop_assert!((found[1] - mean_m).abs() <= mean_m.abs() * 2f64.powi(-31));
            prop_assert!(found.len() == 7 && found[2] == 0.0 && found[3].is_nan());
            clear(&mut piece);
            prop_assert!(means(&mut piece).all(|mean| mean.get().is_nan()));
        }
    }
}
