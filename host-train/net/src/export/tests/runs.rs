//! Budgets, memory, self test and scrubbing of the runner on exported networks.

use super::super::large_steps::{LINE, large_steps};
use super::super::{CompileOptions, MapBits, export};
use super::{CalibrationTile, random_export, random_tile, random_weights, small_config};
use crate::config::{Illumination, NetConfig, OutputHead, TruthRange};
use crate::illumination::{Light, LightSource, Lighting, Mirror, mirrored};
use crate::job::JobMemory;
use crate::shipped;
use elunar_core::job::{Made, TileInput, TileJob, TileRules};
use elunar_core::nn::file::Operator;
use elunar_core::nn::{Kernel, Model, Progress, RunError, Runner, TileLight, required};
use elunar_core::norm::ElevationScale;
use elunar_core::photoclinometry::{Guide, GuideInput, Photoclinometry, Weight};
use elunar_core::tile::Shape;
use std::path::Path;

/// Runs one tile with steps of `budget_macs`, in an arena with arbitrary content.
pub(super) fn run(bytes: &[u8], tile: &CalibrationTile, budget_macs: u64) -> Vec<f32> {
    let model = Model::new(bytes).unwrap();
    let mut arena = vec![0xa5; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    runner.begin(&tile.image, &tile.coarse).unwrap();
    while runner.step(budget_macs).unwrap() == Progress::Running {}
    assert_eq!(runner.telemetry().macs, model.macs());
    let mut out = vec![0.0; tile.coarse.len()];
    runner.output(&mut out).unwrap();
    out
}

#[test]
fn every_step_budget_gives_the_same_bytes() {
    let config = NetConfig { head: OutputHead::Residual, ..small_config() };
    let (made, tile) = random_export(&config, (64, 96), MapBits::Mixed, 3);
    let whole = run(&made.bytes, &tile, u64::MAX);
    assert!(whole.iter().any(|v| *v != whole[0]), "a constant output proves nothing");
    for budget in [0, 1, 777, 50_000, 3_000_000] {
        assert!(run(&made.bytes, &tile, budget) == whole, "budget {budget}");
    }
}

#[test]
fn every_kernel_gives_the_same_bytes() {
    for (tile, precision, seed) in [((64, 96), MapBits::Mixed, 13), ((32, 64), MapBits::Int8, 14)] {
        let (made, tile) = random_export(&small_config(), tile, precision, seed);
        let model = Model::new(&made.bytes).unwrap();
        let mut arena = vec![0; required(&model)];
        let mut crc = |kernel| {
            let mut runner = Runner::with_kernel(kernel, model, &mut arena).unwrap();
            runner.begin(&tile.image, &tile.coarse).unwrap();
            while runner.step(1 << 20).unwrap() == Progress::Running {}
            (runner.output_crc().unwrap(), runner.telemetry())
        };
        let expected = crc(Kernel::SCALAR);
        for kernel in crate::kernels::kernels() {
            assert_eq!(crc(kernel), expected, "{kernel:?}");
        }
    }
}

#[test]
fn a_step_overruns_its_budget_by_less_than_one_unit() {
    let (made, tile) = random_export(&small_config(), (64, 64), MapBits::Mixed, 4);
    let model = Model::new(&made.bytes).unwrap();
    let largest = model.largest_unit();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    runner.begin(&tile.image, &tile.coarse).unwrap();
    let (mut before, mut steps, budget) = (0, 0, 10_000);
    while runner.step(budget).unwrap() == Progress::Running {
        // Products alone; bytes that are compared use the rest of the budget.
        let spent = runner.telemetry().macs - before;
        assert!(spent < budget + largest, "{spent}");
        (before, steps) = (before + spent, steps + 1);
    }
    assert!(steps > model.macs() / (budget + largest), "{steps}");
    // All work in one step, if the budget allows it.
    runner.begin(&tile.image, &tile.coarse).unwrap();
    assert_eq!(runner.step(u64::MAX).unwrap(), Progress::Done);
}

#[test]
fn required_bytes_suffice_and_one_less_does_not() {
    let (made, _) = random_export(&small_config(), (32, 64), MapBits::Int8, 5);
    let model = Model::new(&made.bytes).unwrap();
    let needed = required(&model);
    let mut arena = vec![0; needed];
    assert!(Runner::new(model, &mut arena).is_ok());
    let refused = Runner::new(model, &mut arena[1..]).unwrap_err();
    assert_eq!(refused, RunError::ArenaTooSmall { required: needed, found: needed - 1 });
}

#[test]
fn metres_come_out_as_by_way_of_buffers() {
    let config = NetConfig { head: OutputHead::Residual, range_margin: 0.1, ..small_config() };
    let (made, tile) = random_export(&config, (32, 64), MapBits::Mixed, 9);
    let brightness: Vec<f32> = tile.image.iter().map(|v| 200.0 + 900.0 * v).collect();
    let mut coarse_m: Vec<f32> = tile.coarse.iter().map(|z| -1800.0 + 1.3 * z).collect();
    coarse_m[100] = f32::NAN;
    let n = brightness.len();
    let model = Model::new(&made.bytes).unwrap();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    let light = TileLight::default();
    let input = TileInput { image: &brightness[..], coarse_m: &coarse_m[..], inside: model.tile(), light };
    let (job, heights_m, filled_m) = by_job(&mut runner, &input);
    assert_eq!((job.made(), job.lighting().source), (Some(Made::Predicted), LightSource::NotAsked));
    let scale = job.scale().unwrap();
    assert_eq!(job.valid_px(), n - 1);

    let (mut image, mut coarse, mut expected_m) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    elunar_core::norm::intensity::normalise(&brightness, None, &mut image).unwrap();
    scale.elevation.normalise(&filled_m, &mut coarse).unwrap();
    let normalised = CalibrationTile { image, coarse, ground: None };
    scale.elevation.recover(&run(&made.bytes, &normalised, u64::MAX), &mut expected_m).unwrap();
    assert_eq!(heights_m, expected_m);
    let constant = vec![3.0; n];
    let (job, kept_m, filled_m) = by_job(&mut runner, &TileInput { image: &constant[..], ..input });
    assert_eq!((job.made(), kept_m), (Some(Made::Coarse), filled_m));
}

/// Makes a tile of which the network alone decides; returns its heights and its filled coarse heights.
fn by_job(runner: &mut Runner<'_, '_>, tile: &TileInput<&[f32], &[f32]>) -> (TileJob, Vec<f32>, Vec<f32>) {
    let (rules, shape, mut memory) = (runner.model().input_rules(), runner.model().tile(), JobMemory::default());
    let mut memory = memory.lend(&rules, shape);
    let mut job =
        TileJob::new(TileRules { pixel_m: 2.0, coarse_px: 30.0, anchor: false, checked: false }, rules, shape);
    while job.prepare(runner, tile, &mut memory, u64::MAX).unwrap() == Progress::Running {}
    while job.run(runner, &mut memory, u64::MAX).unwrap() == Progress::Running {}
    (job, job.heights_m(&memory).to_vec(), memory.coarse_m.to_vec())
}

#[test]
fn guided_tiles_are_mirrored_into_the_models_light_and_back() {
    guided(Illumination::Given, Weight::Plain);
    guided(Illumination::Weighed, Weight::Trust { trust: 1.0, long_share: None });
    guided(Illumination::Sloped, Weight::Trust { trust: 1.0, long_share: None });
}

/// Compares a model's heights with those of a network that is given the maps of a guide.
fn guided(illumination: Illumination, weight: Weight) {
    let config =
        NetConfig { head: OutputHead::Residual, target_range: TruthRange::Pixel, illumination, ..small_config() };
    let shape = (32, 64);
    let random = random_tile(shape.0, shape.1, 11);
    let brightness: Vec<f32> = random.image.iter().map(|v| 200.0 + 900.0 * v).collect();
    let coarse_m: Vec<f32> = random.coarse.iter().map(|z| -1800.0 + 1.3 * z).collect();
    // The Sun is in the south-east.
    let light = Light::from_sun(140.0, 35.0).unwrap();
    let mirror = Mirror { rows: true, cols: true };
    let (image, heights) = (mirrored(mirror, &brightness, shape.1), mirrored(mirror, &coarse_m, shape.1));
    let scale = ElevationScale::from_pixel(&heights, None, 2.0, config.nr).unwrap();
    let plan = Photoclinometry::new(Shape::new(shape.0, shape.1));
    let mut scratch = vec![0.0; plan.scratch_len()];
    let unmirrored = Mirror::default();
    let tile = GuideInput { image: &image[..], coarse_m: &heights, mirror: unmirrored, coarse_px: 30.0, weight };
    let guide = Guide::new(&plan, tile, &scale, light.mirrored(mirror), &mut scratch).unwrap();
    let (mut maps, mut pixels) = (vec![0.0; illumination.image_maps() * image.len()], vec![0.0; heights.len()]);
    if illumination == Illumination::Sloped {
        guide.fill_sloped(&mut maps, &mut pixels).unwrap();
    } else {
        guide.fill(&mut maps, &mut pixels).unwrap();
    }
    let tile = CalibrationTile { image: maps, coarse: pixels, ground: None };
    let options = CompileOptions { tile: shape, precision: MapBits::Mixed, name: "given".into() };
    let weights = random_weights(&config, 12);
    let made = export(&config, &weights, Path::new("given"), std::slice::from_ref(&tile), &options, |_| {}).unwrap();
    let mut expected_m = vec![0.0; heights.len()];
    scale.recover(&run(&made.bytes, &tile, u64::MAX), &mut expected_m).unwrap();

    let model = Model::new(&made.bytes).unwrap();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    let (image, light) = (brightness.as_slice(), TileLight::Scene(Lighting::given(light)));
    let input = TileInput { image, coarse_m: &coarse_m[..], inside: model.tile(), light };
    let (job, heights_m, _) = by_job(&mut runner, &input);
    assert_eq!((job.lighting().mirror(), job.lighting().source), (mirror, LightSource::Given));
    assert_eq!(heights_m, mirrored(mirror, &expected_m, shape.1));
    let level = vec![5.0; heights_m.len()];
    let dark = TileInput { coarse_m: &level[..], light: TileLight::default(), ..input };
    let (job, ..) = by_job(&mut runner, &dark);
    assert_eq!((job.lighting().mirror(), job.lighting().source), (Mirror::default(), LightSource::Assumed));
    assert_eq!(
        runner.begin(&brightness, &tile.coarse),
        Err(RunError::TileSize { expected: illumination.image_maps() * 2048, found: 2048 })
    );
}

#[test]
fn misuse_is_refused() {
    let (made, tile) = random_export(&small_config(), (32, 32), MapBits::Int8, 6);
    let model = Model::new(&made.bytes).unwrap();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    let mut out = vec![0.0; 32 * 32];
    assert_eq!(runner.step(1), Err(RunError::State));
    assert_eq!(runner.output(&mut out), Err(RunError::State));
    assert_eq!(runner.begin(&tile.image[1..], &tile.coarse), Err(RunError::TileSize { expected: 1024, found: 1023 }));
    let mut holed = tile.image.clone();
    holed[7] = f32::NAN;
    assert_eq!(runner.begin(&holed, &tile.coarse), Err(RunError::NotFinite { index: 7 }));
    assert_eq!(runner.step(1), Err(RunError::State));
}

#[test]
fn self_test_passes_and_notices_a_changed_model() {
    let (made, _) = random_export(&small_config(), (64, 64), MapBits::Mixed, 7);
    let check = |bytes: &[u8]| {
        let model = Model::new(bytes).unwrap();
        let mut arena = vec![0; required(&model)];
        let mut runner = Runner::new(model, &mut arena).unwrap();
        runner.begin_self_test().unwrap();
        while runner.step(u64::MAX).unwrap() == Progress::Running {}
        (runner.check_self_test(), runner.telemetry().self_test_faults)
    };
    assert_eq!(check(&made.bytes), (Ok(()), 0));
    // A head bias that differs from the exported one, under valid checksums.
    let mut changed = made.bytes.clone();
    let model = Model::new(&made.bytes).unwrap();
    let Some(elunar_core::nn::file::Operator::Conv(head)) = model.operator(model.operator_count() - 1) else {
        panic!()
    };
    let constants = made.bytes.len() - model.constants_bytes().next_multiple_of(8);
    changed[constants + head.bias + 1] ^= 0x40;
    elunar_core::nn::file::seal_file(&mut changed);
    let (result, faults) = check(&changed);
    assert!(matches!(result, Err(RunError::SelfTest { .. })), "{result:?}");
    assert_eq!(faults, 1);
}

#[test]
fn scrubbing_reads_everything_in_small_bites() {
    let (made, _) = random_export(&small_config(), (32, 32), MapBits::Int8, 8);
    let model = Model::new(&made.bytes).unwrap();
    let mut arena = vec![0; required(&model)];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    let body = made.bytes.len() - model.raw().body_offset();
    let mut calls = 0;
    while runner.telemetry().scrub_passes < 2 {
        runner.scrub(1000).unwrap();
        calls += 1;
    }
    assert_eq!(runner.telemetry().scrubbed_bytes, 2 * body as u64);
    assert!(calls >= 2 * body / 1000, "{calls} calls for {body} bytes");
}

#[test]
fn larger_steps_give_the_same_bytes() {
    let (made, _) = random_export(&small_config(), (64, 96), MapBits::Mixed, 15);
    let shipped = ["nano", "ground"].map(|name| shipped::model(Path::new(name)).unwrap().1);
    for file in [made.bytes].into_iter().chain(shipped) {
        let model = Model::new(&file).unwrap();
        let large = large_steps(&model).unwrap();
        let relaid = Model::new(&large).unwrap();
        assert_eq!(large_steps(&relaid).unwrap(), large, "once is enough");
        assert_eq!((relaid.text(), relaid.macs(), relaid.self_test()), (model.text(), model.macs(), model.self_test()));
        let steps =
            |model: &Model<'_>| (0..model.entry_count()).filter_map(|i| model.entry(i)).map(|e| e.count).sum::<usize>();
        let (more, fewer) = (steps(&model), steps(&relaid));
        assert!(fewer < more || model.text().contains("random"), "{fewer} steps, {more} before");
        for operator in (0..relaid.operator_count()).filter_map(|i| relaid.operator(i)) {
            if let Operator::Conv(conv) = operator {
                assert!(conv.weights.is_multiple_of(LINE), "{conv:?}");
            }
        }
        let Shape { rows, cols } = model.tile();
        let mut tile = random_tile(rows, cols, 16);
        tile.image = tile.image.repeat(model.image_maps());
        assert!(run(&large, &tile, u64::MAX) == run(&file, &tile, u64::MAX), "{}", model.text());
    }
}
