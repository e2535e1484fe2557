//! The flight pipeline for strips gives the same tiles and the same bits as the mosaic on the ground.

use super::int8::{self, Int8Model};
use super::neighbourhoods::{Parts, SceneLight};
use super::network::TileModel;
use super::run::predict_span;
use super::span::Span;
use super::tests::{place, silent};
use super::{NamedRaster, PredictOptions, Scene, predict, predict_rows};
use elunar_core::nn::Runner;
use elunar_core::photoclinometry::Origin;
use elunar_core::pixels::{PixelForm, PixelFormat};
use elunar_core::strip::{
    LineErrors, Next, PostGrid, Posts, Strip, StripCounters, StripError, StripMemory, StripPlan, StripSettings,
};
use elunar_core::tile::{Shape, Tiling};
use elunar_net::illumination::{KnownSun, Light, Lighting};
use elunar_raster::Raster;
use elunar_raster::resample::PixelMap;

fn nano() -> Int8Model {
    int8::open(&std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/nano.eld")).unwrap()
}

/// Returns the height of hills with craters that are finer than the coarse DTM.
fn hills(x: f64, y: f64) -> f64 {
    20.0 * (x / 180.0).sin() * (y / 140.0).cos() + 3.0 * (x / 31.0 + y / 53.0).sin() + 2.0 * (y / 24.0 - x / 47.0).cos()
}

/// Returns the brightness under light from the south-east, so that every tile is mirrored both ways.
fn brightness(x: f64, y: f64) -> f64 {
    let (dx, dy) = ((hills(x + 1.0, y) - hills(x - 1.0, y)) / 2.0, (hills(x, y + 1.0) - hills(x, y - 1.0)) / 2.0);
    1000.0 * (0.57 - 0.58 * dx + 0.58 * dy).max(0.0) / (1.0 + dx * dx + dy * dy).sqrt()
}

fn raster((rows, cols): (usize, usize), origin: (f64, f64), pixel_m: f64, value: impl Fn(f64, f64) -> f64) -> Raster {
    let georef = place(origin, pixel_m);
    let sample = |i: usize| {
        let (x, y) = georef.as_ref().unwrap().centre((i / cols) as f64, (i % cols) as f64);
        value(x, y) as f32
    };
    Raster { rows, cols, samples: (0..rows * cols).map(sample).collect(), georef: georef.clone() }
}

/// Returns image and coarse DTM with a shadow and gaps: single pixels, a bar across tiles, lines, a corner of the coarse DTM.
fn pair(rows: usize, cols: usize) -> (Raster, Raster) {
    let mut image = raster((rows, cols), (0.0, 0.0), 2.0, brightness);
    for (i, v) in image.samples.iter_mut().enumerate() {
        let (row, col) = (i / cols, i % cols);
        let bar = (150..170).contains(&row) && (100..400).contains(&col);
        // A shadow.
        if (60..80).contains(&row) && (20..90).contains(&col) {
            *v = 3.0;
        }
        if (i * 7919) % 1013 == 0 || bar || row == 90 || row + 1 == rows && col < 40 {
            *v = f32::NAN;
        }
    }
    let mut coarse = raster((rows / 30 + 4, cols / 30 + 4), (-61.0, 55.0), 59.0, hills);
    let wide = coarse.cols;
    for i in [0, 1, wide, 5 * wide + 4, 9 * wide + 8] {
        if let Some(z) = coarse.samples.get_mut(i) {
            *z = f32::NAN;
        }
    }
    (image, coarse)
}

fn scene((image, coarse): &(Raster, Raster)) -> Scene {
    Scene::new(NamedRaster::in_memory("image", image.clone()), NamedRaster::in_memory("coarse DTM", coarse.clone()))
        .unwrap()
}

fn settings(scene: &Scene, model: &Int8Model, options: &PredictOptions, ring_lines: usize) -> StripSettings {
    StripSettings {
        cols: scene.cols,
        ring_lines,
        overlap_px: options.overlap_px,
        pixel_m: scene.pixel_m,
        coarse_px: scene.coarse_px,
        anchor: options.anchor,
        checked: false,
        light: scene.light_for(model.input_rules().illumination, options.sun).unwrap().whole,
        pixels: PixelForm::F32,
        posts: None,
        expected_errors: options.expected_errors,
    }
}

/// Heights, expected errors of heights and slopes, and origins.
type Maps = (Vec<f32>, Vec<f32>, Vec<f32>, Vec<u8>);

/// Sends a scene line by line, with `budget_macs` between two lines. Without room for a line, it works until there is room.
fn line_by_line(scene: &Scene, model: &Int8Model, settings: StripSettings, budget_macs: u64) -> (Maps, StripCounters) {
    let model = model.model();
    let plan = StripPlan::new(&model, settings).unwrap();
    let (mut arena, mut valid) = (vec![0; plan.arena_bytes()], vec![0; plan.bytes_len()]);
    let (mut samples, mut sums) = (vec![0.0; plan.samples_len()], vec![0.0; plan.sums_len()]);
    let memory = StripMemory { samples: &mut samples, sums: &mut sums, bytes: &mut valid };
    let mut strip = Strip::new(plan, Runner::new(model, &mut arena).unwrap(), memory).unwrap();
    let mut made: Maps = (vec![], vec![], vec![], vec![]);
    let line = || vec![0.0; scene.cols];
    let (mut line_m, mut height_m, mut slope, mut origin) = (line(), line(), line(), vec![0; scene.cols]);
    let mut take = |strip: &mut Strip| loop {
        let errors = LineErrors { height_m: &mut height_m, slope: &mut slope, origin: &mut origin };
        let Some(row) = strip.take_line_with(&mut line_m, errors).unwrap() else { return };
        assert_eq!(row, made.0.len() / scene.cols);
        made.0.extend_from_slice(&line_m);
        made.1.extend_from_slice(&height_m);
        made.2.extend_from_slice(&slope);
        made.3.extend_from_slice(&origin);
    };
    let band = scene.band(0, scene.rows).unwrap();
    for (image, coarse_m) in band.image.chunks_exact(scene.cols).zip(band.coarse_m.chunks_exact(scene.cols)) {
        while strip.push_line(image, coarse_m) == Err(StripError::Full) {
            strip.step(budget_macs);
            take(&mut strip);
        }
        strip.step(budget_macs);
        take(&mut strip);
    }
    strip.finish();
    while strip.wants() != Next::Done {
        strip.step(budget_macs);
        take(&mut strip);
    }
    take(&mut strip);
    (made, strip.counters())
}

fn assert_same(found: &[f32], expected: &[f32], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let differs = |(a, b): (&f32, &f32)| a.to_bits() != b.to_bits() && !(a.is_nan() && b.is_nan());
    let many = found.iter().zip(expected).filter(|&pair| differs(pair)).count();
    let first = found.iter().zip(expected).position(differs);
    assert_eq!(first.map(|i| (i, found[i], expected[i])), None, "{what}: {many} differ");
}

/// Checks that heights are those of the ground: bit for bit under up to two tiles, else up to the next float. Returns the number of the latter.
fn assert_heights(found: &[f32], expected: &[f32], (rows, cols): (usize, usize), overlap_px: usize) -> usize {
    let whole = Shape::new(rows.max(256), cols.max(320));
    let windows: Vec<_> = Tiling::new(whole, Shape::new(256, 320), overlap_px).unwrap().iter().collect();
    let near = |at: usize, first: usize, len: usize| at >= first && at - first < len;
    let tiles = |(row, col): (usize, usize)| {
        windows.iter().filter(|w| near(row, w.row, w.rows) && near(col, w.col, w.cols)).count()
    };
    let mut others = 0;
    assert_eq!(found.len(), expected.len());
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        let (place, apart) = ((i / cols, i % cols), a.to_bits().abs_diff(b.to_bits()));
        if apart > 0 && !(a.is_nan() && b.is_nan()) {
            // One in the last bit; of a height near 0, in the last bits of the sums that cancel.
            let last = apart == 1 && (a - b).abs() < 1e-3 || (a - b).abs() < 1e-9;
            assert!(last && tiles(place) > 2, "{place:?}: {a} instead of {b}");
            others += 1;
        }
    }
    others
}

/// Returns the maps of the ground, one after the other.
fn errors_on_the_ground(scene: &Scene, model: &Int8Model, options: &PredictOptions) -> Vec<Vec<f32>> {
    let mut layers = vec![vec![]; options.layers()];
    let mut keep = |rows: &[f32]| {
        for (i, line) in rows.chunks_exact(scene.cols).enumerate() {
            layers[i % options.layers()].extend_from_slice(line);
        }
        Ok(())
    };
    predict_rows(scene, model, options, 0, &mut keep, &mut silent).unwrap();
    layers
}

#[test]
fn a_strip_is_the_mosaic_of_its_tiles() {
    let model = nano();
    let sun = KnownSun { azimuth_deg: Some(135.0), elevation_deg: Some(35.0) };
    let (mut of_image, mut others) = (0, 0);
    for ((rows, cols), ring_lines, budget_macs, anchor, overlap_px) in [
        ((600, 701), 257, 7_654_321, true, 100),
        ((530, 330), 400, u64::MAX, false, 61),
        ((200, 250), 300, 50_000_001, true, 100),
    ] {
        let scene = scene(&pair(rows, cols));
        let options = PredictOptions { overlap_px, anchor, sun, expected_errors: true, ..PredictOptions::default() };
        let made = predict(&scene, &model, &options, &mut silent).unwrap();
        let settings = settings(&scene, &model, &options, ring_lines);
        let ((found, heights, slopes, origins), counters) = line_by_line(&scene, &model, settings, budget_macs);
        others += assert_heights(&found, &made.dtm.samples, (rows, cols), overlap_px);
        let layers = errors_on_the_ground(&scene, &model, &options);
        assert_same(&heights, &layers[1], "errors of heights");
        assert_same(&slopes, &layers[2], "errors of slopes");
        let expected: Vec<u8> = layers[3].iter().zip(&layers[4]).map(|(e, d)| Origin::of(*e, *d) as u8).collect();
        assert!(origins == expected, "origins");
        let of = |origin: Origin| origins.iter().filter(|found| **found == origin as u8).count();
        let counts = [Origin::Image, Origin::Shadow, Origin::Void].map(of);
        assert!(counts[1] > 1000 && counts[2] > cols, "{rows} x {cols}: {counts:?}");
        of_image += counts[0];
        let without = StripSettings { expected_errors: false, ..settings };
        let ((same, heights, _, origins), _) = line_by_line(&scene, &model, without, budget_macs);
        assert_same(&same, &found, "without errors");
        assert!(heights.iter().all(|sd| sd.is_nan()) && origins.iter().all(|origin| *origin == Origin::Void as u8));
        assert!(found.iter().filter(|z| z.is_nan()).count() > cols, "gaps");
        assert!(found.iter().filter(|z| z.is_finite()).count() > rows * cols / 2, "heights");
        let tally = (made.tally.tiles, made.tally.tiles_coarse, made.tally.tiles_empty);
        assert_eq!(
            (counters.tiles, counters.tiles_coarse, counters.tiles_empty),
            (tally.0 as u64, tally.1 as u64, tally.2 as u64)
        );
        assert_eq!((counters.tiles_again, counters.last_fault), (0, None));
    }
    assert!(of_image > 100_000, "{of_image}");
    eprintln!("{others} heights are the next float");
    assert!(others < 2_000, "{others}");
}

/// Where brightness may have nothing to do with the coarse DTM, flight and ground settle on it alike.
#[test]
fn a_strip_under_a_doubtful_light_is_that_of_the_ground() {
    let (model, scene) = (nano(), scene(&pair(300, 330)));
    let sun = KnownSun { azimuth_deg: Some(135.0), elevation_deg: Some(35.0) };
    let options = PredictOptions { sun, ..PredictOptions::default() };
    let sure = settings(&scene, &model, &options, 300);
    let doubtful = StripSettings { light: Lighting { related: 0.37, ..sure.light }, ..sure };
    let [believed, found] = [sure, doubtful].map(|settings| line_by_line(&scene, &model, settings, u64::MAX).0.0);

    let light = SceneLight::new(doubtful.light, model.input_rules().illumination, sun, Parts::default());
    let (span, mut on_the_ground) = (Span { rows: 0..scene.rows, from: 0 }, vec![]);
    let mut keep = |rows: &[f32]| {
        on_the_ground.extend_from_slice(rows);
        Ok(())
    };
    predict_span(&scene, &model, &options, light, &span, &mut keep, &mut silent).unwrap();
    assert_heights(&found, &on_the_ground, (300, 330), options.overlap_px);

    let coarse_m = scene.band(0, scene.rows).unwrap().coarse_m;
    let settled = |((z, coarse), found): ((&f32, &f32), &f32)| (coarse + 0.37 * (z - coarse) - found).abs();
    let apart = believed.iter().zip(&coarse_m).zip(&found).map(settled).filter(|v| v.is_finite());
    assert!(apart.fold(0.0, f32::max) < 0.01, "the mean of both");
}

#[test]
fn posts_row_by_row_are_the_resampled_coarse_dtm() {
    let (image, coarse) = pair(600, 701);
    let scene = scene(&(image.clone(), coarse.clone()));
    let transform = |raster: &Raster| raster.georef.as_ref().unwrap().transform;
    let map = PixelMap::between(&transform(&image), &transform(&coarse)).unwrap();
    assert_eq!((map.row_per_col, map.col_per_row), (0.0, 0.0));
    let grid = PostGrid {
        cols: coarse.cols,
        row0: map.row0,
        rows_per_line: map.row_per_row,
        col0: map.col0,
        cols_per_px: map.col_per_col,
    };
    let mut memory = vec![0.0; Posts::memory_len(grid.cols)];
    let mut posts = Posts::new(grid, &mut memory).unwrap();
    let (mut rows, mut found, mut line_m) = (coarse.samples.chunks_exact(coarse.cols), vec![], vec![0.0; 701]);
    while found.len() < 600 * 701 {
        match posts.line(&mut line_m) {
            Some(_) => found.extend_from_slice(&line_m),
            None => match rows.next() {
                Some(row) => posts.push_row(row).unwrap(),
                None => posts.finish(),
            },
        }
    }
    let expected = scene.band(0, 600).unwrap().coarse_m;
    assert!(expected.iter().any(|z| z.is_nan()) && expected.iter().filter(|z| z.is_finite()).count() > 300_000);
    assert_same(&found, &expected, "posts");
}

/// Checks `core/docs/strip-memory.csv`.
#[test]
fn memory_is_as_documented() {
    let file = nano();
    let model = file.model();
    let table =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../core/docs/strip-memory.csv")).unwrap();
    let posts = |cols: usize| Some(PostGrid::spaced(cols / 30 + 4, (-30.0, -30.0), (30.0, 30.0)));
    let pixels = PixelForm { format: PixelFormat::U16Le, ..PixelForm::F32 };
    for (cols, form, pixels, posts) in [
        (5064, "16 bits and posts", pixels, posts(5064)),
        (5064, "floats and lines", PixelForm::F32, None),
        (320, "16 bits and posts", pixels, posts(320)),
        (320, "floats and lines", PixelForm::F32, None),
    ] {
        for more in [0, 156] {
            let ring_lines = StripPlan::least_lines(&model) + more;
            let settings = StripSettings {
                cols,
                ring_lines,
                overlap_px: 100,
                pixel_m: 2.0,
                coarse_px: 30.0,
                anchor: true,
                checked: false,
                light: Lighting::given(Light::assumed(None)),
                pixels,
                posts,
                expected_errors: false,
            };
            let plan = StripPlan::new(&model, settings).unwrap();
            let parts =
                [plan.arena_bytes(), plan.bytes_len(), 4 * plan.samples_len(), 8 * plan.sums_len(), plan.bytes()];
            let row = format!("{cols},{form},{ring_lines},{}", parts.map(|bytes| bytes.to_string()).join(","));
            eprintln!("{row}");
            assert!(table.lines().any(|line| line == row), "core/docs/strip-memory.csv lacks {row}");
        }
    }
}
