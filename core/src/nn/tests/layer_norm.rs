//! Compares layer norms and patch merging with mean and variance in floating point.

use super::Random;
use super::draft::Draft;
use super::unit::{Expected, check, random_map};
use crate::nn::file::{Dtype, LayerNorm, Operator, Tensor};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]
    #[test]
    fn norms_are_within_one_step_of_floating_point(seed in any::<u64>()) {
        let mut random = Random::new(seed);
        let r = &mut random;
        let merge = r.size(1, 2);
        let size = (merge * r.size(1, 3), merge * r.size(1, 20));
        let channels = r.size(1, 75);
        let wide = channels * merge * merge;
        let mut draft = Draft::new(size);
        let dtype = r.pick(&[Dtype::I16, Dtype::I16, Dtype::U8]);
        let (zero, lo, hi) = if dtype == Dtype::U8 { (r.within(0, 255) as i32, 0, 255) } else { (0, -32767, 32767) };
        let t = Tensor { zero, lo, hi, margin: r.size(0, 2), ..Tensor::new(dtype, size, channels) };
        let mut values = random_map(r, &t);
        // Pixels with little variance are the difficult ones.
        let divisor = r.pick(&[1, 1, 1000, 40000]);
        values.iter_mut().for_each(|v| *v /= divisor);
        let input = draft.made(t);
        let small = (size.0 / merge, size.1 / merge);
        // With a lowest code of 0, the ReLU is part of the norm.
        let lo = r.pick(&[1, 1, 128]);
        let out_t = Tensor { zero: 128, lo, hi: 255, margin: r.size(0, 2), ring: r.size(1, small.0), ..Tensor::new(Dtype::U8, small, wide) };
        let out = draft.place(out_t);
        // y * gain / 2^shift in code steps: up to 40 per standard deviation.
        let shift = 40;
        let step = 1i64 << (shift - 16);
        let gains: Vec<i64> = r.list(wide, -40 * step, 40 * step);
        let biases: Vec<i64> = r.list(wide, -(60i64 << shift), 60i64 << shift);
        let norm = LayerNorm {
            out,
            input,
            merge,
            gains: draft.words(gains.iter().map(|g| *g as i32)),
            biases: draft.constant(biases.iter().flat_map(|b| b.to_le_bytes())),
            shift,
            epsilon: r.within(1, 1 << 20),
        };
        let index = draft.operator(Operator::LayerNorm(norm));
        draft.finish();
        draft.in_order();

        let mut expected = Vec::new();
        for (row, col) in (0..small.0).flat_map(|r| (0..small.1).map(move |c| (r, c))) {
            let x: Vec<f64> = (0..wide)
                .map(|c| {
                    // Order 00, 10, 01, 11: rows fastest.
                    let place = c / channels;
                    let (down, across) = (merge * row + place % merge, merge * col + place / merge);
                    values[(down * size.1 + across) * channels + c % channels] as f64
                })
                .collect();
            let n = wide as f64;
            let mean = x.iter().sum::<f64>() / n;
            let variance = x.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n;
            for (c, v) in x.iter().enumerate() {
                let y = (v - mean) / libm::sqrt(variance + norm.epsilon as f64 / (n * n));
                let code = y * gains[c] as f64 / step as f64 + biases[c] as f64 / (1i64 << shift) as f64;
                expected.push(((code + 0.5).floor() as i64).clamp(i64::from(lo) - 128, 127));
            }
        }
        check(&draft, index, &[(input, &values)], &Expected { map: expected, cut: None }, 1);
    }
}
