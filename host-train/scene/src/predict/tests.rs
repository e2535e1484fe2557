//! Networks with known output, on scenes with every kind of edge.

use super::network::{TileModel, TileNetwork};
use super::run::{Cut, TileMaker, make_rows};
use super::span::Span;
use super::tile::{Rules, TileWorker};
use super::*;
use elunar_base::{Error, Result};
use elunar_core::nn::{Illumination, InputRules, TruthRange};
use elunar_core::sun::Body;
use elunar_core::tile::Shape;
use elunar_raster::{Crs, GeoRef, Raster};
use std::ops::ControlFlow;

/// Tile of the networks below.
const TILE: Shape = Shape::new(64, 80);

/// Returns its coarse input, bit for bit, or raised by a constant.
struct Identity {
    tile: Shape,
    range_margin: f32,
    raised: f32,
}

impl Identity {
    fn new(tile: Shape, range_margin: f32) -> Self {
        Self { tile, range_margin, raised: 0.0 }
    }
}

impl TileModel for Identity {
    fn tile(&self) -> Shape {
        self.tile
    }
    fn input_rules(&self) -> InputRules {
        InputRules {
            nr: 50.0,
            range_margin: self.range_margin,
            truth_range: TruthRange::Reference,
            illumination: Illumination::Any,
        }
    }
    fn description(&self) -> String {
        "identity".into()
    }
    fn worker(&self) -> Result<Box<dyn TileNetwork + '_>> {
        Ok(Box::new(Copy { raised: self.raised }))
    }
}

struct Copy {
    raised: f32,
}

impl TileNetwork for Copy {
    fn predict(&mut self, image: &[f32], coarse: &[f32], output: &mut [f32]) -> Result<()> {
        assert!(image.iter().all(|v| (0.0..=1.0).contains(v)) && coarse.iter().all(|v| (0.0..=50.0).contains(v)));
        output.iter_mut().zip(coarse).for_each(|(z, c)| *z = c + self.raised);
        Ok(())
    }
}

/// Recognises a tile by its normalised image and returns its true heights, normalised.
struct Truth {
    tile: Shape,
    answers: Vec<Answer>,
}

struct Answer {
    image: Vec<f32>,
    heights: Vec<f32>,
}

impl TileModel for Truth {
    fn tile(&self) -> Shape {
        self.tile
    }
    fn input_rules(&self) -> InputRules {
        InputRules { nr: 50.0, range_margin: 0.1, truth_range: TruthRange::Reference, illumination: Illumination::Any }
    }
    fn description(&self) -> String {
        "truth".into()
    }
    fn worker(&self) -> Result<Box<dyn TileNetwork + '_>> {
        Ok(Box::new(Oracle { answers: &self.answers }))
    }
}

struct Oracle<'a> {
    answers: &'a [Answer],
}

impl TileNetwork for Oracle<'_> {
    fn predict(&mut self, image: &[f32], _coarse: &[f32], output: &mut [f32]) -> Result<()> {
        let answer = self.answers.iter().find(|answer| answer.image == image).expect("a tile of this scene");
        output.copy_from_slice(&answer.heights);
        Ok(())
    }
}

pub(super) fn place(origin: (f64, f64), pixel_m: f64) -> Option<GeoRef> {
    let transform = [origin.0, pixel_m, 0.0, origin.1, 0.0, -pixel_m];
    Some(GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0) })
}

fn hills(x: f64, y: f64) -> f64 {
    -1900.0 + 40.0 * (x / 300.0).sin() * (y / 250.0).cos() + 6.0 * (x / 12.0).cos() + 0.01 * x
}

/// Returns a raster of [`hills`].
fn terrain(rows: usize, cols: usize, origin: (f64, f64), pixel_m: f64) -> Raster {
    let georef = place(origin, pixel_m);
    let height = |i: usize| {
        let (x, y) = georef.as_ref().unwrap().centre((i / cols) as f64, (i % cols) as f64);
        hills(x, y) as f32
    };
    Raster { rows, cols, samples: (0..rows * cols).map(height).collect(), georef: georef.clone() }
}

fn image(rows: usize, cols: usize) -> Raster {
    let samples = (0..rows * cols).map(|i| 100.0 + ((i * 7919) % 251) as f32).collect();
    Raster { rows, cols, samples, georef: place((1000.0, 2000.0), 2.0) }
}

fn coarse() -> Raster {
    terrain(30, 40, (900.0, 2100.0), 60.0)
}

pub(super) fn silent(_: usize, _: usize) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn scene(image: &Raster, coarse: &Raster) -> Scene {
    Scene::new(NamedRaster::in_memory("image", image.clone()), NamedRaster::in_memory("coarse DTM", coarse.clone()))
        .unwrap()
}

fn whole(scene: &Scene) -> scene::Band {
    scene.band(0, scene.rows).unwrap()
}

fn options(overlap_px: usize, threads: usize) -> PredictOptions {
    PredictOptions { overlap_px, threads, ..PredictOptions::default() }
}

/// Without an anchor, an identity network returns the coarse heights. With one their long waves grow, until means over coarse pixels are those
/// of the coarse DTM.
fn unanchored(overlap_px: usize, threads: usize) -> PredictOptions {
    PredictOptions { anchor: false, ..options(overlap_px, threads) }
}

#[test]
fn an_identity_network_returns_the_interpolated_coarse_dtm() {
    for (rows, cols, tile, overlap) in
        [(200, 300, TILE, 20), (64, 80, TILE, 20), (300, 50, TILE, 0), (33, 21, TILE, 30)]
    {
        for range_margin in [0.0, 0.1] {
            let scene = scene(&image(rows, cols), &coarse());
            let model = Identity::new(tile, range_margin);
            let made = predict(&scene, &model, &unanchored(overlap, 2), &mut silent).unwrap();
            assert_eq!((made.dtm.rows, made.dtm.cols, &made.dtm.georef), (rows, cols, &Some(scene.georef.clone())));
            for (found, expected) in made.dtm.samples.iter().zip(&whole(&scene).coarse_m) {
                assert!((found - expected).abs() < 1e-3, "{rows} x {cols}: {found} {expected}");
            }
            assert_eq!((made.tally.tiles_coarse, made.tally.tiles_empty), (0, 0));
        }
    }
}

#[test]
fn a_network_that_knows_the_truth_returns_it() {
    use elunar_core::norm::{ElevationScale, intensity};
    use elunar_core::tile::Tiling;
    let truth = terrain(200, 260, (1000.0, 2000.0), 2.0);
    let tile = TILE;
    let scene = scene(&image(200, 260), &coarse());
    let mut answers = Vec::new();
    for window in Tiling::new(Shape::new(200, 260), tile, 24).unwrap().iter() {
        let cut = |layer: &[f32]| -> Vec<f32> {
            (0..64 * 80).map(|i| layer[(window.row + i / 80) * 260 + window.col + i % 80]).collect()
        };
        let scale =
            ElevationScale::from_heights(&cut(&whole(&scene).coarse_m), None, 50.0).unwrap().with_margin(0.1).unwrap();
        let (mut key, mut answer) = (vec![0.0; 64 * 80], vec![0.0; 64 * 80]);
        intensity::normalise(&cut(&whole(&scene).image), None, &mut key).unwrap();
        scale.normalise(&cut(&truth.samples), &mut answer).unwrap();
        answers.push(Answer { image: key, heights: answer });
    }
    let free = PredictOptions { anchor: false, ..options(24, 2) };
    let made = predict(&scene, &Truth { tile, answers }, &free, &mut silent).unwrap();
    for (found, expected) in made.dtm.samples.iter().zip(&truth.samples) {
        assert!((found - expected).abs() < 1e-3, "{found} {expected}");
    }
    let away = made.dtm.samples.iter().zip(&whole(&scene).coarse_m).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(away > 1.0, "the truth is not the coarse DTM: {away} m");
}

#[test]
fn of_what_the_coarse_dtm_knows_a_network_changes_little() {
    let scene = scene(&image(100, 120), &coarse());
    let raised = Identity { raised: 3.0, ..Identity::new(TILE, 0.1) };
    let offset_m = |anchor| {
        let made = predict(&scene, &raised, &PredictOptions { anchor, ..options(20, 1) }, &mut silent).unwrap();
        made.dtm.samples.iter().zip(&whole(&scene).coarse_m).map(|(z, c)| (z - c).abs()).fold(0.0, f32::max)
    };
    // 0.3 of the network's long waves remain.
    assert!(offset_m(true) < 0.5 * offset_m(false), "{}", offset_m(true));
    assert!(offset_m(false) > 0.5, "{}", offset_m(false));
}

#[test]
fn gaps_of_either_input_stay_gaps_and_nothing_else_does() {
    let mut image = image(150, 170);
    for i in [0, 5, 170 * 80 + 60, 170 * 80 + 61, 150 * 170 - 1] {
        image.samples[i] = f32::NAN;
    }
    let mut coarse = coarse();
    coarse.samples[40 * 3 + 4] = f32::NAN;
    let scene = scene(&image, &coarse);
    let made = predict(&scene, &Identity::new(TILE, 0.0), &unanchored(20, 2), &mut silent).unwrap();
    let band = whole(&scene);
    let (valid, coarse_m) = (band.valid().collect::<Vec<bool>>(), band.coarse_m);
    let gaps = valid.iter().filter(|v| !**v).count();
    assert!(gaps > 500, "a coarse gap is many pixels wide: {gaps}");
    for (i, z) in made.dtm.samples.iter().enumerate() {
        assert_eq!(z.is_finite(), valid[i], "{i}");
        assert!(!valid[i] || (z - coarse_m[i]).abs() < 1e-3);
    }
    assert_eq!(scene.coarse_raster().unwrap().valid_count(), 150 * 170 - gaps);
}

#[test]
fn tiles_with_nothing_to_see_keep_the_coarse_heights() {
    let mut image = image(200, 80);
    image.samples[..100 * 80].fill(7.0);
    image.samples[150 * 80..].fill(f32::NAN);
    let scene = scene(&image, &coarse());
    let made = predict(&scene, &Identity::new(Shape::new(40, 80), 0.0), &unanchored(0, 1), &mut silent).unwrap();
    assert_eq!((made.tally.tiles, made.tally.tiles_coarse, made.tally.tiles_empty), (5, 2, 1));
    assert_eq!(made.dtm.valid_count(), 150 * 80);
    let coarse_m = whole(&scene).coarse_m;
    for (found, expected) in made.dtm.samples.iter().zip(&coarse_m).take(150 * 80) {
        assert!((found - expected).abs() < 1e-3);
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let scene = scene(&image(300, 330), &coarse());
    let model = Identity::new(TILE, 0.1);
    let one = predict(&scene, &model, &options(30, 1), &mut silent).unwrap();
    for threads in [2, 3, 16] {
        let many = predict(&scene, &model, &options(30, threads), &mut silent).unwrap();
        assert!(one.dtm.samples.iter().zip(&many.dtm.samples).all(|(a, b)| a.to_bits() == b.to_bits()), "{threads}");
    }
}

#[test]
fn without_threads_the_rows_are_the_same() {
    let scene = scene(&image(300, 330), &coarse());
    let (model, options) = (Identity::new(TILE, 0.1), options(30, 2));
    let light = || scene.light_for(Illumination::Any, options.sun).unwrap();
    let rules = Rules::new(&model, light(), &scene, &options);
    let makers = || -> Result<Box<dyn TileMaker + '_>> {
        Ok(Box::new(TileWorker::new(model.worker()?, model.tile(), rules.clone())))
    };
    let span = Span { rows: 0..300, from: 0 };
    let (mut rows, mut seen) = (vec![], 0);
    let mut keep = |more: &[f32]| {
        rows.extend_from_slice(more);
        Ok(())
    };
    let mut count = |done: usize, _: usize| {
        seen = done;
        ControlFlow::Continue(())
    };
    let alone = Cut { alone: true, ..Cut::new(TILE, 30, 2, 1) };
    let tally = make_rows(&scene, alone, &makers, &span, &mut keep, &mut count).unwrap();
    let expected = predict(&scene, &model, &options, &mut silent).unwrap();
    assert!(rows.iter().zip(&expected.dtm.samples).all(|(a, b)| a.to_bits() == b.to_bits()));
    assert_eq!((rows.len(), seen, tally.tiles), (300 * 330, tally.tiles, expected.tally.tiles));
}

#[test]
fn a_run_can_be_stopped_and_counts_its_tiles() {
    let scene = scene(&image(300, 330), &coarse());
    let model = Identity::new(TILE, 0.1);
    let mut seen = Vec::new();
    predict(&scene, &model, &options(30, 2), &mut |done, all| {
        seen.push((done, all));
        ControlFlow::Continue(())
    })
    .unwrap();
    assert_eq!(seen, (0..seen.len()).map(|done| (done, seen.len() - 1)).collect::<Vec<_>>());
    let mut stop = |done: usize, _: usize| if done == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let error = predict(&scene, &model, &options(30, 2), &mut stop).unwrap_err().to_string();
    assert!(error.contains("stopped after 3 of"), "{error}");
}

/// A band takes the rows that it shares with the one before from it, and reads the others.
#[test]
fn a_band_after_another_is_the_band() {
    let scene = scene(&image(90, 70), &coarse());
    let bits = |band: &scene::Band| {
        let maps = band.image.iter().chain(&band.coarse_m).map(|v| v.to_bits()).collect::<Vec<_>>();
        (band.first, band.rows, band.cols, maps)
    };
    let before = scene.band(10, 30).unwrap();
    // Overlapping, the same, inside it, behind it, and above it.
    for (first, rows) in [(25, 30), (39, 51), (10, 30), (12, 5), (40, 20), (70, 20), (0, 30)] {
        let (after, alone) = (scene.band_after(Some(&before), first, rows).unwrap(), scene.band(first, rows).unwrap());
        assert_eq!(bits(&after), bits(&alone), "{first} {rows}");
    }
}

#[test]
fn a_survey_can_be_stopped_between_its_blocks() {
    let scene = scene(&image(2000, 330), &coarse());
    let mut seen = vec![];
    let survey = scene.survey_with(&mut |done, all| {
        seen.push((done, all));
        ControlFlow::Continue(())
    });
    assert_eq!((survey.unwrap(), seen), (scene.survey().unwrap(), vec![(0, 3), (1, 3), (2, 3)]));
    let mut stop = |done: usize, _: usize| if done == 1 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let error = scene.survey_with(&mut stop).unwrap_err();
    assert!(matches!(&error, Error::Stopped(what) if what.contains("after 1 of 3 blocks")), "{error}");
}

/// Fails in each way that a model can fail.
struct Faulty {
    /// What every output is; `None` if there is not even a worker.
    output: Option<f32>,
}

impl TileModel for Faulty {
    fn tile(&self) -> Shape {
        TILE
    }
    fn input_rules(&self) -> InputRules {
        InputRules { nr: 50.0, range_margin: 0.0, truth_range: TruthRange::Own, illumination: Illumination::Any }
    }
    fn description(&self) -> String {
        "faulty".into()
    }
    fn worker(&self) -> Result<Box<dyn TileNetwork + '_>> {
        let always = self.output.map(Always).ok_or_else(|| Error::input("no memory for a worker"))?;
        Ok(Box::new(always))
    }
}

struct Always(f32);

impl TileNetwork for Always {
    fn predict(&mut self, _: &[f32], _: &[f32], output: &mut [f32]) -> Result<()> {
        output.fill(self.0);
        Ok(())
    }
}

#[test]
fn faults_of_the_model_end_the_run_with_one_error() {
    let scene = scene(&image(300, 330), &coarse());
    let refused = |output| predict(&scene, &Faulty { output }, &options(30, 3), &mut silent).unwrap_err().to_string();
    assert!(refused(None).contains("no memory for a worker"));
    // The model is named by its description, which has the file and its hash.
    for output in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e23, -1e23] {
        let error = refused(Some(output));
        assert!(error.starts_with("faulty: heights of ") && error.contains("m expected in the tile at row"), "{error}");
    }
    let error = predict(&scene, &Identity::new(TILE, 0.0), &options(64, 1), &mut silent).unwrap_err();
    assert!(error.to_string().contains("overlap"), "{error}");
}

#[test]
fn a_run_begun_anew_at_any_row_makes_the_same_rows() {
    let scene = scene(&image(300, 330), &coarse());
    let model = Identity::new(TILE, 0.1);
    let whole = predict(&scene, &model, &options(30, 2), &mut silent).unwrap();
    for from in [1, 63, 64, 150, 299] {
        let mut rows = vec![];
        let mut keep = |more: &[f32]| {
            rows.extend_from_slice(more);
            Ok(())
        };
        let tally = predict_rows(&scene, &model, &options(30, 2), from, &mut keep, &mut silent).unwrap();
        let expected = &whole.dtm.samples[from * 330..];
        assert!(rows.len() == expected.len() && rows.iter().zip(expected).all(|(a, b)| a.to_bits() == b.to_bits()));
        assert_eq!(tally.tiles_before > 0, from >= 64, "row {from}: {tally:?}");
    }
}

#[test]
fn inputs_that_do_not_meet_are_refused() {
    let refused = |image: &Raster, coarse: &Raster| {
        let pair =
            Scene::new(NamedRaster::in_memory("i.tif", image.clone()), NamedRaster::in_memory("c.tif", coarse.clone()));
        let made = pair.and_then(|scene| predict(&scene, &Identity::new(TILE, 0.0), &options(20, 2), &mut silent));
        made.unwrap_err().to_string()
    };
    let (mut image, coarse) = (image(20, 20), coarse());
    let text = refused(&image, &terrain(3, 3, (9e5, 0.0), 60.0));
    assert!(text.contains("c.tif") && text.contains("i.tif"), "{text}");
    image.samples.fill(f32::NAN);
    assert!(refused(&image, &coarse).contains("under valid pixels of i.tif"), "{text}");
    image.samples[0] = 5.0;
    let mut partial = terrain(30, 40, (900.0, 2100.0), 60.0);
    let hole = |i: usize| i / 40 < 4 && i % 40 < 4 && i % 40 != 2;
    partial.samples.iter_mut().enumerate().filter(|(i, _)| hole(*i)).for_each(|(_, z)| *z = f32::NAN);
    let text = refused(&image, &partial);
    assert!(text.contains("c.tif"), "{text}");
    let elsewhere = Raster { georef: None, ..coarse };
    assert!(refused(&image, &elsewhere).contains("c.tif: a raster with a geotransform expected"));
}
