//! The light of a scene: what tiles show of it adds up as in the core, and tiles are made under the decision.
#![allow(unsafe_code)] // C functions

mod common;
use common::*;
use elunar_capi::status::*;
use elunar_capi::types::*;
use elunar_core::job::LightSurvey;
use elunar_core::nn::{LightSource, Lighting};
use elunar_core::pixels::{PixelFormat, Pixels};
use elunar_core::{KnownSun, Model, Progress, TileInput, TileJob, TileLight, TileMemory, TileRules};

const UNKNOWN: [f32; 2] = [f32::NAN; 2];

/// The golden tile without its mask, and a part of it in another tile.
fn tiles() -> [Tile; 2] {
    let whole = Tile { valid: None, sun: UNKNOWN, ..Tile::golden() };
    let mut half = whole.clone();
    half.image[..PX / 2].fill(f32::NAN);
    [whole, half]
}

/// Returns what tiles show, by the core.
fn surveyed(tiles: &[Tile]) -> LightSurvey {
    let model = Model::new(nano()).unwrap();
    let (shape, rules) = (model.tile(), model.input_rules());
    let mut all = LightSurvey::default();
    for tile in tiles {
        let bytes: Vec<u8> = tile.image.iter().flat_map(|v| v.to_ne_bytes()).collect();
        let image = Pixels {
            bytes: &bytes,
            shape,
            row_bytes: 4 * COLS,
            format: PixelFormat::F32,
            gain: 1.0,
            offset: 0.0,
            null_code: None,
            saturated_from: None,
        };
        let input = TileInput { image, coarse_m: &tile.coarse_m[..], inside: shape, light: TileLight::default() };
        let (mut coarse, mut valid) = (vec![0.0; PX], vec![0; TileMemory::valid_len(shape)]);
        let mut scratch = vec![0.0; TileMemory::scratch_len(&rules, shape)];
        let mut lines = vec![0.0; TileMemory::lines_len(shape)];
        let mut memory =
            TileMemory { coarse_m: &mut coarse, valid: &mut valid, scratch: &mut scratch, lines: &mut lines };
        let how = TileRules { pixel_m: tile.pixel_m, coarse_px: tile.coarse_px, anchor: true, checked: false };
        let mut job = TileJob::new(how, rules, shape);
        assert_eq!(job.survey(&input, &mut memory, u64::MAX), Ok(Progress::Done));
        all.add(&job.shown());
    }
    all
}

fn decided(survey: &LightSurvey, [azimuth, elevation]: [f32; 2]) -> Lighting {
    let known = |deg: f32| (!deg.is_nan()).then_some(f64::from(deg));
    let sun = KnownSun { azimuth_deg: known(azimuth), elevation_deg: known(elevation) };
    survey.decide(Model::new(nano()).unwrap().illumination(), sun)
}

fn assert_is(found: &eld_lighting_t, expected: &Lighting) {
    let of_c = [found.east, found.south, found.trust, found.related, found.log_strength_sd, found.azimuth_sd_deg];
    let Lighting { light, trust, related, log_strength_sd, azimuth_sd_deg, .. } = *expected;
    assert_eq!(bits(&of_c), bits(&[light.east, light.south, trust, related, log_strength_sd, azimuth_sd_deg]));
    assert_eq!((!found.long_share.is_nan()).then_some(found.long_share), expected.long_share);
    assert_eq!(found.source, expected.source as u32);
}

fn add(context: &mut Context, tile: &Tile, budget: u64) -> (eld_status_t, usize) {
    let mut pieces = 0;
    loop {
        match context.light_add(&tile.c(), budget) {
            ELD_RUNNING => pieces += 1,
            status => break (status, pieces),
        }
    }
}

#[test]
fn the_light_is_that_of_all_tiles_added() {
    let tiles = tiles();
    let mut context = Context::new(nano());
    let none = context.light_decide(UNKNOWN).unwrap();
    assert_is(&none, &decided(&LightSurvey::default(), UNKNOWN));
    assert_eq!(none.source, ELD_SOURCE_ASSUMED);
    for (count, budget) in [(1, u64::MAX), (2, 300_000)] {
        let (status, pieces) = add(&mut context, &tiles[count - 1], budget);
        assert!(status == ELD_OK && (pieces > 20) == (count == 2), "{pieces}");
        let survey = surveyed(&tiles[..count]);
        for sun in [UNKNOWN, [190.0, f32::NAN], [189.5, 25.6]] {
            assert_is(&context.light_decide(sun).unwrap(), &decided(&survey, sun));
        }
    }
    assert_eq!(decided(&surveyed(&tiles), UNKNOWN).source, LightSource::Fitted);
    assert_eq!(context.light_clear(), ELD_OK);
    assert_is(&context.light_decide(UNKNOWN).unwrap(), &decided(&LightSurvey::default(), UNKNOWN));
    assert_eq!(add(&mut context, &tiles[0], u64::MAX), (ELD_OK, 0));
    assert_is(&context.light_decide(UNKNOWN).unwrap(), &decided(&surveyed(&tiles[..1]), UNKNOWN));
}

#[test]
fn a_tile_is_made_under_the_light_of_its_scene() {
    let [tile, half] = tiles();
    let mut context = Context::new(nano());
    assert_eq!(add(&mut context, &tile, u64::MAX).0, ELD_OK);
    let own = context.light_decide(tile.sun).unwrap();
    let mut heights_under = |light: &eld_lighting_t, tile: &Tile| {
        let c = eld_tile_t { light, ..tile.c() };
        let begun = context.begin_step(&c, u64::MAX);
        assert!(worked(begun), "{:?}", text(begun));
        context.finish();
        bits(&context.output().unwrap().0)
    };
    assert!(heights_under(&own, &tile) == bits(&tile.expected().0), "its own light");
    assert!(heights_under(&own, &half) != bits(&half.expected().0), "another's");
    // Under an assumed light the coarse heights stay.
    let assumed = Context::new(nano()).light_decide(UNKNOWN).unwrap();
    let c = eld_tile_t { light: &raw const assumed, ..tile.c() };
    assert_eq!(context.begin_step(&c, u64::MAX), ELD_NOTICE_LIGHT_ASSUMED);
    // Another light is another tile.
    let mut changed = own;
    let c = eld_tile_t { light: &raw const changed, ..tile.c() };
    assert_eq!(context.begin_step(&c, 1), ELD_RUNNING);
    let dropped = context.telemetry().tiles_dropped;
    // SAFETY: a structure of the test.
    unsafe { (&raw mut changed.trust).write(0.5) };
    assert_eq!((context.begin_step(&c, 1), context.telemetry().tiles_dropped), (ELD_RUNNING, dropped + 1));
}

#[test]
fn a_survey_takes_the_place_of_a_tile() {
    let [tile, _] = tiles();
    let mut context = Context::new(nano());
    assert!(worked(context.begin(&tile)));
    assert_eq!((context.light_add(&tile.c(), 1), context.telemetry().phase), (ELD_RUNNING, ELD_PHASE_LIGHT));
    assert_eq!((context.step(1), context.output()), (ELD_REFUSED_NO_TILE, Err(ELD_REFUSED_NO_TILE)));
    assert_eq!(add(&mut context, &tile, u64::MAX).0, ELD_NOTICE_DROPPED);
    assert_eq!((context.telemetry().phase, context.telemetry().tiles_dropped), (ELD_PHASE_EMPTY, 1));
    // One that is given up is not added.
    let before = context.light_decide(UNKNOWN);
    assert_eq!(context.light_add(&tile.c(), 1), ELD_RUNNING);
    assert_eq!((context.abort(), context.light_decide(UNKNOWN)), (ELD_NOTICE_DROPPED, before));
    assert_eq!(context.light_add(&tile.c(), 1), ELD_RUNNING);
    assert_eq!(context.begin(&tile), ELD_NOTICE_DROPPED);
    assert_eq!(context.light_decide(UNKNOWN), before);
    let void = Tile { image: vec![f32::NAN; PX], ..tile };
    assert_eq!(add(&mut context, &void, u64::MAX).0, ELD_REFUSED_TILE_MASKED);
    assert_eq!(context.telemetry().phase, ELD_PHASE_TILE, "refused, and the tile goes on");
}

#[test]
fn a_flipped_bit_of_the_sum_is_repaired_and_two_are_reported() {
    let [tile, _] = tiles();
    let mut context = Context::new(nano());
    assert_eq!(add(&mut context, &tile, u64::MAX).0, ELD_OK);
    let (expected, survey) = (context.light_decide(UNKNOWN).unwrap(), context.parts().survey);
    let flips = (8 * survey.start..8 * survey.end).step_by(37);
    for bit in flips.clone() {
        context.flip(bit);
        assert_eq!(context.light_decide(UNKNOWN), Ok(expected), "bit {bit}");
    }
    let counted = context.telemetry();
    assert_eq!((counted.context_repairs, counted.faults), (flips.count() as u64, 0));
    context.flip(8 * survey.start + 500);
    context.flip(8 * survey.end - 500);
    assert_eq!(context.light_decide(UNKNOWN), Err(ELD_FAULT_LIGHT));
    assert_eq!(context.light_decide(UNKNOWN).unwrap().source, ELD_SOURCE_ASSUMED, "forgotten");
    assert_eq!(add(&mut context, &tile, u64::MAX).0, ELD_OK);
    assert_eq!(context.light_decide(UNKNOWN), Ok(expected));
}

#[test]
fn lights_that_nothing_decides_are_refused() {
    let [tile, _] = tiles();
    let mut context = Context::new(nano());
    assert_eq!(add(&mut context, &tile, u64::MAX).0, ELD_OK);
    let good = context.light_decide(UNKNOWN).unwrap();
    let changes: [fn(&mut eld_lighting_t); 12] = [
        |light| light.source = ELD_SOURCE_NOT_ASKED,
        |light| light.source = 4,
        |light| light.east = f32::NAN,
        |light| light.south = f32::INFINITY,
        |light| (light.east, light.south) = (0.0, 0.0),
        |light| light.trust = 1.5,
        |light| light.related = f32::NAN,
        |light| light.long_share = -0.1,
        |light| light.log_strength_sd = -1.0,
        |light| light.log_strength_sd = f32::INFINITY,
        |light| light.azimuth_sd_deg = 181.0,
        |light| light.azimuth_sd_deg = f32::NAN,
    ];
    for (number, change) in changes.iter().enumerate() {
        let mut light = good;
        change(&mut light);
        let c = eld_tile_t { light: &raw const light, ..tile.c() };
        assert_eq!(context.begin_step(&c, 1), ELD_REFUSED_TILE_LIGHT, "change {number}");
    }
    // From the south alone.
    let south = eld_lighting_t { east: 0.0, south: 0.7, ..good };
    let c = eld_tile_t { light: &raw const south, ..tile.c() };
    assert_eq!(context.begin_step(&c, 1), ELD_RUNNING);
    let short = eld_lighting_t { struct_bytes: 8, ..good };
    let c = eld_tile_t { light: &raw const short, ..tile.c() };
    assert_eq!(context.begin_step(&c, 1), ELD_REFUSED_STRUCT_BYTES);
    assert_eq!(context.light_decide([f32::NAN, 95.0]), Err(ELD_REFUSED_TILE_SUN));
}
