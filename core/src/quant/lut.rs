//! Reading of tables that the host made: GELU by code, the exponential by distance from the maximum.

/// Fraction bits of attention logits: a logit of 1 is `1 << LOGIT_BITS`.
pub const LOGIT_BITS: u32 = 8;

/// Entries of a code-to-code table.
pub const CODE_TABLE_LEN: usize = 256;

/// Entries of the exponential's coarse table, whose steps are [`EXP_FINE`], and of its fine table. The two fit into two and one vector
/// registers of 32 numbers.
pub const EXP_COARSE: usize = 64;
/// See [`EXP_COARSE`].
pub const EXP_FINE: usize = 32;

/// Returns `exp(-distance / 2^LOGIT_BITS)` as the rounded product of two entries (little-endian i16, 15 fraction bits). From 8 logits on
/// the result is 0; the exact value is below 1/2980 there.
#[inline(always)]
pub fn exp_lookup(coarse: &[[u8; 2]; EXP_COARSE], fine: &[[u8; 2]; EXP_FINE], distance: i32) -> i16 {
    let at = distance as usize;
    let (a, b) = (coarse[at / EXP_FINE % EXP_COARSE], fine[at % EXP_FINE]);
    let product = (i16::from_le_bytes(a) as i32 * i16::from_le_bytes(b) as i32 + (1 << 14)) >> 15;
    // The same instructions run within the table and beyond it: the mask is all ones within, zeros beyond.
    let inside = ((distance as u32) < (EXP_COARSE * EXP_FINE) as u32) as i32;
    (product & -inside) as i16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_product_is_the_exponential_and_ends() {
        let entry = |i: usize| ((32767.0 * libm::exp(-(i as f64) / 256.0)).round() as i16).to_le_bytes();
        let (coarse, fine) = (core::array::from_fn(|i| entry(i * EXP_FINE)), core::array::from_fn(entry));
        for distance in 0..2048 {
            let exact = 32767.0 * libm::exp(-(distance as f64) / 256.0);
            let found = exp_lookup(&coarse, &fine, distance) as f64;
            assert!((found - exact).abs() <= 2.1, "{distance}: {found} {exact}");
        }
        assert_eq!([2048, 5000, i32::MAX].map(|d| exp_lookup(&coarse, &fine, d)), [0; 3]);
    }
}
