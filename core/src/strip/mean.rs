//! A mean height in five bytes.
//!
//! ```text
//! piece of 128 means    | first 4 bytes of each: f32, rounded towards zero | fifth byte of each: 8 further bits |
//! ```
//! A height is a float of 24 bits; a mean of heights is kept to 32. The last of its bits is 1 if any bit beyond it is: so the mean, rounded to a
//! float at last, is the float next to it. One height, and the mean of two, have the bits of sums in double precision.

use super::ring::PIECE;
use crate::part::{item, put};

/// Number of bytes of a mean.
pub(super) const MEAN_BYTES: usize = 5;
/// Number of means under one checksum.
pub(super) const MEANS: usize = PIECE / MEAN_BYTES;
/// Number of the last bits of a double that are not kept.
const DROPPED: u32 = 21;

/// Returns mean `index` of a piece; NaN if there is none yet.
pub(super) fn mean(piece: &[u8], index: usize) -> f64 {
    let (coarse, fine) = places(piece, index);
    let float = f32::from_ne_bytes(core::array::from_fn(|k| item(piece, coarse + k)));
    f64::from_bits(f64::from(float).to_bits() | u64::from(item(piece, fine)) << DROPPED)
}

/// Stores mean `index` of a piece.
pub(super) fn put_mean(piece: &mut [u8], index: usize, mean: f64) {
    let bits = mean.to_bits();
    let rest = bits & ((1 << DROPPED) - 1);
    let kept = bits >> DROPPED | u64::from(rest != 0);
    let float = f64::from_bits((kept & !0xff) << DROPPED) as f32;
    let (coarse, fine) = places(piece, index);
    float.to_ne_bytes().into_iter().zip(coarse..).for_each(|(byte, at)| put(piece, at, byte));
    put(piece, fine, kept as u8);
}

/// Makes all means of a piece absent.
pub(super) fn clear(piece: &mut [u8]) {
    (0..piece.len() / MEAN_BYTES).for_each(|index| put_mean(piece, index, f64::NAN));
}

fn places(piece: &[u8], index: usize) -> (usize, usize) {
    (4 * index, piece.len() / MEAN_BYTES * 4 + index)
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
            for (index, z) in [f64::from(height), mean_m, -0.0, f64::NAN].into_iter().enumerate() {
                put_mean(&mut piece, index, z);
            }
            prop_assert_eq!(mean(&piece, 0).to_bits(), f64::from(height).to_bits());
            prop_assert_eq!((mean(&piece, 1) as f32).to_bits(), (mean_m as f32).to_bits());
            prop_assert!((mean(&piece, 1) - mean_m).abs() <= mean_m.abs() * 2f64.powi(-31));
            prop_assert!(mean(&piece, 2) == 0.0 && mean(&piece, 3).is_nan());
            clear(&mut piece);
            prop_assert!((0..7).all(|index| mean(&piece, index).is_nan()));
        }
    }
}
