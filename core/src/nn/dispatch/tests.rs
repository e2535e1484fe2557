//! Compares every kernel with the scalar one, and the scalar one with the formula.

use super::*;
use crate::nn::MatrixProduct;
use crate::nn::file::MAX_KERNEL;
use crate::nn::kernels::{self, ACCUMULATORS, pixels_at_once};
use crate::nn::tests::{Random, kernels as all_kernels};
use proptest::prelude::*;

/// The arguments of a matrix product.
#[derive(Debug, Clone)]
struct Product {
    pixels: usize,
    width: usize,
    stride: usize,
    groups: usize,
    starts: Vec<usize>,
    bytes: Vec<u8>,
    weights: Vec<u8>,
    acc: Vec<i32>,
}

impl Product {
    /// `slack` is the number of bytes behind the last one read.
    fn random(
        seed: u64,
        (pixels, width): (usize, usize),
        (stride, groups, rows): (usize, usize, usize),
        slack: usize,
    ) -> Self {
        let mut random = Random::new(seed);
        let r = &mut random;
        let starts: Vec<usize> = (0..rows).map(|_| r.size(0, 70)).collect();
        let reach = pixels.saturating_sub(1) * stride + 4 * groups;
        let end = starts.iter().max().map_or(0, |s| s + reach); // the last byte read is the last byte
        let weights = r.list(4 * rows * groups * width, -127, 127);
        let acc = r.list(pixels * width, i32::MIN as i64, i32::MAX as i64);
        Self {
            pixels,
            width,
            stride,
            groups,
            starts,
            bytes: r.bytes(end + slack),
            weights: weights.into_iter().map(|w| w as i8 as u8).collect(),
            acc: acc.into_iter().map(|a| a as i32).collect(),
        }
    }

    /// The product by the formula, in numbers that cannot overflow, then cut to 32 bits.
    fn expected(&self) -> Vec<i32> {
        let mut acc: Vec<i64> = self.acc.iter().map(|a| *a as i64).collect();
        for (p, c) in (0..self.pixels).flat_map(|p| (0..self.width).map(move |c| (p, c))) {
            for (r, start) in self.starts.iter().enumerate() {
                for (g, b) in (0..self.groups).flat_map(|g| (0..4).map(move |b| (g, b))) {
                    let x = self.bytes[start + p * self.stride + 4 * g + b] as i64;
                    let w = self.weights[((r * self.groups + g) * self.width + c) * 4 + b] as i8 as i64;
                    acc[p * self.width + c] += x * w;
                }
            }
        }
        acc.into_iter().map(|a| a as i32).collect()
    }

    fn by(&self, kernel: Kernel) -> Result<Vec<i32>, &'static str> {
        let mut acc = self.acc.clone();
        let &Self { pixels, width, stride, groups, .. } = self;
        let (bytes, starts, weights) = (&self.bytes[..], &self.starts[..], &self.weights[..]);
        let product = MatrixProduct { pixels, width, bytes, starts, stride, groups, weights };
        let result = kernel.matrix_product(&mut acc, &product);
        if result.is_err() {
            assert_eq!(acc, self.acc, "{kernel:?}: refused, and yet changed");
        }
        result.map(|()| acc)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    #[test]
    fn kernels_equal_the_formula(
        seed in any::<u64>(), pixels in 0usize..50, width in prop::sample::select(vec![8usize, 16, 32]),
        stride in prop_oneof![Just(0usize), Just(1), 0usize..70], groups in 0usize..20, rows in 0usize..6,
        slack in prop_oneof![Just(0usize), Just(0), 0usize..9],
    ) {
        let product = Product::random(seed, (pixels, width), (stride, groups, rows), slack);
        let expected = product.expected();
        for kernel in all_kernels() {
            prop_assert_eq!(&product.by(kernel).unwrap(), &expected, "{:?}", kernel);
        }
    }

    #[test]
    fn products_together_equal_the_formula(
        seed in any::<u64>(), pixels in 1usize..65, width in prop::sample::select(vec![8usize, 16, 32]),
        lists in prop::collection::vec((0usize..50, prop_oneof![Just(2usize), Just(16), Just(32), 0usize..50], 1usize..6), 1..5),
        from_zero in any::<bool>(),
    ) {
        let pixels = pixels.min(ACCUMULATORS / width);
        let products: Vec<Product> = (0..).zip(&lists).map(|(i, l)| Product::random(seed ^ i, (pixels, width), *l, 0)).collect();
        let mut expected = [7; ACCUMULATORS];
        let begun = if from_zero { 0 } else { 7 };
        expected[..pixels * width].fill(begun);
        for product in &products {
            let sums = Product { acc: expected[..pixels * width].to_vec(), ..product.clone() }.expected();
            expected[..pixels * width].copy_from_slice(&sums);
        }
        // One list of bytes with all of them, one after another.
        let mut bytes = Vec::new();
        let listed: Vec<kernels::Product<'_>> = products.iter().map(|product| {
            let mut starts = [0; MAX_KERNEL];
            starts.iter_mut().zip(&product.starts).for_each(|(to, start)| *to = bytes.len() + start);
            bytes.extend_from_slice(&product.bytes);
            let &Product { stride, groups, .. } = product;
            kernels::Product { starts, rows: product.starts.len(), stride, groups, weights: &product.weights }
        }).collect();
        for kernel in all_kernels() {
            let mut acc = [7; ACCUMULATORS];
            (kernel.products)(&mut acc, pixels, &bytes, &listed, width, from_zero);
            prop_assert_eq!(&acc[..], &expected[..], "{:?}", kernel);
        }
    }

    #[test]
    fn what_does_not_fit_is_refused(
        seed in any::<u64>(), pixels in 1usize..50, width in 0usize..40, stride in 0usize..20, groups in 1usize..9,
        rows in 1usize..4, spoil in 0usize..6,
    ) {
        let mut product = Product::random(seed, (pixels, width), (stride, groups, rows), 0);
        match spoil {
            0 => _ = product.bytes.pop(),
            1 => _ = product.weights.pop(),
            2 => _ = product.acc.pop(),
            3 => product.starts[rows - 1] = product.bytes.len() + 1,
            4 => product.starts[0] = usize::MAX - 3,
            _ => {}
        }
        let legal = [8, 16, 32].contains(&width) && spoil == 5;
        for kernel in all_kernels() {
            prop_assert_eq!(product.by(kernel).is_ok(), legal, "{:?}", kernel);
        }
    }
}

#[test]
fn blocks_of_every_size_with_extreme_codes() {
    // The largest products of both signs, where a kernel that saturates on the way (as vpmaddubsw does) would be wrong.
    for (code, weight) in [(255, 127), (255, -127), (0, -127), (255, 1)] {
        for width in [8, 16, 32] {
            for pixels in 0..=2 * pixels_at_once(width) + 1 {
                for stride in [0, 1, 3, 4, 33] {
                    let mut product = Product::random(1, (pixels, width), (stride, 9, 3), 0);
                    product.bytes.fill(code);
                    product.weights.fill(weight as i8 as u8);
                    let expected = product.expected();
                    for kernel in all_kernels() {
                        assert_eq!(product.by(kernel).as_ref(), Ok(&expected), "{kernel:?}, {pixels} x {width}");
                    }
                }
            }
        }
    }
}

#[test]
fn sums_wrap() {
    let mut product = Product::random(2, (7, 32), (5, 3, 2), 0);
    product.acc.fill(i32::MAX);
    product.bytes.fill(255);
    product.weights.fill(1);
    assert!(product.expected().iter().all(|a| *a < 0));
    all_kernels().iter().for_each(|kernel| assert_eq!(product.by(*kernel).unwrap(), product.expected(), "{kernel:?}"));
}

#[test]
fn patches_that_reach_beyond_their_bytes_leave_memory_whole() {
    // The bare function of a kernel, which checks its arguments: accumulators stay unchanged, or (in the scalar one) may change.
    let weights = vec![1; 4 * 2 * 3 * 32];
    for kernel in all_kernels() {
        for (starts, stride, groups, pixels, len) in [
            ([0, 90], 4, 3, 2, 100),                    // the second row ends behind the last byte
            ([0, usize::MAX], 4, 3, 2, 100),            // the second row starts far behind the last byte
            ([0, 0], 60, 3, 3, 100),                    // the third pixel ends behind the last byte
            ([0, 0], 4, 4, 2, 100),                     // more groups than weights
            ([0, 0], 0, 3, ACCUMULATORS / 32 + 1, 100), // more pixels than accumulators
        ] {
            let bytes = vec![1; len];
            let patch = Patch { bytes: &bytes, starts: &starts, stride, groups };
            assert!(!patch.fits(pixels, &weights, 32));
            let mut acc = [7; ACCUMULATORS];
            (kernel.gemm)(&mut acc, pixels, &patch, &weights, 32);
            assert!(acc == [7; ACCUMULATORS], "{kernel:?}");
        }
    }
}

#[test]
fn the_last_byte_is_reached_and_not_passed() {
    for (width, groups) in [(8, 1), (16, 2), (32, 5)] {
        let product = Product::random(3, (pixels_at_once(width), width), (6, groups, 1), 0);
        let patch = Patch { bytes: &product.bytes, starts: &product.starts, stride: 6, groups };
        assert!(patch.fits(product.pixels, &product.weights, width));
        let short = Patch { bytes: &product.bytes[..product.bytes.len() - 1], ..patch };
        assert!(!short.fits(product.pixels, &product.weights, width));
        assert!(!patch.fits(product.pixels, &product.weights[1..], width));
    }
}

#[test]
fn names_follow_the_rule_and_the_scalar_kernel_is_last() {
    let names: Vec<&str> = Kernel::available().map(|kernel| kernel.name()).collect();
    assert_eq!(names.last(), Some(&Kernel::SCALAR.name()));
    assert_eq!(Some(&Kernel::best().name()), names.first());
    let names: Vec<&str> = all_kernels().iter().map(Kernel::name).collect();
    for (i, name) in names.iter().enumerate() {
        let parts: Vec<&str> = name.split('-').collect();
        let word = |part: &str| !part.is_empty() && part.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit());
        assert!(parts.len() == 3 && parts.iter().all(|part| word(part)), "{{isa}}-{{types}}-{{variant}}: {name}");
        assert!(!names[..i].contains(name), "{name} twice");
    }
}

#[test]
fn every_kernel_the_processor_has_is_offered() {
    #[cfg(target_arch = "wasm32")]
    {
        let offered = Kernel::available().any(|kernel| kernel.name().starts_with("simd128-"));
        assert_eq!(offered, cfg!(target_feature = "simd128"));
    }
    #[cfg(target_arch = "aarch64")]
    {
        let offered = |isa: &str| all_kernels().iter().any(|kernel| kernel.name().starts_with(isa));
        assert!(offered("neon-") || offered("neondot-"));
        assert_eq!(offered("neondot-"), std::arch::is_aarch64_feature_detected!("dotprod"));
        assert_eq!(offered("neoni8mm-"), std::arch::is_aarch64_feature_detected!("i8mm"));
    }
    #[cfg(target_arch = "x86_64")]
    {
        let offered = |isa: &str| Kernel::available().any(|kernel| kernel.name().starts_with(isa));
        assert_eq!(offered("avx2-"), std::arch::is_x86_feature_detected!("avx2"));
        assert_eq!(offered("avxvnni-"), std::arch::is_x86_feature_detected!("avxvnni"));
        let vnni = ["avx512f", "avx512bw", "avx512dq", "avx512vl", "avx512vnni"];
        let detected = vnni.map(|feature| match feature {
            "avx512f" => std::arch::is_x86_feature_detected!("avx512f"),
            "avx512bw" => std::arch::is_x86_feature_detected!("avx512bw"),
            "avx512dq" => std::arch::is_x86_feature_detected!("avx512dq"),
            "avx512vl" => std::arch::is_x86_feature_detected!("avx512vl"),
            _ => std::arch::is_x86_feature_detected!("avx512vnni"),
        });
        assert_eq!(offered("avx512vnni-"), detected.iter().all(|d| *d));
    }
}
