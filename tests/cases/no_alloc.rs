//! The runner takes no memory but what it is lent.
#![allow(unsafe_code)] // an allocator that counts

use elunar_core::nn::{Model, Progress, Runner, required};
use host_train::export::{CalibrationTile, Options, Precision, export};
use host_train::model::weights::Weights;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is handed on to the system allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises are the system allocator's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations() -> usize {
    ALLOCATIONS.with(Cell::get)
}

#[test]
fn loading_running_and_scrubbing_allocate_nothing() {
    let path = elunar_tests::repository().join("tests/golden/mini/case.safetensors");
    let weights = Weights::read(&path).unwrap();
    let config = serde_json::from_str(&weights.metadata["config"]).unwrap();
    let image = &weights.tensors["input.image"];
    let tile = CalibrationTile {
        image: image.data.clone(),
        coarse: weights.tensors["input.coarse"].data.clone(),
        ground: None,
    };
    let options = Options { tile: (image.shape[2], image.shape[3]), precision: Precision::Mixed, name: "mini".into() };
    let tiles = std::slice::from_ref(&tile);
    let bytes = export(&config, &weights, &path, tiles, &options, |_| {}).unwrap().bytes;
    let mut arena = vec![0; required(&Model::new(&bytes).unwrap())];
    let mut out = vec![0.0; tile.image.len()];

    let before = allocations();
    assert!(before > 0, "the counter counts");
    let model = Model::new(&bytes).unwrap();
    let mut runner = Runner::new(model, &mut arena).unwrap();
    runner.begin(&tile.image, &tile.coarse).unwrap();
    while runner.step(1 << 16).unwrap() == Progress::Running {
        runner.scrub(4096).unwrap();
    }
    runner.output(&mut out).unwrap();
    assert_eq!(allocations(), before);
    assert!(out.iter().any(|v| *v != out[0]));
}
