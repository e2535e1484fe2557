//! A tile has the same heights, validity and expected errors with their origins, byte for byte, by the C functions, as a strip of one tile, and as a scene of
//! that size. The survey of the scene finds the light that the tile finds by itself; the strip is given it.
#![allow(unsafe_code)] // C functions

use elunar_capi::ffi;
use elunar_capi::status::*;
use elunar_capi::types::*;
use elunar_core::nn::{KnownSun, LightSource, Lighting, Model, Progress, Runner, TileLight, required};
use elunar_core::photoclinometry::{ExpectedErrors, Origin};
use elunar_core::pixels::PixelForm;
use elunar_core::strip::{LineErrors, Next, Strip, StripMemory, StripPlan, StripSettings};
use elunar_core::sun::Body;
use elunar_core::tile::Shape;
use elunar_core::{TileInput, TileJob, TileMemory, TileRules};
use elunar_raster::resample::PixelMap;
use elunar_raster::{Crs, GeoRef, Raster};
use elunar_scene::predict::{NamedRaster, PredictOptions, Scene, int8, predict_rows};
use elunar_tests::repository;
use std::ops::ControlFlow;

const SHAPE: Shape = Shape::new(256, 320);
const PX: usize = SHAPE.rows * SHAPE.cols;
const RULES: TileRules = TileRules { pixel_m: 2.0, coarse_px: 29.61, anchor: true, checked: false };

/// A tile in physical units, voids NaN.
struct Tile {
    what: &'static str,
    image: Vec<f32>,
    coarse_m: Vec<f32>,
    sun: KnownSun,
}

/// What a tile becomes. Heights of pixels that are not valid are NaN; errors are those of every valid pixel: of height and slope, share
/// explained, whether dark.
struct Made {
    heights_m: Vec<f32>,
    valid: Vec<bool>,
    errors: Vec<[f32; 4]>,
}

impl Made {
    /// Makes the results of a whole tile: heights everywhere, and errors for it.
    fn of_tile(tile: &Tile, mut heights_m: Vec<f32>, valid: Vec<bool>, expected: ExpectedErrors) -> Self {
        heights_m.iter_mut().zip(&valid).filter(|(_, valid)| !**valid).for_each(|(z, _)| *z = f32::NAN);
        let at = |v: &f32| {
            let errors = expected.at(*v);
            [errors.height_m, errors.slope, errors.explained, errors.dark]
        };
        Self { heights_m, valid, errors: tile.image.iter().map(at).collect() }
    }
}

fn golden() -> Tile {
    let folder = repository().join("tests/golden/flight_tile");
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let floats = |name: &str| read(name).as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect::<Vec<f32>>();
    let (mut image, mut coarse_m) = (floats("image.f32"), floats("coarse_m.f32"));
    for (i, valid) in read("valid.u8").into_iter().enumerate() {
        let real = |v: f32| v.is_finite() && v.abs() < 1e30;
        for map in [&mut image, &mut coarse_m] {
            map[i] = if valid == 1 && real(map[i]) { map[i] } else { f32::NAN };
        }
    }
    let sun = KnownSun { azimuth_deg: Some(f64::from(189.488_53_f32)), elevation_deg: Some(f64::from(25.614_722_f32)) };
    Tile { what: "the golden tile", image, coarse_m, sun }
}

fn tiles() -> [Tile; 6] {
    let unknown = KnownSun::default();
    let mut holes = Tile { what: "voids and shadows", ..golden() };
    for i in 0..PX {
        let (row, col) = (i / SHAPE.cols, i % SHAPE.cols);
        // Craters in shadow, lost blocks of the image, voids of the coarse DTM.
        if (row % 90).pow(2) + (col % 110).pow(2) < 400 {
            holes.image[i] *= 0.02;
        }
        if row % 64 > 57 && col % 100 < 31 {
            holes.image[i] = f32::NAN;
        }
        if (row + 2 * col) % 173 < 6 {
            holes.coarse_m[i] = f32::NAN;
        }
    }
    let light = Tile { what: "a tile without light", image: vec![50.0; PX], ..golden() };
    let level = Tile { what: "an assumed azimuth", coarse_m: vec![-1900.0; PX], sun: unknown, ..golden() };
    let mut whole = Tile { what: "a tile without voids", ..golden() };
    for map in [&mut whole.image, &mut whole.coarse_m] {
        (1..PX).filter(|i| map[*i].is_nan()).collect::<Vec<_>>().into_iter().for_each(|i| map[i] = map[i - 1]);
        (0..PX).rev().filter(|i| map[*i].is_nan()).collect::<Vec<_>>().into_iter().for_each(|i| map[i] = map[i + 1]);
    }
    [whole, golden(), Tile { what: "a fitted azimuth", sun: unknown, ..golden() }, holes, light, level]
}

fn known(deg: Option<f64>) -> f32 {
    deg.map_or(f32::NAN, |deg| deg as f32)
}

/// Makes a tile by the C functions; returns it with the origins of its heights.
fn through_c(model: &[u8], tile: &Tile) -> (Made, Vec<u8>) {
    through_c_with(model, tile, |_| {})
}

/// Returns a tile's structure.
fn c_tile(tile: &Tile) -> eld_tile_t {
    let image = eld_pixels_t {
        data: tile.image.as_ptr().cast(),
        data_bytes: 4 * PX,
        row_bytes: 0,
        format: ELD_PIXELS_F32,
        flags: 0,
        gain: 1.0,
        offset: 0.0,
        null_code: 0,
        saturated_from: 0,
    };
    eld_tile_t {
        struct_bytes: size_of::<eld_tile_t>() as u32,
        pixel_m: RULES.pixel_m,
        coarse_px: RULES.coarse_px,
        sun_azimuth_deg: known(tile.sun.azimuth_deg),
        sun_elevation_deg: known(tile.sun.elevation_deg),
        network_alone: 0,
        processor_checks: 0,
        image,
        coarse_m: tile.coarse_m.as_ptr(),
        coarse_len: PX,
        valid: std::ptr::null(),
        valid_len: 0,
        posts: std::ptr::null(),
        light: std::ptr::null(),
    }
}

/// As [`through_c`], with a change of the structure.
fn through_c_with(model: &[u8], tile: &Tile, change: impl FnOnce(&mut eld_tile_t)) -> (Made, Vec<u8>) {
    let mut info = eld_model_info_t { struct_bytes: size_of::<eld_model_info_t>() as u32, ..Default::default() };
    let mut c = c_tile(tile);
    change(&mut c);
    let (mut heights_m, mut valid) = (vec![0.0; PX], vec![7; PX]);
    let (mut height_m, mut slope, mut origin) = (vec![0.0; PX], vec![0.0; PX], vec![7; PX]);
    let mut errors = eld_errors_t { struct_bytes: size_of::<eld_errors_t>() as u32, ..Default::default() };
    let mut context = std::ptr::null_mut();
    // SAFETY: buffers of the test, as long as it says.
    unsafe {
        let model_bytes = model.len();
        let model = model.as_ptr().cast();
        assert_eq!(ffi::eld_model_check(model, model_bytes, &raw mut info), ELD_OK);
        let mut memory = vec![0u64; info.memory_bytes.div_ceil(8) as usize];
        let bytes = info.memory_bytes as usize;
        assert_eq!(ffi::eld_init(memory.as_mut_ptr().cast(), bytes, model, model_bytes, &raw mut context), ELD_OK);
        let finish = |call: &mut dyn FnMut() -> eld_status_t| loop {
            match call() {
                ELD_RUNNING => {}
                status => break assert!(worked(status), "{:?}", text(status)),
            }
        };
        finish(&mut || ffi::eld_begin_step(context, &raw const c, 3_000_000));
        finish(&mut || ffi::eld_step(context, 50_000_000));
        assert_eq!(ffi::eld_output(context, heights_m.as_mut_ptr(), PX, valid.as_mut_ptr(), PX), ELD_OK);
        assert_eq!(ffi::eld_errors(context, &raw mut errors), ELD_OK);
        let maps = (height_m.as_mut_ptr(), slope.as_mut_ptr(), origin.as_mut_ptr());
        assert_eq!(ffi::eld_error_maps(context, maps.0, maps.1, maps.2, PX), ELD_OK);
        drop(memory);
    }
    let found = (height_m, slope);
    let eld_errors_t { height_m, slope, explained, dark_height_m, dark_slope, dark_below, .. } = errors;
    let expected = ExpectedErrors::from_values([height_m, slope, explained, dark_height_m, dark_slope, dark_below]);
    let mut made = Made::of_tile(tile, heights_m, valid.iter().map(|v| *v == 1).collect(), expected);
    for (errors, (height_m, slope)) in made.errors.iter_mut().zip(found.0.into_iter().zip(found.1)) {
        (errors[0], errors[1]) = (height_m, slope);
    }
    (made, origin)
}

/// Returns the light that a tile finds itself.
fn own_light(model: Model<'_>, tile: &Tile) -> Lighting {
    let (rules, mut arena) = (model.input_rules(), vec![0; required(&model)]);
    let (mut coarse, mut valid) = (vec![0.0; PX], vec![0; TileMemory::valid_len(SHAPE)]);
    let mut scratch = vec![0.0; TileMemory::scratch_len(&rules, SHAPE)];
    let mut lines = vec![0.0; TileMemory::lines_len(SHAPE)];
    let mut memory = TileMemory { coarse_m: &mut coarse, valid: &mut valid, scratch: &mut scratch, lines: &mut lines };
    let light = TileLight::Own(tile.sun);
    let input = TileInput { image: &tile.image[..], coarse_m: &tile.coarse_m[..], inside: SHAPE, light };
    let mut runner = Runner::new(model, &mut arena).unwrap();
    let mut job = TileJob::new(RULES, rules, SHAPE);
    assert_eq!(job.prepare(&mut runner, &input, &mut memory, u64::MAX).unwrap(), Progress::Done);
    job.lighting()
}

/// Returns the light of a scene of which only this tile was surveyed.
fn surveyed(model: Model<'_>, tile: &Tile) -> Lighting {
    let rules = model.input_rules();
    let (mut coarse, mut valid) = (vec![0.0; PX], vec![0; TileMemory::valid_len(SHAPE)]);
    let mut scratch = vec![0.0; TileMemory::scratch_len(&rules, SHAPE)];
    let mut lines = vec![0.0; TileMemory::lines_len(SHAPE)];
    let mut memory = TileMemory { coarse_m: &mut coarse, valid: &mut valid, scratch: &mut scratch, lines: &mut lines };
    let (image, coarse_m, light) = (&tile.image[..], &tile.coarse_m[..], TileLight::default());
    let mut job = TileJob::new(RULES, rules, SHAPE);
    let input = TileInput { image, coarse_m, inside: SHAPE, light };
    assert_eq!(job.survey(&input, &mut memory, u64::MAX).unwrap(), Progress::Done);
    job.shown().decide(model.illumination(), tile.sun)
}

/// Makes a tile as a strip of one tile.
fn as_strip(model: Model<'_>, tile: &Tile, light: Lighting) -> (Made, Vec<u8>) {
    let settings = StripSettings {
        cols: SHAPE.cols,
        ring_lines: StripPlan::least_lines(&model),
        overlap_px: 32,
        pixel_m: RULES.pixel_m,
        coarse_px: RULES.coarse_px,
        anchor: RULES.anchor,
        checked: false,
        light,
        pixels: PixelForm::F32,
        posts: None,
        expected_errors: true,
    };
    let plan = StripPlan::new(&model, settings).unwrap();
    let (mut arena, mut bits) = (vec![0; plan.arena_bytes()], vec![0; plan.bytes_len()]);
    let (mut samples, mut sums) = (vec![0.0; plan.samples_len()], vec![0.0; plan.sums_len()]);
    let memory = StripMemory { samples: &mut samples, sums: &mut sums, bytes: &mut bits };
    let mut strip = Strip::new(plan, Runner::new(model, &mut arena).unwrap(), memory).unwrap();
    let mut made = Made { heights_m: Vec::new(), valid: Vec::new(), errors: Vec::new() };
    let (mut line_m, mut height_m, mut slope) = (vec![0.0; SHAPE.cols], vec![0.0; SHAPE.cols], vec![0.0; SHAPE.cols]);
    let (mut origin, mut origins) = (vec![0; SHAPE.cols], Vec::new());
    for (image, coarse_m) in tile.image.chunks(SHAPE.cols).zip(tile.coarse_m.chunks(SHAPE.cols)) {
        strip.push_line(image, coarse_m).unwrap();
    }
    strip.finish();
    while strip.wants() != Next::Done {
        strip.step(1 << 22);
        loop {
            let errors = LineErrors { height_m: &mut height_m, slope: &mut slope, origin: &mut origin };
            if strip.take_line_with(&mut line_m, errors).unwrap().is_none() {
                break;
            }
            made.heights_m.extend(&line_m);
            made.valid.extend(line_m.iter().map(|z| !z.is_nan()));
            made.errors.extend(height_m.iter().zip(&slope).map(|(z, s)| [*z, *s, 0.0, 0.0]));
            origins.extend(&origin);
        }
    }
    assert_eq!((strip.counters().last_fault, made.heights_m.len()), (None, PX));
    (made, origins)
}

/// Returns a raster whose first pixel begins at (x, y), of square pixels.
fn raster(shape: Shape, samples: &[f32], (x, y): (f64, f64), side_m: f64) -> Raster {
    let georef = GeoRef {
        transform: [x, side_m, 0.0, y, 0.0, -side_m],
        crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0),
    };
    Raster { rows: shape.rows, cols: shape.cols, samples: samples.to_vec(), georef: Some(georef) }
}

fn image_raster(tile: &Tile) -> Raster {
    raster(SHAPE, &tile.image, (0.0, 0.0), RULES.pixel_m.into())
}

/// Makes a tile as a scene of its size; returns it with the light that the scene was made with.
fn as_scene(path: &std::path::Path, tile: &Tile) -> (Made, Lighting) {
    let coarse = raster(SHAPE, &tile.coarse_m, (0.0, 0.0), RULES.pixel_m.into());
    let mut scene =
        Scene::new(NamedRaster::in_memory("image", image_raster(tile)), NamedRaster::in_memory("coarse DTM", coarse))
            .unwrap();
    scene.coarse_px = RULES.coarse_px;
    predicted(path, &scene, tile)
}

fn predicted(path: &std::path::Path, scene: &Scene, tile: &Tile) -> (Made, Lighting) {
    let model = int8::open(path).unwrap();
    let overlap_px = PredictOptions::overlap_for(SHAPE);
    let options = PredictOptions {
        overlap_px,
        anchor: RULES.anchor,
        sun: tile.sun,
        expected_errors: true,
        ..PredictOptions::default()
    };
    let light = scene.light_for(model.model().illumination(), tile.sun).unwrap().whole;
    let mut rows = Vec::new();
    let keep = &mut |row: &[f32]| {
        rows.push(row.to_vec());
        Ok(())
    };
    predict_rows(scene, &model, &options, 0, keep, &mut |_, _| ControlFlow::Continue(())).unwrap();
    let mut made = Made { heights_m: Vec::new(), valid: Vec::new(), errors: Vec::new() };
    for row in rows.iter().flat_map(|rows| rows.chunks(5 * SHAPE.cols)) {
        let maps: Vec<&[f32]> = row.chunks(SHAPE.cols).collect();
        made.heights_m.extend(maps[0]);
        made.valid.extend(maps[0].iter().map(|z| !z.is_nan()));
        made.errors.extend((0..SHAPE.cols).map(|col| [1, 2, 3, 4].map(|map: usize| maps[map][col])));
    }
    (made, light)
}

/// Compares two results bit for bit, of the errors the first `errors` at valid pixels.
fn compare(what: &str, found: &Made, expected: &Made, errors: usize) {
    assert!(found.valid == expected.valid, "{what}: validity");
    let differ = |i: &usize| found.valid[*i] && found.heights_m[*i].to_bits() != expected.heights_m[*i].to_bits();
    let count = (0..PX).filter(differ).count();
    assert_eq!(count, 0, "{what}: heights differ");
    for i in (0..PX).filter(|i| found.valid[*i]) {
        let (a, b) = (found.errors[i], expected.errors[i]);
        let same = a.iter().zip(&b).take(errors).all(|(a, b)| a.to_bits() == b.to_bits());
        assert!(same, "{what}: errors of pixel {i}: {a:?}, {b:?}");
    }
}

#[test]
fn posts_make_the_bytes_of_a_scene() {
    let path = repository().join("host-train/models/nano.eld");
    let bytes = std::fs::read(&path).unwrap();
    let (tile, shape) = (golden(), Shape::new(11, 13));
    let posts_m: Vec<f32> = (0..shape.pixels()).map(|i| -1900.0 + (i * 7919 % 97) as f32).collect();
    let coarse = raster(shape, &posts_m, (-47.0, 31.0), 59.225);
    let transform = |raster: &Raster| raster.georef.as_ref().unwrap().transform;
    let map = PixelMap::between(&transform(&image_raster(&tile)), &transform(&coarse)).unwrap();
    let posts = eld_posts_t {
        posts_m: posts_m.as_ptr(),
        posts_len: posts_m.len(),
        cols: shape.cols,
        row0: map.row0,
        rows_per_line: map.row_per_row,
        col0: map.col0,
        cols_per_px: map.col_per_col,
    };
    let scene =
        Scene::new(NamedRaster::in_memory("image", image_raster(&tile)), NamedRaster::in_memory("coarse DTM", coarse))
            .unwrap();
    let (expected, _) = predicted(&path, &scene, &tile);
    let (found, _) = through_c_with(&bytes, &tile, |c| {
        (c.coarse_m, c.coarse_len, c.coarse_px) = (std::ptr::null(), 0, scene.coarse_px);
        c.posts = &raw const posts;
    });
    assert!(found.valid.iter().filter(|valid| **valid).count() > PX / 2);
    compare("posts", &expected, &found, 2);
}

#[test]
fn c_strip_and_scene_make_the_same_bytes() {
    let path = repository().join("host-train/models/nano.eld");
    let bytes = std::fs::read(&path).unwrap();
    let mut sources = Vec::new();
    for tile in tiles() {
        let (expected, of_c) = through_c(&bytes, &tile);
        let valid = expected.valid.iter().filter(|valid| **valid).count();
        assert!(valid > PX / 2, "{}: {valid} pixels", tile.what);
        let light = own_light(Model::new(&bytes).unwrap(), &tile);
        sources.push(light.source);
        let (strip, origins) = as_strip(Model::new(&bytes).unwrap(), &tile, light);
        compare(&format!("{}, strip", tile.what), &strip, &expected, 2);
        assert!(origins == of_c, "{}: origins of C and of the strip", tile.what);
        for (i, origin) in origins.iter().enumerate().filter(|(i, _)| expected.valid[*i]) {
            let [.., explained, dark] = expected.errors[i];
            assert_eq!(*origin, Origin::of(explained, dark) as u8, "{}: pixel {i}", tile.what);
        }
        let (scene, of_scene) = as_scene(&path, &tile);
        assert_eq!(light, of_scene, "{}", tile.what);
        assert_eq!(surveyed(Model::new(&bytes).unwrap(), &tile), of_scene, "{}: survey of its only tile", tile.what);
        compare(&format!("{}, scene", tile.what), &scene, &expected, 4);
    }
    use LightSource::{Assumed, Fitted, Given};
    assert_eq!(sources, [Given, Given, Fitted, Given, Given, Assumed]);
}
