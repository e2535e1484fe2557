//! A tile of a scene has the same bytes in training and in prediction, on the ground and in flight.

use elunar_base::Result;
use elunar_base::progress::Bar;
use elunar_core::job::{TileInput, TileJob, TileRules};
use elunar_core::nn::{InputRules, Progress, Runner, TileLight, required};
use elunar_core::norm::{ElevationScale, intensity};
use elunar_core::sun::Body;
use elunar_core::tile::{self, Shape, TILE_COLS, TILE_ROWS};
use elunar_data::prepare::list::SceneFiles;
use elunar_data::prepare::{self, PrepareOptions, Split};
use elunar_data::prepared::PreparedSource;
use elunar_data::sample::{RawTile, Sample};
use elunar_data::source::TileSource;
use elunar_net::config::{Illumination, NetConfig, OutputHead, Preset, TruthRange};
use elunar_net::illumination::{KnownSun, LightSource, Mirror, mirrored};
use elunar_net::job::JobMemory;
use elunar_raster::geotiff::{self, SampleType, WriteOptions};
use elunar_raster::{GeoRef, Raster};
use elunar_scene::predict::network::{TileModel, TileNetwork};
use elunar_scene::predict::{NamedRaster, PredictOptions, Scene, int8, predict};
use elunar_synth::{Moon, SynthOptions};
use elunar_tests::repository;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Mutex;

const SHAPE: Shape = tile::TILE;

/// A network that keeps its input.
struct Recorder {
    rules: InputRules,
    seen: Mutex<Vec<(Vec<f32>, Vec<f32>)>>,
}

/// Returns the recorder's output at a pixel. It does not depend on the input.
fn answer(pixel: usize) -> f32 {
    (pixel % 97) as f32 * 0.3
}

impl TileModel for Recorder {
    fn tile(&self) -> Shape {
        SHAPE
    }
    fn input_rules(&self) -> InputRules {
        self.rules
    }
    fn description(&self) -> String {
        "recorder".into()
    }
    fn worker(&self) -> Result<Box<dyn TileNetwork + '_>> {
        Ok(Box::new(Recording(self)))
    }
}

struct Recording<'a>(&'a Recorder);

impl TileNetwork for Recording<'_> {
    fn predict(&mut self, image: &[f32], coarse: &[f32], output: &mut [f32]) -> Result<()> {
        self.0.seen.lock().unwrap().push((image.to_vec(), coarse.to_vec()));
        output.iter_mut().enumerate().for_each(|(i, z)| *z = answer(i));
        Ok(())
    }
}

fn config(illumination: Illumination, target_range: TruthRange) -> NetConfig {
    let range_margin = if target_range == TruthRange::Reference { 0.1 } else { 0.0 };
    NetConfig {
        head: OutputHead::Residual,
        target_range,
        range_margin,
        illumination,
        ..NetConfig::preset(Preset::Nano)
    }
}

/// Writes a scene of one tile. Returns the scene as prediction reads it, and the training tile that `prepare` makes of it.
fn prepared(folder: &Path, index: u64) -> (Scene, RawTile) {
    let scene = Moon::new(21, SynthOptions::default()).unwrap().scene(index, TILE_ROWS, TILE_COLS).unwrap();
    let path = |what: &str| folder.join(format!("{index}_{what}.tif"));
    let image = WriteOptions::image(SampleType::U16, "image");
    geotiff::write(&path("image"), &scene.image_raster(), &image).unwrap();
    geotiff::write(&path("truth"), &scene.truth_raster(), &WriteOptions::heights("truth")).unwrap();
    geotiff::write(&path("coarse"), &scene.coarse_raster(), &WriteOptions::heights("coarse")).unwrap();
    let files = SceneFiles {
        image: path("image"),
        dtm: path("truth"),
        coarse: path("coarse"),
        site: "site".into(),
        sun_azimuth_deg: Some(scene.sun_azimuth_deg),
        sun_elevation_deg: Some(scene.sun_elevation_deg),
    };
    let out = folder.join(format!("{index}_tiles"));
    let parameters = PrepareOptions { shares: [1.0, 0.0, 0.0], ..PrepareOptions::default() };
    prepare::run(&[files], &out, &parameters, &Bar::hidden()).unwrap();
    let tile = PreparedSource::open(&out, Split::Train).unwrap().tile(0).unwrap();
    let open = |what| NamedRaster::image(&path(what), None, None).unwrap();
    (Scene::new(open("image"), open("coarse")).unwrap(), tile)
}

/// Returns relief under an image that does not fit it: in every direction of the light, bright and dark slopes are equally many.
fn lightless() -> (Scene, RawTile) {
    let georef = |origin: (f64, f64), pixel_m: f64| GeoRef {
        transform: [origin.0, pixel_m, 0.0, origin.1, 0.0, -pixel_m],
        crs: elunar_raster::Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0),
    };
    let raster = |(rows, cols): (usize, usize), georef, sample: &dyn Fn(usize, usize) -> f32| Raster {
        rows,
        cols,
        samples: (0..rows * cols).map(|i| sample(i / cols, i % cols)).collect(),
        georef: Some(georef),
    };
    let image = raster((TILE_ROWS, TILE_COLS), georef((0.0, 0.0), 2.0), &|row, col| 100.0 + ((row + col) % 2) as f32);
    let hills = |row: usize, col: usize| -1900.0 + 30.0 * (row as f32 / 2.0).sin() * (col as f32 / 3.0).cos();
    let coarse = raster((14, 16), georef((-120.0, 120.0), 60.0), &hills);
    let (image, coarse) = (NamedRaster::in_memory("image", image), NamedRaster::in_memory("coarse DTM", coarse));
    let scene = Scene::new(image, coarse).unwrap();
    let band = scene.band(0, TILE_ROWS).unwrap();
    let tile = RawTile {
        rows: TILE_ROWS,
        cols: TILE_COLS,
        pixel_m: scene.pixel_m,
        truth_m: band.coarse_m.iter().enumerate().map(|(i, z)| z + ((i % 7) as f32)).collect(),
        image: band.image,
        coarse_m: band.coarse_m,
        coarse_px: scene.coarse_px,
        sun: KnownSun::default(),
    };
    (scene, tile)
}

/// Returns one scene for each source of light: given, fitted, assumed.
fn scenes(folder: &Path) -> [(Scene, RawTile, LightSource); 3] {
    let (given, fitted, (scene, tile)) = (prepared(folder, 0), prepared(folder, 1), lightless());
    let unknown = RawTile { sun: KnownSun::default(), ..fitted.1 };
    [
        (given.0, given.1, LightSource::Given),
        (fitted.0, unknown, LightSource::Fitted),
        (scene, tile, LightSource::Assumed),
    ]
}

fn assert_same(found: &[f32], expected: &[f32], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let first = found.iter().zip(expected).position(|(a, b)| a.to_bits() != b.to_bits());
    assert_eq!(first.map(|i| (i, found[i], expected[i])), None, "{what}");
}

#[test]
fn training_tiles_are_served_tiles() {
    let folder = tempfile::tempdir().unwrap();
    let (mut mirrored, mut compared) = (0, 0);
    for (scene, tile, source) in scenes(folder.path()) {
        use Illumination::{Any, Given, Northwest, Sloped, Weighed};
        for illumination in [Any, Northwest, Given, Weighed, Sloped] {
            for range in [TruthRange::Own, TruthRange::Reference, TruthRange::Pixel] {
                let what = format!("{illumination:?} {range:?} {source:?}");
                let config = config(illumination, range);
                let sample = Sample::new(&config, &tile).unwrap();
                let model = Recorder { rules: config.input_rules(), seen: Mutex::default() };
                let options = PredictOptions { anchor: false, threads: 1, sun: tile.sun, ..PredictOptions::default() };
                let made = predict(&scene, &model, &options, &mut |_, _| ControlFlow::Continue(())).unwrap();
                let seen = model.seen.into_inner().unwrap();
                let [(image, coarse)] = &seen[..] else { panic!("{what}: {} tiles", seen.len()) };
                assert_same(&sample.image, image, &format!("{what}: image"));
                assert_same(&sample.coarse, coarse, &format!("{what}: coarse DTM"));
                let asked = if illumination == Illumination::Any { LightSource::NotAsked } else { source };
                assert_eq!(made.tally.light.source, asked, "{what}");
                // Scale recovery agrees, too.
                let mut heights_m: Vec<f32> = (0..TILE_ROWS * TILE_COLS).map(answer).collect();
                sample.scale.recover(SHAPE, &mut heights_m);
                if illumination.is_weighed() {
                    made.tally.light.settle(&mut heights_m, &tile.coarse_m);
                }
                assert_same(&made.dtm.samples, &heights_m, &format!("{what}: heights"));
                mirrored += usize::from(!sample.scale.mirror.is_none());
                compared += 1;
            }
        }
    }
    assert_eq!(compared, 45);
    assert!(mirrored >= 6, "{mirrored} tiles mirrored");
}

#[test]
fn the_flight_runner_sees_training_tiles() {
    let nano = int8::open(&repository().join("host-train/models/nano.eld")).unwrap();
    let config = config(Illumination::Sloped, TruthRange::Pixel);
    assert_eq!(config.input_rules(), nano.input_rules());
    let folder = tempfile::tempdir().unwrap();
    for (_, tile, source) in scenes(folder.path()) {
        let sample = Sample::new(&config, &tile).unwrap();
        let mut arena = vec![0; required(&nano.model())];
        let mut runner = Runner::with_kernel(nano.kernel(), nano.model(), &mut arena).unwrap();
        let (mut found_m, mut expected_m) = (vec![0.0; tile.image.len()], vec![0.0; tile.image.len()]);
        let RawTile { image, coarse_m, pixel_m, coarse_px, sun, .. } = &tile;
        let rules = TileRules { pixel_m: *pixel_m, coarse_px: *coarse_px, anchor: false, checked: false };
        let light = TileLight::Own(*sun);
        let input = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: SHAPE, light };
        let (mut memory, mut job) = (JobMemory::default(), TileJob::new(rules, nano.input_rules(), SHAPE));
        let mut memory = memory.lend(&nano.input_rules(), SHAPE);
        while job.prepare(&mut runner, &input, &mut memory, 100_000).unwrap() == Progress::Running {}
        assert_eq!((job.scale(), job.lighting().source), (Some(sample.scale), source));
        while job.run(&mut runner, &mut memory, 100_000_000).unwrap() == Progress::Running {}
        found_m.copy_from_slice(job.heights_m(&memory));
        let lighting = job.lighting();
        runner.begin(&sample.image, &sample.coarse).unwrap();
        while runner.step(u64::MAX).unwrap() == Progress::Running {}
        runner.output(&mut expected_m).unwrap();
        sample.scale.recover(SHAPE, &mut expected_m);
        lighting.settle(&mut expected_m, coarse_m);
        assert_same(&found_m, &expected_m, &format!("{source:?}"));
    }
}

/// Compares with maps that are mirrored first and then normalised, by the paper's equations.
#[test]
fn samples_are_mirrored_and_normalised_maps() {
    let folder = tempfile::tempdir().unwrap();
    for (_, tile, source) in scenes(folder.path()) {
        for illumination in [Illumination::Any, Illumination::Northwest] {
            for range in [TruthRange::Own, TruthRange::Reference] {
                let config = config(illumination, range);
                let sample = Sample::new(&config, &tile).unwrap();
                let mirror = match (illumination, tile.sun.azimuth_deg) {
                    (Illumination::Any, _) => Mirror::default(),
                    (_, Some(azimuth_deg)) => Mirror::from_azimuth_deg(azimuth_deg),
                    // Fitted or assumed.
                    _ => sample.scale.mirror,
                };
                let [image, coarse_m, truth_m] =
                    [&tile.image, &tile.coarse_m, &tile.truth_m].map(|map| mirrored(mirror, map, TILE_COLS));
                let (mut shades, mut coarse, mut truth) =
                    (vec![0.0; image.len()], vec![0.0; image.len()], vec![0.0; image.len()]);
                intensity::normalise(&image, None, &mut shades).unwrap();
                let scale = ElevationScale::from_heights(&coarse_m, None, config.nr).unwrap();
                let scale = scale.with_margin(config.range_margin).unwrap();
                scale.normalise(&coarse_m, &mut coarse).unwrap();
                let of_truth = match range {
                    TruthRange::Own => ElevationScale::from_heights(&truth_m, None, config.nr).unwrap(),
                    _ => scale,
                };
                of_truth.normalise(&truth_m, &mut truth).unwrap();
                let what = format!("{illumination:?} {range:?} {source:?}");
                assert_same(&sample.image, &shades, &format!("{what}: image"));
                assert_same(&sample.coarse, &coarse, &format!("{what}: coarse DTM"));
                assert_same(&sample.truth, &truth, &format!("{what}: truth"));
                assert_eq!((sample.scale.mirror, sample.scale.elevation), (mirror, scale), "{what}");
            }
        }
    }
}
