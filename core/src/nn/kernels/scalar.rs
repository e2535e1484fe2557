//! The specification of every kernel, written so that compilers turn the inner loops into multiply-add instructions.

use super::{Le16, PIXELS, Stretches, Sums, Weights};

/// Name of this kernel by the rule `{isa}-{types}-{variant}`.
pub(super) const NAME: &str = "scalar-i16i8-rows";

/// Every channel of a group in turn.
pub(super) fn group(sums: &mut Sums, x: Stretches<'_>, w: Weights<'_>) {
    let n = w.iter().fold(usize::MAX, |n, row| n.min(row.len()));
    for (sums, w) in sums.iter_mut().zip(w) {
        single(sums, x, &w[..n]);
    }
}

/// Adds `Σ x[p][k] * w[k]` to the sum of every pixel `p`: one row of weights against stretches of activations.
///
/// One weight row and several pixels is the shape that compilers vectorise best: 12 instead of 5 GMAC/s (SSE2) for the
/// opposite arrangement.
pub(super) fn single(sums: &mut [i32; PIXELS], x: Stretches<'_>, w: &[u8]) {
    let n = x.iter().fold(w.len(), |n, row| n.min(row.len()));
    let (x, w) = (x.map(|row| &row[..n]), &w[..n]);
    let mut partial = [0i32; PIXELS];
    for k in 0..n {
        for p in 0..PIXELS {
            partial[p] = partial[p].wrapping_add(i16::from_le_bytes(x[p][k]) as i32 * (w[k] as i8) as i32);
        }
    }
    for (sum, part) in sums.iter_mut().zip(partial) {
        *sum = sum.wrapping_add(part);
    }
}

/// `Σ a[k] * b[k]` over two rows of i16.
pub(super) fn dot(a: &[Le16], b: &[Le16]) -> i32 {
    a.iter()
        .zip(b)
        .fold(0i32, |sum, (&a, &b)| sum.wrapping_add(i16::from_le_bytes(a) as i32 * i16::from_le_bytes(b) as i32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sums_are_exact(x in proptest::collection::vec(-2047i16..2047, 0..70), w in proptest::collection::vec(any::<i8>(), 70)) {
            let codes: Vec<Le16> = x.iter().map(|v| v.to_le_bytes()).collect();
            let bytes: Vec<u8> = w[..x.len()].iter().map(|&v| v as u8).collect();
            let wide: Vec<Le16> = w.iter().map(|&v| (v as i16).to_le_bytes()).collect();
            let naive: i64 = x.iter().zip(&w).map(|(&x, &w)| x as i64 * w as i64).sum();
            let mut sums = [5, -7, 0, 1];
            single(&mut sums, [&codes; PIXELS], &bytes);
            prop_assert_eq!(sums.map(i64::from), [naive + 5, naive - 7, naive, naive + 1]);
            prop_assert_eq!(i64::from(dot(&codes, &wide)), naive);
        }
    }
}
