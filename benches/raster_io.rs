//! Writes and reads GeoTIFFs: a band of a strip, 2,048 x 5,000 heights (41 MB), is written row by row and read in windows of 256 rows.
//! Throughput counts the samples' bytes, not those of the file. Sizes and times depend on the terrain, which is a computed fractal.
//!
//! `cargo bench -p elunar-benches --bench raster_io`

#![allow(missing_docs)] // criterion's macros make functions without documentation

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use elunar_core::sun::Body;
use elunar_core::tile::Window;
use elunar_raster::geotiff::{Compression, WriteOptions, Writer};
use elunar_raster::{Crs, GeoRef, source};
use std::hint::black_box;

const ROWS: usize = 2_048;
const COLS: usize = 5_000;
const BAND_ROWS: usize = 256;

/// Returns a sum of octaves of waves with random phases: smooth at short distances, rough at long ones, with all digits in use.
fn terrain() -> Vec<f32> {
    let mut heights_m = vec![0.0_f32; ROWS * COLS];
    let mut state = 1_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f32 / (1_u64 << 31) as f32
    };
    for octave in 0..24 {
        let wavelength_px = 6_000.0 / 1.4_f32.powi(octave);
        let (angle, phase) = (random() * std::f32::consts::TAU, random() * std::f32::consts::TAU);
        let (a, b) = (angle.cos() / wavelength_px, angle.sin() / wavelength_px);
        for (i, height) in heights_m.iter_mut().enumerate() {
            let along = (i / COLS) as f32 * a + (i % COLS) as f32 * b;
            *height += 0.02 * wavelength_px * (along * std::f32::consts::TAU + phase).sin();
        }
    }
    heights_m
}

fn raster_io(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let heights_m = terrain();
    let georef = GeoRef { transform: [0.0, 2.0, 0.0, 0.0, 0.0, -2.0], crs: Crs::polar(Body::Moon.radius_m(), true) };
    let mut group = criterion.benchmark_group("raster_io");
    group.sample_size(10).throughput(Throughput::Bytes((ROWS * COLS * 4) as u64));
    for compression in [Compression::None, Compression::Lzw, Compression::Deflate, Compression::Zstd] {
        let path = folder.path().join(format!("{compression:?}.tif"));
        let options = WriteOptions::heights("bench").with_compression(compression);
        group.bench_function(format!("write {compression:?}"), |bench| {
            bench.iter(|| {
                let mut writer = Writer::create(&path, ROWS, COLS, Some(&georef), &options).expect("room on the disk");
                heights_m.chunks(BAND_ROWS * COLS).for_each(|rows| writer.write_rows(rows).expect("whole rows"));
                writer.finish().expect("all rows");
            });
        });
        let bytes = std::fs::metadata(&path).expect("the file just written").len();
        println!(
            "{compression:?}: {:.1} MB for {:.1} MB of heights",
            bytes as f64 / 1e6,
            (ROWS * COLS * 4) as f64 / 1e6
        );
        group.bench_function(format!("read {compression:?}"), |bench| {
            bench.iter(|| {
                let source = source::open(&path).expect("our own file");
                for row in (0..ROWS).step_by(BAND_ROWS) {
                    black_box(source.read(Window { row, col: 0, rows: BAND_ROWS, cols: COLS }).expect("a window"));
                }
            });
        });
    }
    group.finish();
}

criterion_group!(benches, raster_io);
criterion_main!(benches);
