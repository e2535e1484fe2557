//! Reproducible random numbers for tests, with many extreme values.

/// A generator of pseudo-random numbers (xorshift64*).
#[derive(Debug, Clone)]
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        // Neighbouring seeds must not give neighbouring numbers, and a state of 0 would stay 0.
        let mut random = Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        (0..4).for_each(|_| _ = random.next());
        random
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// Returns a number of `low..=high`.
    pub(crate) fn within(&mut self, low: i64, high: i64) -> i64 {
        low + ((self.next() >> 11) % (high - low + 1) as u64) as i64
    }

    /// Returns a size or count of `low..=high`.
    pub(crate) fn size(&mut self, low: usize, high: usize) -> usize {
        self.within(low as i64, high as i64) as usize
    }

    /// Returns `true` once in `n` times.
    pub(crate) fn one_in(&mut self, n: u64) -> bool {
        (self.next() >> 11).is_multiple_of(n)
    }

    pub(crate) fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.size(0, from.len() - 1)]
    }

    /// Returns `count` numbers of `low..=high`: any of them, or only the two ends.
    pub(crate) fn list(&mut self, count: usize, low: i64, high: i64) -> Vec<i64> {
        let ends = self.one_in(3);
        (0..count).map(|_| if ends { self.pick(&[low, high]) } else { self.within(low, high) }).collect()
    }

    pub(crate) fn bytes(&mut self, count: usize) -> Vec<u8> {
        self.list(count, 0, 255).into_iter().map(|v| v as u8).collect()
    }
}
