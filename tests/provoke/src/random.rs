//! Random numbers without a crate.

use alloc::vec::Vec;

/// Reproducible bytes and numbers (xorshift64*).
pub struct Random(pub u64);

impl Random {
    /// Begins with a seed; neighbouring seeds do not give neighbouring numbers.
    #[must_use]
    pub fn of_seed(seed: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        (0..4).for_each(|_| _ = random.number());
        random
    }

    /// Returns the next number.
    pub fn number(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// Returns `count` random bytes.
    pub fn bytes(&mut self, count: usize) -> Vec<u8> {
        (0..count).map(|_| (self.number() >> 56) as u8).collect()
    }

    /// Returns a number in -1..1.
    pub fn sample(&mut self) -> f32 {
        (self.number() >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }
}
