//! One 256x320 tile of the shipped `nano`: float network against the int8 runner with every kernel this processor has, in one run.
//!
//! `cargo bench -p elunar-benches --bench tile_latency`

#![allow(missing_docs)] // criterion's macros make undocumented functions

use criterion::{Criterion, criterion_group, criterion_main};
use elunar_core::nn::kernels::Kernel;
use host_train::model::backend::Backend;
use host_train::predict::network::Model;
use host_train::predict::{float, int8};
use std::hint::black_box;
use std::path::{Path, PathBuf};

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../host-train/models")
}

/// A tile with texture and relief; the time does not depend on its values.
fn tile(rows: usize, cols: usize) -> (Vec<f32>, Vec<f32>) {
    let image = (0..rows * cols).map(|i| (i % 97) as f32 / 96.0).collect();
    let coarse = (0..rows * cols).map(|i| (i / cols) as f32 * 50.0 / rows as f32).collect();
    (image, coarse)
}

fn one(criterion: &mut Criterion, name: &str, model: &dyn Model) {
    let (rows, cols) = model.tile();
    let (image, coarse) = tile(rows, cols);
    let mut worker = model.worker().expect("the shipped model runs");
    let mut output = vec![0.0; rows * cols];
    let mut group = criterion.benchmark_group("tile_256x320");
    group.sample_size(15);
    group.bench_function(name, |bencher| {
        bencher.iter(|| worker.predict(black_box(&image), black_box(&coarse), &mut output).expect("no fault"));
    });
    group.finish();
}

fn tile_latency(criterion: &mut Criterion) {
    let float = float::open(&models().join("nano.safetensors"), Backend::Flex).expect("shipped float weights");
    one(criterion, "nano/float-flex", &float);
    for kernel in Kernel::available() {
        let int8 = int8::open(&models().join("nano.eld")).expect("shipped model file").with_kernel(kernel);
        one(criterion, &format!("nano/int8-{}", kernel.name()), &int8);
    }
}

criterion_group!(benches, tile_latency);
criterion_main!(benches);
