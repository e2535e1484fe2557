//! The program itself under a checksum: a flipped bit of an instruction stays, and makes every tile wrong.

use super::sum::sum;

/// Returns the checksum of a part of the program. The caller notes it when the program is good, and compares it before or after a tile. It costs
/// about one instruction for every four bytes.
///
/// ```
/// use elunar_core::nn::code_sum;
///
/// // In flight the range from the linker's first symbol of the program to its last.
/// let mut code = [0x90; 4096];
/// let good = code_sum(&code);
/// code[77] ^= 4;
/// assert!(code_sum(&code) != good);
/// ```
#[must_use]
pub fn code_sum(code: &[u8]) -> u32 {
    sum(code)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flipped_bit_shows() {
        let mut code = [0x5a; 1000];
        let good = code_sum(&code);
        for bit in (0..8000).step_by(7) {
            code[bit / 8] ^= 1 << (bit % 8);
            assert!(code_sum(&code) != good);
            code[bit / 8] ^= 1 << (bit % 8);
        }
        assert_eq!(code_sum(&code), good);
    }
}
