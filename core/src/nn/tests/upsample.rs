//! Compares upsamplings with bilinear interpolation.

use super::Random;
use super::draft::Draft;
use super::unit::{Expected, check, random_map};
use crate::nn::file::{Dtype, Edge, Operator, Tensor, Upsample2};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn upsamplings_equal_interpolation(seed in any::<u64>()) {
        let mut random = Random::new(seed);
        let r = &mut random;
        let size = (r.size(1, 6), r.size(1, 20));
        let mut draft = Draft::new(size);
        let dtype = r.pick(&[Dtype::U8, Dtype::I16]);
        let (zero, lo, hi) = if dtype == Dtype::U8 { (r.within(0, 255) as i32, 0, 255) } else { (0, -32767, 32767) };
        let channels = r.size(1, 40);
        let edge = |r: &mut Random| r.pick(&[Edge::Zero, Edge::Nearest]);
        let t = Tensor { zero, lo, hi, margin: r.size(0, 3), edge: edge(r), ..Tensor::new(dtype, size, channels) };
        let values = random_map(r, &t);
        let input = draft.made(t);
        let large = Tensor::new(dtype, (2 * size.0, 2 * size.1), channels);
        let large = Tensor { zero, lo, hi, margin: r.size(0, 3), edge: edge(r), ring: r.size(2, 2 * size.0), ..large };
        let out = draft.place(large);
        let index = draft.operator(Operator::Upsample2(Upsample2 { out, input }));
        draft.finish();
        draft.in_order();

        let mut expected = Vec::new();
        let axis = |at: usize, len: usize| {
            let centre = ((at as f64 + 0.5) / 2.0 - 0.5).clamp(0.0, (len - 1) as f64);
            (centre.floor() as usize, centre.ceil() as usize, centre.fract())
        };
        for (row, col) in (0..2 * size.0).flat_map(|r| (0..2 * size.1).map(move |c| (r, c))) {
            let ((r0, r1, fr), (c0, c1, fc)) = (axis(row, size.0), axis(col, size.1));
            for k in 0..channels {
                let at = |r: usize, c: usize| values[(r * size.1 + c) * channels + k] as f64;
                let top = at(r0, c0) * (1.0 - fc) + at(r0, c1) * fc;
                let bottom = at(r1, c0) * (1.0 - fc) + at(r1, c1) * fc;
                expected.push((top * (1.0 - fr) + bottom * fr + 0.5).floor() as i64);
            }
        }
        check(&draft, index, &[(input, &values)], &Expected { map: expected, cut: Some(0) }, 0);
    }
}
