//! The program itself under a checksum: a flipped bit of an instruction stays, and makes every tile wrong.

use super::sum::sum;

/// A range of memory with instructions, and its checksum.
///
/// ```
/// use elunar_core::nn::CodeSum;
///
/// // In flight the range from the linker's first symbol of the program to its last.
/// let code = [0x90; 4096];
/// let sum = CodeSum::new(&code);
/// assert!(sum.holds());
/// ```
#[derive(Debug, Clone, Copy)]
pub struct CodeSum<'c> {
    code: &'c [u8],
    sum: u32,
}

impl<'c> CodeSum<'c> {
    /// Notes the checksum of `code`, which is good now.
    #[must_use]
    pub fn new(code: &'c [u8]) -> Self {
        Self { code, sum: sum(code) }
    }

    /// Returns whether no instruction has changed. It costs about one instruction for every four bytes.
    #[must_use]
    pub fn holds(&self) -> bool {
        sum(self.code) == self.sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flipped_bit_shows() {
        let mut code = [0x5a; 1000];
        let before = CodeSum::new(&code).sum;
        assert!(CodeSum::new(&code).holds());
        for bit in (0..8000).step_by(7) {
            code[bit / 8] ^= 1 << (bit % 8);
            assert!(!CodeSum { code: &code, sum: before }.holds());
            code[bit / 8] ^= 1 << (bit % 8);
        }
    }
}
