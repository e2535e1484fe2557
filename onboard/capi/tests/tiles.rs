//! The C interface computes the same bytes as the core, in every order of calls.
#![allow(unsafe_code)] // C functions

mod common;
use common::*;
use elunar_capi::ffi;
use elunar_capi::status::*;
use elunar_capi::types::*;

#[test]
fn heights_and_validity_are_the_cores() {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    let (heights_m, valid) = tile.expected();
    assert_eq!(context.begin(&tile), ELD_OK);
    context.finish();
    let found = context.output().unwrap();
    assert_eq!(bits(&found.0), bits(&heights_m));
    assert_eq!(found.1, valid);
    let masked = valid.iter().filter(|v| **v == 0).count();
    // Lost packets, a saturated sample, voids in the heights, a masked corner.
    assert_eq!(masked, 8 * 40 + 1 + 4 * 20 + 16 * 24);
    assert_eq!(context.telemetry().valid_px as usize, PX - masked);
    // The heights again, without the mask; a finished tile stays.
    let mut again = vec![0.0; PX];
    // SAFETY: a context and a buffer of the test.
    let status = unsafe { ffi::eld_output(context.handle, again.as_mut_ptr(), PX, std::ptr::null_mut(), 0) };
    assert_eq!((status, bits(&again)), (ELD_OK, bits(&heights_m)));
    assert_eq!(context.step(1), ELD_OK);
}

#[test]
fn expected_errors_are_the_cores() {
    for tile in [Tile::golden(), Tile::other()] {
        let mut context = Context::new(nano());
        assert!(worked(context.begin(&tile)));
        context.finish();
        let found = context.errors().unwrap();
        let values =
            [found.height_m, found.slope, found.explained, found.dark_height_m, found.dark_slope, found.dark_below];
        let (_, _, expected) = tile.expected_with_errors();
        assert_eq!(bits(&values), bits(&expected.to_values()));
        assert!(
            found.slope > 0.0 && found.dark_slope > found.slope && found.dark_height_m > found.height_m,
            "{found:?}"
        );
        assert!((0.0..=1.0).contains(&found.explained) && found.dark_below > 0.0, "{found:?}");
    }
}

#[test]
fn budgets_do_not_matter() {
    let tile = Tile::golden();
    let mut context = Context::new(nano());
    let info = info(nano()).unwrap();
    assert_eq!(context.begin(&tile), ELD_OK);
    let mut macs = 0;
    for budget in [0, 1, 7, 1000, 123_456, info.largest_unit_macs, u64::MAX].into_iter().cycle() {
        let status = context.step(budget);
        let spent = context.telemetry().macs - macs;
        assert!(spent < budget.max(1).saturating_add(info.largest_unit_macs), "{spent} for {budget}");
        macs += spent;
        if budget == u64::MAX || status == ELD_OK {
            assert_eq!((status, macs), (ELD_OK, info.tile_macs));
            break;
        }
        assert_eq!(status, ELD_RUNNING);
    }
    assert_eq!(bits(&context.output().unwrap().0), bits(&tile.expected().0));
}

#[test]
fn two_contexts_do_not_know_of_each_other() {
    let tiles = [Tile::golden(), Tile::other()];
    let mut contexts = [Context::new(nano()), Context::new(nano())];
    for (context, tile) in contexts.iter_mut().zip(&tiles) {
        assert!(worked(context.begin(tile)));
    }
    // In turn step by step; steps of one tile end within layers of the other.
    let mut running = [true; 2];
    while running.contains(&true) {
        for ((context, running), budget) in contexts.iter_mut().zip(&mut running).zip([STEP_MACS, 7_000_000]) {
            *running = context.step(budget) == ELD_RUNNING;
            assert_eq!(context.scrub(1000), ELD_OK);
        }
    }
    for (context, tile) in contexts.iter_mut().zip(&tiles) {
        assert_eq!(bits(&context.output().unwrap().0), bits(&tile.expected().0));
    }
    assert_ne!(bits(&contexts[0].output().unwrap().0), bits(&contexts[1].output().unwrap().0));
}

#[test]
fn contexts_run_on_threads_of_their_own() {
    std::thread::scope(|scope| {
        let run = |tile: Tile| {
            move || {
                let mut context = Context::new(nano());
                for _ in 0..3 {
                    assert!(worked(context.begin(&tile)));
                    context.finish();
                }
                context.output().unwrap().0
            }
        };
        let tiles = [Tile::golden(), Tile::other()];
        let found = tiles.clone().map(|tile| scope.spawn(run(tile)));
        for (found, tile) in found.into_iter().zip(&tiles) {
            assert_eq!(bits(&found.join().unwrap()), bits(&tile.expected().0));
        }
    });
}

#[test]
fn a_context_may_change_threads() {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    assert_eq!(context.begin(&tile), ELD_OK);
    assert_eq!(context.step(STEP_MACS), ELD_RUNNING);
    let mut context = std::thread::spawn(move || {
        context.finish();
        context
    })
    .join()
    .unwrap();
    assert_eq!(bits(&context.output().unwrap().0), bits(&tile.expected().0));
}

#[test]
fn the_self_test_passes_between_tiles() {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    for _ in 0..2 {
        assert_eq!(context.self_test_begin(), ELD_OK);
        context.finish();
        assert_eq!(context.self_test_check(), ELD_OK);
        assert_eq!(context.telemetry().phase, ELD_PHASE_SELF_TEST_DONE);
        assert_eq!(context.begin(&tile), ELD_OK);
        context.finish();
    }
    assert_eq!(bits(&context.output().unwrap().0), bits(&tile.expected().0));
    let counters = context.telemetry();
    assert_eq!((counters.tiles, counters.self_test_faults, counters.faults), (4, 0, 0));
}

#[test]
fn a_refused_tile_leaves_the_one_at_work() {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    assert_eq!(context.begin(&tile), ELD_OK);
    assert_eq!(context.step(STEP_MACS), ELD_RUNNING);
    let no_ground = Tile { pixel_m: 0.0, ..tile.clone() };
    assert_eq!(context.begin(&no_ground), ELD_REFUSED_TILE_PIXEL);
    let masked = Tile { valid: Some(vec![0; PX]), ..tile.clone() };
    assert_eq!(context.begin(&masked), ELD_REFUSED_TILE_MASKED);
    context.finish();
    let found = context.output().unwrap();
    assert_eq!((bits(&found.0), found.1), (bits(&tile.expected().0), tile.expected().1));
    assert_eq!(context.telemetry().tiles_dropped, 0);
}

#[test]
fn the_tile_may_go_when_it_has_begun() {
    let mut tile = Tile::golden();
    let expected = tile.expected();
    let mut context = Context::new(nano());
    assert_eq!(context.begin(&tile), ELD_OK);
    tile.image.fill(f32::NAN);
    tile.coarse_m.fill(0.0);
    tile.valid = None;
    context.finish();
    let found = context.output().unwrap();
    assert_eq!((bits(&found.0), found.1), (bits(&expected.0), expected.1));
}

#[test]
fn telemetry_counts() {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    let needs = info(nano()).unwrap();
    assert_eq!(context.telemetry().phase, ELD_PHASE_EMPTY);
    assert_eq!(context.begin(&tile), ELD_OK);
    assert_eq!(context.telemetry().phase, ELD_PHASE_TILE);
    context.step(STEP_MACS);
    let halfway = context.telemetry();
    // The rest of the budget went into bytes that were compared.
    assert!(halfway.entry > 0 && halfway.macs < STEP_MACS + needs.largest_unit_macs && halfway.steps == 1);
    assert!(halfway.macs > STEP_MACS / 10 * 9, "{}", halfway.macs);
    context.finish();
    while context.telemetry().scrub_passes == 0 {
        assert_eq!(context.scrub(100_000), ELD_OK);
    }
    let counters = context.telemetry();
    assert_eq!((counters.phase, counters.tiles, counters.macs), (ELD_PHASE_TILE_DONE, 1, needs.tile_macs));
    assert_eq!((counters.faults, counters.last_fault, counters.context_repairs), (0, 0, 0));
    assert_eq!(counters.header_crc, needs.header_crc);
    assert!(counters.scrubbed_bytes > needs.file_bytes - 8192 && counters.scrubbed_bytes < needs.file_bytes);
}

#[test]
fn versions_names_and_sizes_are_told() {
    let needs = info(nano()).unwrap();
    assert_eq!((needs.tile_rows as usize, needs.tile_cols as usize), (ROWS, COLS));
    assert_eq!(needs.file_bytes as usize, nano().len());
    assert_eq!(ffi::eld_format_version(), needs.format_version);
    assert_eq!(ffi::eld_version(), ELD_VERSION);
    assert!(needs.memory_bytes > needs.arena_bytes && needs.largest_unit_macs < needs.tile_macs / 100);
    let mut name = [1; 64];
    // SAFETY: a buffer of the test.
    let name_it = |name: &mut [std::ffi::c_char]| unsafe { ffi::eld_kernel_name(name.as_mut_ptr(), name.len()) };
    assert_eq!(name_it(&mut name), ELD_OK);
    let len = name.iter().position(|c| *c == 0).unwrap();
    assert_eq!(name_it(&mut name[..len]), ELD_REFUSED_BUFFER);
    assert_eq!(name_it(&mut name[..len + 1]), ELD_OK);
    let text: Vec<u8> = name[..len].iter().map(|c| *c as u8).collect();
    assert_eq!(text, elunar_core::nn::Kernel::best().name().as_bytes());
    println!("{} bytes of memory, largest unit {} macs", needs.memory_bytes, needs.largest_unit_macs);
}
