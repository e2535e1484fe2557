//! Measures one 256x320 tile: every preset (random weights) with every kernel of this processor, on one thread and on two at once; and for
//! comparison the shipped `nano` in float.
//!
//! `cargo bench -p elunar-benches --bench tile_latency`; with `ELUNAR_BENCH_PAPER=1`, `paper` too.
//!
//! The time is that of a caller: floats in, floats out. With two threads each has its own runner, and both read the same model.

#![allow(missing_docs)] // criterion's macros make functions without documentation

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use elunar_benches::models::{exported, name, presets, tile};
use elunar_benches::samples::{Timings, measure, seconds};
use elunar_benches::table::{Table, number, publish};
use elunar_core::nn::{Kernel, Model, Progress, Runner, required};
use elunar_core::tile::Shape;
use elunar_learn::float;
use elunar_learn::model::backend::Backend;
use elunar_net::config::Preset;
use elunar_net::kernels;
use elunar_scene::predict::network::TileModel as _;
use std::path::Path;
use std::sync::Barrier;
use std::time::{Duration, Instant};

/// Largest number of multiply-accumulates for the scalar kernel; more would take minutes.
const SCALAR_MACS: u64 = 10_000_000_000;

/// A runner with its tile.
struct Worker<'a, 'm> {
    runner: Runner<'a, 'm>,
    image: Vec<f32>,
    coarse: Vec<f32>,
    output: Vec<f32>,
}

impl<'a, 'm> Worker<'a, 'm> {
    /// Makes a worker and runs one tile, to warm the caches.
    fn new(kernel: Kernel, model: Model<'a>, arena: &'m mut [u8]) -> Self {
        let runner = Runner::with_kernel(kernel, model, arena).expect("the arena is as large as the model says");
        let Shape { rows, cols } = model.tile();
        let (image, coarse) = tile(rows, cols, model.image_maps());
        let mut worker = Self { runner, image, coarse, output: vec![0.0; rows * cols] };
        worker.tiles(1);
        worker
    }

    fn tiles(&mut self, count: u64) {
        for _ in 0..count {
            self.runner.begin(&self.image, &self.coarse).expect("the tile has the right size");
            while self.runner.step(u64::MAX).expect("a tile was begun") == Progress::Running {}
            self.runner.output(&mut self.output).expect("the tile is done");
        }
    }
}

/// Returns the seconds of all workers together for `tiles` tiles each, from the first start to the last end.
fn together(workers: &mut [Worker<'_, '_>], tiles: u64) -> f64 {
    let barrier = Barrier::new(workers.len());
    let work = |worker: &mut Worker<'_, '_>| {
        barrier.wait();
        let start = Instant::now();
        worker.tiles(tiles);
        (start, Instant::now())
    };
    let work = &work;
    std::thread::scope(|scope| {
        let threads: Vec<_> = workers.iter_mut().map(|worker| scope.spawn(move || work(worker))).collect();
        let times: Vec<(Instant, Instant)> = threads.into_iter().map(|t| t.join().expect("no fault")).collect();
        let start = times.iter().map(|time| time.0).min();
        let end = times.iter().map(|time| time.1).max();
        end.zip(start).map_or(0.0, |(end, start)| (end - start).as_secs_f64())
    })
}

fn network(group: &mut BenchmarkGroup<'_, WallTime>, preset: Preset, table: &mut Table) {
    let bytes = exported(preset).expect("a preset can be exported");
    let model = Model::new(&bytes).expect("an exported model is valid");
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    for kernel in kernels::kernels() {
        if kernel.name() == Kernel::SCALAR.name() && model.macs() > SCALAR_MACS {
            println!("SKIPPED: {}/{}: more than {SCALAR_MACS} products a tile", name(preset), kernel.name());
            continue;
        }
        for threads in [1, 2] {
            if threads > cores {
                println!("SKIPPED: {}/{} on {threads} threads: {cores} core", name(preset), kernel.name());
                continue;
            }
            let id = format!("{}/{}/{threads}-thread", name(preset), kernel.name());
            group.throughput(Throughput::Elements(threads as u64));
            let mut arenas = vec![vec![0; required(&model)]; threads];
            let mut workers: Vec<Worker<'_, '_>> =
                arenas.iter_mut().map(|arena| Worker::new(kernel, model, arena)).collect();
            let (samples, _) = measure(group, &id, |tiles| together(&mut workers, tiles), || 0.0);
            let sizes = [bytes.len(), threads * required(&model)].map(|size| size.to_string());
            row(table, name(preset), kernel.name(), threads, &samples, Some(model.macs()), sizes);
        }
    }
}

fn row(
    table: &mut Table,
    network: &str,
    kernel: &str,
    threads: usize,
    samples: &Timings,
    macs: Option<u64>,
    sizes: [String; 2],
) {
    let rate = samples.median().map(|s| threads as f64 / s);
    let mut cells = vec![network.to_string(), kernel.to_string(), threads.to_string()];
    cells.extend([samples.median(), samples.fastest()].map(|s| number(s.map(|s| s * 1e3), 2)));
    cells.push(number(rate, 2));
    cells.push(number(rate.zip(macs).map(|(rate, macs)| rate * macs as f64 / 1e9), 1));
    cells.extend(sizes);
    table.row(cells);
}

/// Measures the float network of the shipped `nano`, with its backend's own number of threads.
fn float_network(group: &mut BenchmarkGroup<'_, WallTime>, table: &mut Table) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../host-train/models/nano.safetensors");
    let model = float::open(&path, Backend::Flex).expect("shipped float weights");
    let mut worker = model.worker().expect("the shipped model runs");
    let Shape { rows, cols } = model.tile();
    let ((image, coarse), mut output) =
        (tile(rows, cols, model.input_rules().illumination.image_maps()), vec![0.0; rows * cols]);
    group.throughput(Throughput::Elements(1));
    let mut once = || worker.predict(&image, &coarse, &mut output).expect("no fault");
    let (samples, _) = measure(group, "nano/float-flex", |tiles| seconds(|| (0..tiles).for_each(|_| once())), || 0.0);
    row(table, "nano, float", "flex, its own threads", 1, &samples, None, ["", ""].map(String::from));
}

fn tile_latency(criterion: &mut Criterion) {
    let head = ["network", "kernel", "threads", "ms", "fastest", "tiles/s", "GMAC/s", "model, bytes", "arenas, bytes"];
    let mut table = Table::new("tiles", &head);
    let mut group = criterion.benchmark_group("tile_256x320");
    group.sampling_mode(SamplingMode::Flat).sample_size(15).nresamples(2000);
    group.warm_up_time(Duration::from_millis(10)).measurement_time(Duration::from_secs(1));
    float_network(&mut group, &mut table);
    for preset in presets() {
        network(&mut group, preset, &mut table);
    }
    group.finish();
    publish(env!("CARGO_TARGET_TMPDIR"), &[table]);
}

criterion_group!(benches, tile_latency);
criterion_main!(benches);
