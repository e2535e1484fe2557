//! Reading of tables made on the host: GELU by code, the exponential by distance from the maximum.

/// Fraction bits of attention logits: a logit of 1 is `1 << LOGIT_BITS`.
pub const LOGIT_BITS: u32 = 8;

/// Entries of a code-to-code table.
pub const CODE_TABLE_LEN: usize = 256;

/// `exp(-distance / 2^LOGIT_BITS)` from a table of little-endian i16; beyond its end the result is 0.
#[inline(always)]
pub fn exp_lookup(table: &[[u8; 2]], distance: i32) -> i16 {
    table.get(distance as usize).map_or(0, |&bytes| i16::from_le_bytes(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beyond_the_table_is_zero() {
        let table = [[0xff, 0x7f], [1, 0]];
        assert_eq!([0, 1, 2, i32::MAX].map(|d| exp_lookup(&table, d)), [32767, 1, 0, 0]);
    }
}
