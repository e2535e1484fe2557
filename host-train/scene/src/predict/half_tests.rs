//! What a void or a shadow over half of an image does to the slopes of the other half.

use super::{NamedRaster, PredictOptions, Scene, int8, predict};
use elunar_raster::Raster;
use elunar_synth::{Moon, SynthOptions};
use std::ops::ControlFlow;

const ROWS: usize = 512;
const COLS: usize = 640;

/// Returns the mean length of the differences of slopes, in metres per pixel, over columns `1..until`.
pub(super) fn slope_error(found: &Raster, truth: &Raster, until: usize) -> f64 {
    let (rows, cols) = (truth.rows, truth.cols);
    let (mut sum, mut count) = (0.0, 0.0);
    for i in (cols + 1..(rows - 1) * cols).filter(|i| (1..until).contains(&(i % cols))) {
        let apart = |a: usize, b: usize| {
            f64::from((found.samples[a] - found.samples[b]) - (truth.samples[a] - truth.samples[b]))
        };
        let error = 0.5 * apart(i + 1, i - 1).hypot(apart(i + cols, i - cols));
        if error.is_finite() {
            (sum, count) = (sum + error, count + 1.0);
        }
    }
    sum / count
}

#[test]
fn half_a_void_or_a_shadow_leaves_the_other_half() {
    let nano = int8::open(&std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/nano.eld")).unwrap();
    let input = |name: &str, raster: &Raster| NamedRaster::in_memory(name, raster.clone());
    for index in 0..4 {
        let made = Moon::new(4711, SynthOptions::default()).unwrap().scene(index, ROWS, COLS).unwrap();
        let (image, coarse, truth) = (made.image_raster(), made.coarse_raster(), made.truth_raster());
        let error = |hide: fn(f32) -> f32| {
            let mut image = image.clone();
            image.samples.iter_mut().enumerate().filter(|(i, _)| i % COLS >= COLS / 2).for_each(|(_, v)| *v = hide(*v));
            let scene = Scene::new(input("image", &image), input("coarse DTM", &coarse)).unwrap();
            let found =
                predict(&scene, &nano, &PredictOptions::default(), &mut |_, _| ControlFlow::Continue(())).unwrap();
            slope_error(&found.dtm, &truth, COLS / 2 - 12)
        };
        let whole = error(|v| v);
        let (void, shadow) = (error(|_| f32::NAN) / whole, error(|v| 0.01 * v) / whole);
        println!(
            "scene {index}: slope error of the other half, of the whole image's: void {void:.3}, shadow {shadow:.3}"
        );
        assert!(void < 1.05 && shadow < 1.05, "scene {index}: {void}, {shadow}");
    }
}
