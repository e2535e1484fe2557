//! Every distance of two logits, through every kernel, against the formula.

use super::*;
use crate::nn::tests::kernels;

/// The formula of `quant/lut.rs` in plain numbers.
fn specified(coarse: &[i16; EXP_COARSE], fine: &[i16; EXP_FINE], distance: usize) -> i64 {
    match (coarse.get(distance / EXP_FINE), fine[distance % EXP_FINE]) {
        (Some(coarse), fine) => (*coarse as i64 * fine as i64 + (1 << 14)) >> 15,
        (None, _) => 0,
    }
}

#[test]
fn every_distance_gives_the_specified_exponential() {
    let entry = |i: usize| (32767.0 * libm::exp(-(i as f64) / 256.0)).round() as i16;
    let (coarse, fine) = (core::array::from_fn(|i| entry(i * EXP_FINE)), core::array::from_fn(entry));
    let (coarse_bytes, fine_bytes) = (coarse.map(i16::to_le_bytes), fine.map(i16::to_le_bytes));
    let kernels = kernels();
    // The first key has the largest logit; the position bias moves the others nearer or farther away.
    for ends in [0i16, 32767] {
        let mut bias = [(-ends).to_le_bytes(); MAX_TOKENS];
        bias[0] = ends.to_le_bytes();
        for first in (0..=2 * LOGIT_LIMIT).step_by(MAX_TOKENS - 1) {
            let key = |i: i64| (LOGIT_LIMIT - first - i).max(-LOGIT_LIMIT);
            let products = core::array::from_fn(|i| if i == 0 { LOGIT_LIMIT as i32 } else { key(i as i64 - 1) as i32 });
            // (2 p + 1) >> 1 is p.
            let softmax = Softmax {
                products: &products,
                tokens: MAX_TOKENS,
                width: 8,
                bias: &bias,
                bias_pitch: 8,
                multiplier: 2,
                shift: 1,
                coarse: &coarse_bytes,
                fine: &fine_bytes,
            };
            let distance = |p: &i32| (LOGIT_LIMIT - *p as i64 + 2 * ends as i64) as usize;
            let expected: [i64; MAX_TOKENS] = core::array::from_fn(|i| {
                let own = if i == 0 { 0 } else { distance(&products[i]) };
                specified(&coarse, &fine, own)
            });
            for kernel in &kernels {
                let (mut low, mut high) = ([0; MAX_TOKENS], [0; MAX_TOKENS]);
                let sum = (kernel.softmax)(&softmax, &mut low, &mut high);
                let holds = (0..MAX_TOKENS).all(|i| low[i] as i64 + 256 * high[i] as i64 == expected[i]);
                assert!(holds && sum == expected.iter().sum::<i64>(), "{kernel:?}, distances from {first} on");
            }
        }
    }
}
