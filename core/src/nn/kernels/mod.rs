//! Dot products: the only place where the arithmetic is dense, and the only one where it looks at the processor.
//!
//! Activations arrive as little-endian i16 (zero point already removed), weights as i8; sums are i32. The model's validation
//! proves that no sum can leave i32, so kernels may add in any order: the result is the same bits. A kernel that saturates
//! on the way (as `vpmaddubsw` does) would be a bug, not an option.
//!
//! What every kernel computes, in the words of [`scalar`], the specification:
//!
//! ```text
//! group:   sums[c][p] += Σ_k x[p][k] * w[c][k]     8 channels, 4 pixels
//! single:  sums[p]    += Σ_k x[p][k] * w[k]        1 channel,  4 pixels
//! dot:     Σ_k a[k] * b[k]                         both i16
//! ```

mod scalar;
mod select;
#[cfg(target_arch = "x86_64")]
mod x86_avx2;
#[cfg(target_arch = "x86_64")]
mod x86_avx512;

/// One activation in a scratch row: i16, little-endian, no alignment needed.
pub type Le16 = [u8; 2];

/// Vectors are padded with zeros to a multiple of this.
pub const LANES: usize = 8;

/// Output channels that one unit of a convolution computes.
pub const CHANNEL_GROUP: usize = 8;

/// Pixels computed together.
pub const PIXELS: usize = 4;

/// `len` rounded up to a multiple of [`LANES`].
pub const fn padded(len: usize) -> usize {
    len.div_ceil(LANES) * LANES
}

/// Sums of a channel group: `sums[channel][pixel]`.
pub type Sums = [[i32; PIXELS]; CHANNEL_GROUP];

/// As many samples of each of the pixels computed together.
pub type Stretches<'x> = [&'x [Le16]; PIXELS];

/// As many weights of each channel of a group.
pub type Weights<'w> = [&'w [u8]; CHANNEL_GROUP];

/// One way of computing dot products: same numbers, other instructions. Slices of one call have one length; should one be
/// longer, its rest is ignored.
#[derive(Clone, Copy)]
pub struct Kernel {
    name: &'static str,
    pub(crate) group: fn(&mut Sums, Stretches<'_>, Weights<'_>),
    pub(crate) single: fn(&mut [i32; PIXELS], Stretches<'_>, &[u8]),
    pub(crate) dot: fn(&[Le16], &[Le16]) -> i32,
}

impl Kernel {
    /// The specification; runs everywhere.
    pub const SCALAR: Self =
        Self { name: scalar::NAME, group: scalar::group, single: scalar::single, dot: scalar::dot };

    /// The kernels this processor runs, fastest first; the last is always [`Kernel::SCALAR`].
    pub fn available() -> impl Iterator<Item = Self> {
        select::fastest_first().into_iter().flatten()
    }

    /// The fastest kernel this processor runs.
    pub fn best() -> Self {
        Self::available().next().unwrap_or(Self::SCALAR)
    }

    /// Its name, by the rule `{isa}-{types}-{variant}`.
    pub fn name(&self) -> &'static str {
        self.name
    }
}

impl core::fmt::Debug for Kernel {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn codes(values: &[i16]) -> Vec<Le16> {
        values.iter().map(|v| v.to_le_bytes()).collect()
    }

    /// Numbers with more than their share of extremes, from a seed.
    fn numbers(seed: u64, count: usize, low: i64, high: i64) -> Vec<i64> {
        let mut state = seed | 1;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as i64
        };
        let draw = |n: i64| {
            if n % 5 == 0 {
                low
            } else if n % 5 == 1 {
                high
            } else {
                low + n / 5 % (high - low + 1)
            }
        };
        (0..count).map(|_| draw(next())).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]
        #[test]
        fn every_kernel_is_the_specification(len in 0_usize..150, offset in 0_usize..3, seed in any::<u64>()) {
            let n = len + offset;
            // Any i16, as no kernel may rely on the quantiser's smaller codes.
            let x: Vec<Vec<Le16>> = (0..PIXELS as u64)
                .map(|p| codes(&numbers(seed ^ p, n, -32768, 32767).iter().map(|&v| v as i16).collect::<Vec<_>>()))
                .collect();
            let w: Vec<Vec<u8>> = (0..CHANNEL_GROUP as u64)
                .map(|c| numbers(seed ^ (c << 8), n, -128, 127).iter().map(|&v| v as i8 as u8).collect())
                .collect();
            let start: Vec<i64> = numbers(!seed, PIXELS * CHANNEL_GROUP, i32::MIN.into(), i32::MAX.into());
            let (x, w): (Stretches, Weights) =
                (core::array::from_fn(|p| &x[p][offset..]), core::array::from_fn(|c| &w[c][offset..]));
            let run = |kernel: Kernel| {
                let mut sums: Sums = core::array::from_fn(|c| core::array::from_fn(|p| start[c * PIXELS + p] as i32));
                let mut single = sums[0];
                (kernel.group)(&mut sums, x, w);
                (kernel.single)(&mut single, x, w[3]);
                (sums, single, (kernel.dot)(x[0], x[1]))
            };
            let expected = run(Kernel::SCALAR);
            for kernel in Kernel::available() {
                prop_assert_eq!(run(kernel), expected, "{:?}", kernel);
            }
        }
    }

    #[test]
    fn lengths_may_differ() {
        let (x, w) = (codes(&[3; 70]), [2u8; 70]);
        for kernel in Kernel::available() {
            let mut sums = [[0; PIXELS]; CHANNEL_GROUP];
            let mut weights: Weights = [&w; CHANNEL_GROUP];
            weights[5] = &w[..41];
            (kernel.group)(&mut sums, [&x, &x, &x[..33], &x], weights);
            assert_eq!(sums, [[198; PIXELS]; CHANNEL_GROUP], "{kernel:?}");
            let mut single = [0; PIXELS];
            (kernel.single)(&mut single, [&x; PIXELS], &w[..7]);
            assert_eq!(single, [42; PIXELS], "{kernel:?}");
            assert_eq!((kernel.dot)(&x[..50], &x[..20]), 180, "{kernel:?}");
        }
    }

    #[test]
    fn scalar_comes_last_and_names_follow_the_rule() {
        let names: Vec<&str> = Kernel::available().map(|kernel| kernel.name()).collect();
        assert_eq!(names.last(), Some(&scalar::NAME));
        assert!(names.iter().all(|name| name.splitn(3, '-').count() == 3), "{names:?}");
        assert_eq!(Kernel::best().name(), names[0]);
    }
}
