//! The runner and a strip use no memory except the lent memory.
#![allow(unsafe_code)] // an allocator that counts

use elunar_core::nn::{Lighting, Model, Progress, Runner, required};
use elunar_core::norm::Light;
use elunar_core::pixels::PixelForm;
use elunar_core::strip::{Next, PostGrid, Posts, Strip, StripMemory, StripPlan, StripSettings};
use elunar_net::config::config_of;
use elunar_net::export::{CalibrationTile, CompileOptions, MapBits, export};
use elunar_net::weights::NetWeights;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is passed to the system allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises are those of the system allocator.
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

/// Returns a small network, and a tile that it was calibrated with.
fn mini() -> (Vec<u8>, CalibrationTile) {
    let path = elunar_tests::repository().join("tests/golden/mini/case.safetensors");
    let weights = NetWeights::read(&path).unwrap();
    let config = config_of(&weights, &path).unwrap();
    let image = &weights.tensors["input.image"];
    let tile = CalibrationTile {
        image: image.data.clone(),
        coarse: weights.tensors["input.coarse"].data.clone(),
        ground: None,
    };
    let options =
        CompileOptions { tile: (image.shape[2], image.shape[3]), precision: MapBits::Mixed, name: "mini".into() };
    let tiles = std::slice::from_ref(&tile);
    let bytes = export(&config, &weights, &path, tiles, &options, |_| {}).unwrap().bytes;
    (bytes, tile)
}

#[test]
fn loading_running_and_scrubbing_allocate_nothing() {
    let (bytes, tile) = mini();
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

#[test]
fn a_strip_allocates_nothing() {
    let (bytes, _) = mini();
    let model = Model::new(&bytes).unwrap();
    let (rows, cols) = (3 * model.tile().rows, 2 * model.tile().cols + 5);
    let settings = StripSettings {
        cols,
        ring_lines: StripPlan::least_lines(&model),
        overlap_px: 9,
        pixel_m: 2.0,
        coarse_px: 10.0,
        anchor: true,
        checked: false,
        light: Lighting::given(Light::assumed(None)),
        pixels: PixelForm::F32,
        posts: None,
        expected_errors: false,
    };
    let plan = StripPlan::new(&model, settings).unwrap();
    let (mut arena, mut bits) = (vec![0; plan.arena_bytes()], vec![0; plan.bytes_len()]);
    let (mut samples, mut sums) = (vec![0.0; plan.samples_len()], vec![0.0; plan.sums_len()]);
    let grid = PostGrid::spaced(cols / 10 + 3, (-10.0, -10.0), (10.0, 10.0));
    let (mut kept, post_row) = (vec![0.0; Posts::memory_len(grid.cols)], (0..grid.cols).map(|c| (c * c) as f32));
    let mut post_row: Vec<f32> = post_row.collect();
    let image: Vec<f32> = (0..cols).map(|c| if c == 7 { f32::NAN } else { (c * 37 % 91) as f32 }).collect();
    let (mut coarse_m, mut out_m, mut valid, mut lines) = (vec![0.0; cols], vec![0.0; cols], 0, 0);

    let before = allocations();
    let memory = StripMemory { samples: &mut samples, sums: &mut sums, bytes: &mut bits };
    let mut strip = Strip::new(plan, Runner::new(model, &mut arena).unwrap(), memory).unwrap();
    let mut posts = Posts::new(grid, &mut kept).unwrap();
    let mut take = |strip: &mut Strip| {
        while strip.take_line(&mut out_m).unwrap().is_some() {
            (valid, lines) = (valid + out_m.iter().filter(|z| z.is_finite()).count(), lines + 1);
        }
    };
    for row in 0..rows {
        while posts.line(&mut coarse_m).is_none() {
            post_row[0] += row as f32;
            posts.push_row(&post_row).unwrap();
        }
        strip.push_line(&image, &coarse_m).unwrap();
        while strip.step(1 << 16) == Next::Step {}
        take(&mut strip);
    }
    strip.finish();
    while strip.wants() != Next::Done {
        strip.step(1 << 16);
        take(&mut strip);
    }
    take(&mut strip);
    assert_eq!(allocations(), before);
    assert_eq!((lines, valid, strip.counters().last_fault), (rows, rows * (cols - 1), None));
}
