//! The seams of tiles must be invisible.

use elunar_core::sun::Body;
use elunar_core::tile::{Shape, Tiling};
use elunar_learn::float::open_any;
use elunar_learn::model::backend::Backend;
use elunar_net::illumination::KnownSun;
use elunar_raster::{Crs, Raster};
use elunar_scene::predict::{NamedRaster, PredictOptions, Scene, predict};
use std::ops::ControlFlow;
use std::path::Path;

mod support;

const ROWS: usize = 500;
const COLS: usize = 700;

fn raster(rows: usize, cols: usize, pixel_m: f64, value: impl Fn(f64, f64) -> f64) -> Raster {
    support::raster((rows, cols), (0.0, 0.0), pixel_m, Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0), value)
}

/// Returns smooth hills, 100 m and more from crest to crest.
fn hills(x: f64, y: f64) -> f64 {
    20.0 * (x / 180.0).sin() * (y / 140.0).cos() + 3.0 * (x / 31.0 + y / 53.0).sin() + 2.0 * (y / 24.0 - x / 47.0).cos()
}

/// Returns Lambert brightness with the Sun in the north-west, 35 degrees high.
fn brightness(x: f64, y: f64) -> f64 {
    let (dx, dy) = ((hills(x + 1.0, y) - hills(x - 1.0, y)) / 2.0, (hills(x, y + 1.0) - hills(x, y - 1.0)) / 2.0);
    let (up, side) = (35_f64.to_radians().sin(), 35_f64.to_radians().cos() / 2_f64.sqrt());
    1000.0 * (up + side * dx - side * dy).max(0.0) / (1.0 + dx * dx + dy * dy).sqrt()
}

/// Returns the difference between the step over the line from `i` to `i + 1` and the steps beside it.
fn step(z: impl Fn(usize) -> f32, i: usize) -> f32 {
    let slope = |i: usize| z(i + 1) - z(i);
    (slope(i) - (slope(i - 1) + slope(i + 1)) / 2.0).abs()
}

#[test]
fn seams_are_no_steps() {
    let image = NamedRaster::in_memory("image", raster(ROWS, COLS, 2.0, brightness));
    let coarse = NamedRaster::in_memory("coarse DTM", raster(24, 32, 60.0, hills));
    let scene = Scene::new(image, coarse).unwrap();
    let model = open_any(&Path::new(env!("CARGO_MANIFEST_DIR")).join("models/nano.eld"), Backend::Flex).unwrap();
    let options =
        PredictOptions { sun: KnownSun { azimuth_deg: Some(315.0), elevation_deg: None }, ..PredictOptions::default() };
    let dtm = predict(&scene, model.as_ref(), &options, &mut |_, _| ControlFlow::Continue(())).unwrap().dtm;
    let at = |row: usize, col: usize| dtm.samples[row * COLS + col];

    let tiling = Tiling::new(Shape::new(ROWS, COLS), model.tile(), options.overlap_px).unwrap();
    let edges = |first: fn(&elunar_core::tile::Window) -> [usize; 2], len: usize| {
        let mut edges: Vec<usize> = tiling.iter().flat_map(|w| first(&w)).filter(|&e| e > 2 && e < len - 2).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    };
    // The last pixel before the first row or column of each tile, and the last pixel of each tile.
    let (rows, cols) = (edges(|w| [w.row, w.row + w.rows], ROWS), edges(|w| [w.col, w.col + w.cols], COLS));
    assert!(rows.len() >= 2 && cols.len() >= 4, "{rows:?} {cols:?}");
    let across = rows.iter().flat_map(|&r| (0..COLS).map(move |c| (r, c))).map(|(r, c)| step(|i| at(i, c), r - 1));
    let along = cols.iter().flat_map(|&c| (0..ROWS).map(move |r| (r, c))).map(|(r, c)| step(|i| at(r, i), c - 1));
    let seams: Vec<f32> = across.chain(along).collect();
    let everywhere: Vec<f32> =
        (0..ROWS).flat_map(|r| (1..COLS - 2).map(move |c| (r, c))).map(|(r, c)| step(|i| at(r, i), c)).collect();

    let (low, high) = dtm.range().unwrap();
    let (relief, worst) = (high - low, seams.iter().fold(0.0_f32, |a, &b| a.max(b)));
    let mean = |steps: &[f32]| steps.iter().sum::<f32>() / steps.len() as f32;
    let (seam, elsewhere) = (mean(&seams), mean(&everywhere));
    eprintln!(
        "relief {relief:.1} m; step at seams: mean {seam:.4} m, worst {worst:.3} m; elsewhere: mean {elsewhere:.4} m"
    );
    assert!(worst < 0.02 * relief, "worst step {worst} m of {relief} m relief");
    // Invisible in a hillshade (Sun 45 degrees high): the additional step is below half a grey level.
    let grey = (seam - elsewhere) / 2.0 * 254.0 * std::f32::consts::FRAC_1_SQRT_2;
    assert!(grey < 0.5, "steps of {seam} m at seams, {elsewhere} m elsewhere: {grey} grey levels");
}
