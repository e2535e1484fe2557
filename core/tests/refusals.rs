//! Refusals of the public interface: each names what was expected and found, on one line, and changes nothing.

use elunar_core::error::LengthError;
use elunar_core::job::{TilePart, TileScale};
use elunar_core::nn::file::{CHUNK_BYTES, HEADER_BYTES, OperatorFault};
use elunar_core::nn::slots::{SlotError, StorageError};
use elunar_core::nn::{Illumination, InputRules, Model, ModelError, Progress, RunError, Runner, TruthRange, required};
use elunar_core::norm::{ElevationScale, Mirror, NormError};
use elunar_core::pixels::{PixelForm, PixelFormat};
use elunar_core::strip::{PostGrid, Strip, StripError, StripMemory, StripPlan, StripSettings};
use elunar_core::tile::Shape;
use elunar_core::{JobError, Lighting};
use std::fmt::Display;

const FILE: &[u8] = include_bytes!("../fixtures/tile-v4.eld");

/// Returns the text of an error, which is one line.
fn text(error: &dyn Display) -> String {
    let text = error.to_string();
    assert!(!text.is_empty() && !text.contains('\n'), "{text}");
    text
}

/// Asserts that errors have different texts, and that each names its numbers.
fn assert_told(errors: &[(&dyn Display, &[&str])]) {
    let texts: Vec<String> = errors.iter().map(|(error, _)| text(*error)).collect();
    for (index, (found, (_, named))) in texts.iter().zip(errors).enumerate() {
        assert!(named.iter().all(|part| found.contains(part)), "{found}: expected {named:?}");
        assert!(!texts[..index].contains(found), "{found}: twice");
    }
}

#[test]
fn errors_of_models_name_what_was_found() {
    let operator = |reason| ModelError::Operator { operator: 12, reason };
    assert_told(&[
        (&ModelError::Magic, &["not an ELunarDTM model"]),
        (&ModelError::Version { found: 77 }, &["77", "expected version 4"]),
        (&ModelError::Length { expected: 128, found: 12 }, &["128", "12"]),
        (&ModelError::HeaderChecksum, &["header"]),
        (&ModelError::ChunkChecksum { chunk: u32::MAX }, &["list"]),
        (&ModelError::ChunkChecksum { chunk: 31 }, &["chunk 31"]),
        (&ModelError::Header, &["field"]),
        (&ModelError::Tensor { tensor: 9 }, &["tensor 9"]),
        (&ModelError::Schedule { entry: 8 }, &["entry 8"]),
        (&ModelError::Work, &["64"]),
        (&operator(OperatorFault::Kind), &["operator 12", "kind"]),
        (&operator(OperatorFault::Parameter), &["operator 12", "parameter"]),
        (&operator(OperatorFault::TensorIndex), &["operator 12", "tensor"]),
        (&operator(OperatorFault::Shape), &["operator 12", "shapes"]),
        (&operator(OperatorFault::Type), &["operator 12", "type"]),
        (&operator(OperatorFault::Constants), &["operator 12", "constants"]),
        (&operator(OperatorFault::Overflow), &["operator 12", "overflow"]),
        (&operator(OperatorFault::Seal), &["operator 12", "seal"]),
        (&operator(OperatorFault::Work), &["operator 12", "work"]),
    ]);
}

#[test]
fn errors_of_runs_and_tiles_name_what_was_found() {
    let length = LengthError { expected: 4, found: 3 };
    let job = |error: JobError<RunError>| error;
    assert_told(&[
        (&RunError::ArenaTooSmall { required: 100, found: 99 }, &["100", "99"]),
        (&RunError::TileSize { expected: 16, found: 15 }, &["16", "15"]),
        (&RunError::NotFinite { index: 7 }, &["sample 7"]),
        (&RunError::State, &["no tile"]),
        (&RunError::SelfTest { expected: 0xab, found: 0xcd }, &["000000ab", "000000cd"]),
        (&RunError::ModelChanged { chunk: u32::MAX }, &["header"]),
        (&RunError::ModelChanged { chunk: 5 }, &["chunk 5"]),
        (&RunError::ProgramChanged { entry: 6 }, &["entry 6", "changed"]),
        (&RunError::DataChanged { tensor: 2, row: 3 }, &["row 3", "tensor 2"]),
        (&RunError::Miscomputed { entry: 4 }, &["entry 4", "wrongly"]),
        (&job(JobError::Length(length)), &["4", "3"]),
        (&job(JobError::Rules(NormError::Range { nr: -1.0 })), &["-1"]),
        (&job(JobError::Height { found: 9e9, low: -5.0, high: 6.0 }), &["9000000000", "-5", "6"]),
        (&job(JobError::Changed { part: TilePart::Valid }), &["Valid"]),
        (&job(JobError::Unequal), &["differ"]),
        (&job(JobError::State), &["not prepared"]),
    ]);
    // A fault of the network is told in its own words.
    assert_eq!(text(&job(JobError::Network(RunError::State))), text(&RunError::State));
}

#[test]
fn errors_of_slots_name_what_was_found() {
    assert_told(&[
        (&SlotError::NothingRuns, &["no slot"]),
        (&SlotError::NotBooted, &["boot"]),
        (&SlotError::Unconfirmed, &["confirmed first"]),
        (&SlotError::Confirmed, &["not rejected"]),
        (&SlotError::NoUpload, &["no upload"]),
        (&SlotError::FileBytes { slot: 4096, found: 5000 }, &["4096", "5000"]),
        (&SlotError::Offset { expected: 10, found: 11 }, &["10", "11"]),
        (&SlotError::Length { expected: 20, found: 21 }, &["20", "21"]),
        (&SlotError::OtherModel { expected: 0x1a, found: 0x2b }, &["0000001a", "0000002b"]),
        (&SlotError::from(ModelError::Magic), &["not an ELunarDTM model"]),
        (&SlotError::TrialBoots { found: 17 }, &["16", "17"]),
        (&SlotError::from(StorageError { code: 30 }), &["30"]),
        (&SlotError::NotWritten { offset_bytes: 40 }, &["40"]),
    ]);
}

#[test]
fn a_runner_refuses_calls_out_of_order_and_wrong_buffers() {
    let model = Model::new(FILE).unwrap();
    let pixels = model.tile().pixels();
    let needed = required(&model);
    let refused = Runner::new(model, &mut vec![0; needed - 1]).unwrap_err();
    assert_eq!(refused, RunError::ArenaTooSmall { required: needed, found: needed - 1 });
    let mut arena = vec![0; needed];
    let mut runner = Runner::new(model, &mut arena).unwrap();
    let (image, coarse) = (vec![0.5; pixels], vec![1.0; pixels]);
    let mut heights = vec![7.0; pixels];
    assert_eq!(runner.step(1), Err(RunError::State));
    assert_eq!(runner.output(&mut heights), Err(RunError::State));
    assert_eq!(runner.check_self_test(), Err(RunError::State));
    assert_eq!(runner.position(), None);
    let short = RunError::TileSize { expected: pixels, found: pixels - 1 };
    assert_eq!(runner.begin(&image[1..], &coarse), Err(short));
    assert_eq!(runner.begin(&image, &coarse[1..]), Err(short));
    for bad in [f32::NAN, f32::INFINITY] {
        let mut wrong = image.clone();
        wrong[40] = bad;
        assert_eq!(runner.begin(&wrong, &coarse), Err(RunError::NotFinite { index: 40 }));
        assert_eq!(runner.begin(&image, &wrong), Err(RunError::NotFinite { index: 40 }));
    }
    assert_eq!(runner.step(1), Err(RunError::State), "nothing has begun");
    runner.begin(&image, &coarse).unwrap();
    assert_eq!(runner.output(&mut heights), Err(RunError::State), "not done");
    while runner.step(u64::MAX).unwrap() == Progress::Running {}
    assert_eq!(runner.output(&mut heights[1..]), Err(short));
    assert!(heights.iter().all(|z| *z == 7.0), "a refused call writes nothing");
    runner.output(&mut heights).unwrap();
    assert!(heights.iter().all(|z| z.is_finite()));
}

#[test]
fn scales_are_refused_whose_numbers_no_tile_has() {
    let heights = [0.0, 10.0, 20.0, 30.0];
    for nr in [f32::NAN, f32::INFINITY, 0.0, -50.0] {
        let refused = |found: Result<ElevationScale, NormError>| matches!(found, Err(NormError::Range { .. }));
        assert!(refused(ElevationScale::from_heights(&heights, None, nr)), "{nr}");
        assert!(refused(ElevationScale::from_pixel(&heights, None, 1.0, nr)), "{nr}");
        assert!(refused(ElevationScale::from_parts(0.0, 20.0, nr)), "{nr}");
    }
    let short = Err(NormError::Length(LengthError { expected: 4, found: 3 }));
    assert_eq!(ElevationScale::from_heights(&heights, Some(&[true; 3]), 50.0), short);
    assert_eq!(ElevationScale::from_pixel(&heights, Some(&[true; 3]), 1.0, 50.0), short);
    // Three heights are valid, then none of them.
    let masked = ElevationScale::from_pixel(&heights, Some(&[false, true, true, true]), 1.0, 50.0).unwrap();
    assert_eq!(masked.min_m(), 20.0, "the mean of what counts");
    let none = ElevationScale::from_pixel(&heights, Some(&[false; 4]), 1.0, 50.0);
    assert_eq!(none, Err(NormError::TooFewValid { found: 0 }));
    // The lowest height is finite; the widened range is not.
    let low = ElevationScale::from_parts(-f32::MAX, 1e9, 50.0).unwrap();
    for share in [f32::NAN, -0.1, 1e30] {
        assert!(low.with_margin(share).is_err(), "{share}");
    }
}

#[test]
fn normalised_heights_are_recovered_whatever_the_mirror() {
    let shape = Shape::new(3, 4);
    let heights: Vec<f32> = (0..12).map(|i| 100.0 + 8.0 * i as f32).collect();
    let elevation = ElevationScale::from_heights(&heights, None, 50.0).unwrap();
    let mut found = vec![];
    for azimuth_deg in [315.0, 45.0, 225.0, 135.0] {
        let mirror = Mirror::from_azimuth_deg(azimuth_deg);
        let scale = TileScale { elevation, mirror };
        let mut network = vec![0.0; 12];
        scale.normalise(shape, &heights, &mut network).unwrap();
        found.push(network.clone());
        scale.recover(shape, &mut network);
        assert!(network.iter().zip(&heights).all(|(a, b)| (a - b).abs() < 1e-4), "{azimuth_deg}: {network:?}");
        let short = |found| Err(NormError::Length(LengthError { expected: 12, found }));
        assert_eq!(scale.normalise(shape, &heights[1..], &mut network), short(11));
        assert_eq!(scale.normalise(shape, &heights, &mut network[1..]), short(11));
    }
    assert!((1..4).all(|i| !found[..i].contains(&found[i])), "four mirrors give four forms");
}

#[test]
fn the_truths_scale_is_its_own_or_that_of_the_coarse_heights() {
    let coarse = ElevationScale::from_heights(&[0.0, 10.0, 20.0, 30.0], None, 50.0).unwrap();
    let scale = TileScale { elevation: coarse, mirror: Mirror { rows: true, cols: false } };
    let of = |truth_range, truth: &[f32]| {
        let rules = InputRules { nr: 50.0, range_margin: 0.0, truth_range, illumination: Illumination::Any };
        rules.truth_scale(&scale, truth)
    };
    let truth = [5.0, 6.0, 7.0, 45.0];
    let own = of(TruthRange::Own, &truth).unwrap();
    assert_eq!((own.elevation.min_m(), own.elevation.relief_m(), own.mirror), (5.0, 40.0, scale.mirror));
    for range in [TruthRange::Reference, TruthRange::Pixel] {
        assert_eq!(of(range, &truth), Ok(scale));
    }
    assert!(matches!(of(TruthRange::Own, &[5.0; 4]), Err(NormError::Relief { .. })), "a flat truth has no range");
}

/// A model that changes after its validation is opened by its verdict, as after radiation. The scrubbing names the chunk and goes on behind it; a
/// tile with another list of checksums is not finished.
#[test]
fn a_model_that_changed_after_its_validation_is_found() {
    let verdict = Model::new(FILE).unwrap().verdict();
    let chunks = Model::new(FILE).unwrap().raw().chunks();
    let body = Model::new(FILE).unwrap().raw().body_offset();
    for chunk in 0..chunks {
        let mut file = FILE.to_vec();
        file[body + chunk as usize * CHUNK_BYTES] ^= 0x10;
        let model = Model::reopen(&file, &verdict).unwrap();
        let mut arena = vec![0; required(&model)];
        let mut runner = Runner::new(model, &mut arena).unwrap();
        let faults = (0..2 * FILE.len() / 1000).filter_map(|_| runner.scrub(1000).err()).collect::<Vec<_>>();
        assert!(
            !faults.is_empty() && faults.iter().all(|fault| *fault == RunError::ModelChanged { chunk }),
            "{faults:?}"
        );
        assert_eq!(runner.telemetry().scrub_faults, faults.len() as u64);
    }
    let mut file = FILE.to_vec();
    file[HEADER_BYTES] ^= 1;
    let model = Model::reopen(&file, &verdict).unwrap();
    let (image, mut arena) = (vec![0.5; model.tile().pixels()], vec![0; required(&model)]);
    let mut runner = Runner::new(model, &mut arena).unwrap();
    runner.begin(&image, &image).unwrap();
    let ended = loop {
        match runner.step(1_000_000) {
            Ok(Progress::Running) => {}
            ended => break ended,
        }
    };
    assert_eq!(ended, Err(RunError::ModelChanged { chunk: u32::MAX }));
}

/// Lends memory for a strip of the fixture's model with these pixels, whose coarse heights come as posts, to `work`.
fn with_strip(pixels: PixelForm, work: impl FnOnce(&mut Strip<'_, '_>)) {
    let model = Model::new(FILE).unwrap();
    let settings = StripSettings {
        cols: 40,
        ring_lines: StripPlan::least_lines(&model),
        overlap_px: 8,
        pixel_m: 2.0,
        coarse_px: 8.0,
        anchor: true,
        checked: false,
        light: Lighting::NOT_ASKED,
        pixels,
        posts: Some(PostGrid::spaced(7, (0.0, 0.0), (8.0, 8.0))),
        expected_errors: false,
    };
    let plan = StripPlan::new(&model, settings).unwrap();
    let (mut arena, mut bytes) = (vec![0; plan.arena_bytes()], vec![0; plan.bytes_len()]);
    let (mut samples, mut sums) = (vec![0.0; plan.samples_len()], vec![0.0; plan.sums_len()]);
    let memory = StripMemory { bytes: &mut bytes, samples: &mut samples, sums: &mut sums };
    work(&mut Strip::new(plan, Runner::new(model, &mut arena).unwrap(), memory).unwrap());
}

#[test]
fn lines_of_floats_are_refused_where_codes_were_announced() {
    with_strip(PixelForm { format: PixelFormat::U16Le, ..PixelForm::F32 }, |strip| {
        assert_eq!(strip.push_line(&[0.5; 40], &[]), Err(StripError::Pixel));
        let short = LengthError { expected: 80, found: 79 };
        assert_eq!(strip.push_pixels(&[0; 79], &[]), Err(StripError::Line(short)));
    });
}

#[test]
fn rows_of_posts_are_refused_while_all_kept_are_needed_and_after_their_end() {
    with_strip(PixelForm::F32, |strip| {
        assert_eq!(strip.push_line(&[0.5; 40], &[]), Err(StripError::PostsFirst));
        assert_eq!(strip.push_posts(&[1.0; 6]), Err(StripError::Line(LengthError { expected: 7, found: 6 })));
        // No line has come: the first row of posts stays needed.
        let taken = (0..1000).take_while(|_| strip.push_posts(&[1.0; 7]) == Ok(())).count();
        assert!((4..1000).contains(&taken), "{taken}");
        let before = strip.pause();
        assert_eq!(strip.push_posts(&[1.0; 7]), Err(StripError::Full));
        assert_eq!(strip.pause(), before, "a refused row changes nothing");
        assert_eq!(strip.push_line(&[0.5; 40], &[]), Ok(0));
        strip.finish_posts();
        assert_eq!(strip.push_posts(&[1.0; 7]), Err(StripError::Ended));
    });
}
