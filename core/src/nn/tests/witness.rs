//! Convolutions on a processor that errs.

use super::Random;
use super::conv::Case;
use crate::nn::arena::Arena;
use crate::nn::file::Operator;
use crate::nn::kernels::scalar::Scalar;
use crate::nn::kernels::{Accumulators, Isa, Patch};
use crate::nn::ops::{self, LEAST_PIXELS, Prepared};
use crate::nn::{Kernel, Model, Progress, RunError, Runner, required};
use std::cell::Cell;

thread_local! {
    /// Products until the next error, and its place: number of the sum and of the bit.
    static NEXT: Cell<(usize, usize, u32)> = const { Cell::new((usize::MAX, 0, 0)) };
}

/// Plain Rust, with one wrong bit.
#[derive(Default)]
struct Erring;

impl Isa for Erring {
    const NAME: &str = "erring";

    fn gemm(&mut self, acc: &mut Accumulators, pixels: usize, patch: &Patch<'_>, weights: &[u8], width: usize) {
        Scalar.gemm(acc, pixels, patch, weights, width);
        let (left, sum, bit) = NEXT.get();
        if left == 0 {
            acc[sum % (pixels * width)] ^= 1 << bit;
        }
        NEXT.set((left.wrapping_sub(1), sum, bit));
    }
}

#[test]
fn an_error_in_any_product_is_found() {
    let mut found = 0;
    for seed in 0..1500 {
        let file = Case::new(seed, false).draft.file();
        let model = Model::new(&file).unwrap();
        let index = (0..model.operator_count()).find(|i| matches!(model.operator(*i), Some(Operator::Conv(_))));
        let prepared = Prepared { checked: true, ..model.ready(index.unwrap()).unwrap() };
        let few = prepared.out.cols < LEAST_PIXELS;
        let mut bytes = Random::new(seed).bytes(required(&model));
        let mut unit = |prepared: &Prepared, error: (usize, usize, u32)| {
            let mut arena = Arena { bytes: &mut bytes, scratch: model.scratch_offset() };
            NEXT.set(error);
            let made = ops::run::<Erring>(model.constants(), prepared, &mut arena, 0, 0);
            (made, usize::MAX - NEXT.get().0)
        };
        let (made, products) = unit(&prepared, (usize::MAX, 0, 0));
        assert!(made.is_some());
        for product in 0..products {
            // Above bit 23 a high plane's sum has no bit that counts.
            let error = (product, 7 * product + seed as usize, (product as u32 + seed as u32) % 24);
            assert_eq!(unit(&prepared, error).0.is_none(), !few, "seed {seed}, product {product} of {products}");
            let trusting = Prepared { checked: false, ..prepared };
            assert!(unit(&trusting, error).0.is_some());
            found += !few as usize;
        }
    }
    assert!(found > 500, "{found}");
}

#[test]
fn a_wrong_product_ends_the_tile() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../host-train/models/nano.eld");
    let file = std::fs::read(path).unwrap();
    let model = Model::new(&file).unwrap();
    let mut kernel = Kernel::SCALAR;
    kernel.unit = |_, _, _, _, _| None;
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::with_kernel(kernel, model, &mut arena).unwrap();
    runner.begin_self_test().unwrap();
    assert_eq!(runner.step(1), Err(RunError::Miscomputed { entry: 0 }));
    assert_eq!((runner.step(1), runner.telemetry().tile_faults), (Err(RunError::State), 1));
    kernel.unit = |_, _, _, _, _| Some(0);
    let mut runner = Runner::with_kernel(kernel, Model::new(&file).unwrap(), &mut arena).unwrap();
    runner.begin_self_test().unwrap();
    assert_eq!(runner.step(1), Ok(Progress::Running));
}
