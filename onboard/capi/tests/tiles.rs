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

/// Begins, runs and reads a tile.
fn heights_of(tile: &eld_tile_t) -> (Vec<f32>, Vec<u8>) {
    let mut context = Context::new(nano());
    let begun = context.begin_step(tile, u64::MAX);
    assert!(worked(begun) && begun != ELD_RUNNING, "{:?}", text(begun));
    context.finish();
    context.output().unwrap()
}

fn assert_same(found: &(Vec<f32>, Vec<u8>), expected: &(Vec<f32>, Vec<u8>), what: &str) {
    assert!(bits(&found.0) == bits(&expected.0) && found.1 == expected.1, "{what}: other bytes");
}

/// Returns codes of the golden image, from 1 to `most`.
fn codes(tile: &Tile, most: f32) -> Vec<u32> {
    let real = || tile.image.iter().copied().filter(|v| v.is_finite() && v.abs() < 1e30);
    let (low, high) = real().fold((f32::MAX, f32::MIN), |(low, high), v| (low.min(v), high.max(v)));
    let code = |v: &f32| if v.is_finite() { 1 + ((v - low) / (high - low) * (most - 1.0)) as u32 } else { 1 };
    tile.image.iter().map(code).collect()
}

/// Returns a frame of rows of these codes, with `margin` bytes of rubbish before each row and behind it.
fn frame(codes: &[u32], format: u32, margin: usize) -> Vec<u8> {
    let row = |codes: &[u32]| -> Vec<u8> {
        match format {
            ELD_PIXELS_U8 => codes.iter().map(|code| *code as u8).collect(),
            ELD_PIXELS_U16_LE => codes.iter().flat_map(|code| (*code as u16).to_le_bytes()).collect(),
            ELD_PIXELS_U16_BE => codes.iter().flat_map(|code| (*code as u16).to_be_bytes()).collect(),
            ELD_PIXELS_U12_PACKED => {
                let pair = |pair: &[u32]| [pair[0] >> 4, (pair[0] & 15) << 4 | pair[1] >> 8, pair[1] & 255];
                codes.chunks(2).flat_map(pair).map(|byte| byte as u8).collect()
            }
            _ => codes.iter().flat_map(|code| (*code as f32).to_ne_bytes()).collect(),
        }
    };
    let rubbish = || std::iter::repeat_n(0xEE, margin);
    codes.chunks(COLS).flat_map(|codes| rubbish().chain(row(codes)).chain(rubbish())).collect()
}

#[test]
fn every_pixel_format_gives_the_heights_of_floats() {
    use std::collections::HashMap;
    let mut known: HashMap<u32, (Vec<f32>, Vec<u8>)> = HashMap::new();
    let (gain, offset) = (0.25, 3.0);
    for (format, most) in [
        (ELD_PIXELS_U8, 255.0),
        (ELD_PIXELS_U12_PACKED, 4095.0),
        (ELD_PIXELS_U16_LE, 4095.0),
        (ELD_PIXELS_U16_BE, 4095.0),
        (ELD_PIXELS_F32, 4095.0),
    ] {
        let mut tile = Tile::golden();
        let mut codes = codes(&tile, most);
        // Lost packets have code 0; the brightest pixels are saturated.
        codes[5 * COLS..5 * COLS + 40].fill(0);
        let saturated_from = (most * 0.9) as u32;
        let is_void = |code: u32| code == 0 || code >= saturated_from;
        let expected = known.entry(most as u32).or_insert_with(|| {
            let image = codes.iter().map(|code| if is_void(*code) { f32::NAN } else { gain * *code as f32 + offset });
            tile.image = image.collect();
            tile.expected()
        });
        assert!(codes.iter().filter(|code| is_void(**code)).count() > 40);
        let is_float = format == ELD_PIXELS_F32;
        for margin in [0, 1, 22] {
            let mut frame = frame(&codes, format, margin);
            if is_float {
                // Floats have no codes: their voids are not real.
                for (row, codes) in frame.chunks_mut(4 * COLS + 2 * margin).zip(codes.chunks(COLS)) {
                    for (col, _) in codes.iter().enumerate().filter(|(_, code)| is_void(**code)) {
                        row[margin + 4 * col..][..4].copy_from_slice(&f32::INFINITY.to_ne_bytes());
                    }
                }
            }
            let (first, row_bytes) = (&frame[margin..frame.len() - margin], frame.len() / ROWS);
            let mut c = tile.c();
            c.image = eld_pixels_t {
                data: first.as_ptr().cast(),
                data_bytes: first.len(),
                row_bytes: if margin == 0 { 0 } else { row_bytes },
                format,
                flags: if is_float { 0 } else { ELD_PIXELS_HAS_NULL | ELD_PIXELS_HAS_SATURATED },
                gain,
                offset,
                null_code: 0,
                saturated_from,
            };
            assert_same(&heights_of(&c), expected, &format!("format {format}, margin {margin}"));
        }
    }
}

#[test]
fn posts_give_the_heights_of_the_map_that_they_make() {
    use elunar_core::posts::PostMap;
    use elunar_core::samples::Samples;
    use elunar_core::strip::PostGrid;
    use elunar_core::tile::Shape;
    let mut tile = Tile::golden();
    // Posts 30 pixels apart, with a void; the last row is just short of the tile's edge.
    let mut posts_m: Vec<f32> = (0..9 * 12).map(|i| -1900.0 + (i * 7919 % 101) as f32).collect();
    posts_m[4 * 12 + 5] = -3.4e38;
    let grid = PostGrid::spaced(12, (-7.25, -3.5), (30.0, 29.61));
    let map = PostMap::new(&posts_m, grid, Shape::new(ROWS, COLS)).unwrap();
    tile.coarse_m = (0..PX).map(|i| map.at(i)).collect();
    let voids = tile.coarse_m.iter().filter(|z| z.is_nan()).count();
    assert!(voids > 1000 && voids < PX / 4, "{voids}");
    let expected = tile.expected();
    let posts = posts(&posts_m, grid);
    let c = eld_tile_t { posts: &raw const posts, coarse_m: std::ptr::null(), coarse_len: 0, ..tile.c() };
    assert_same(&heights_of(&c), &expected, "at once");
    let (mut context, mut pieces) = (Context::new(nano()), 0);
    while context.begin_step(&c, 100_000) == ELD_RUNNING {
        pieces += 1;
    }
    assert!(pieces > 100, "{pieces}");
    context.finish();
    assert_same(&context.output().unwrap(), &expected, "in pieces");
    // Another grid at the same place is another tile.
    let mut moved = posts;
    let c = eld_tile_t { posts: &raw const moved, ..c };
    let begin = |context: &mut Context, dropped: u64| {
        assert_eq!(context.begin_step(&c, 1), ELD_RUNNING);
        assert_eq!(context.telemetry().tiles_dropped, dropped);
    };
    begin(&mut context, 0);
    begin(&mut context, 0);
    // SAFETY: a structure of the test.
    unsafe { (&raw mut moved.row0).write(posts.row0 + 0.5) };
    begin(&mut context, 1);
}

#[test]
fn codes_count_only_with_their_flags() {
    let tile = Tile::golden();
    let codes = codes(&tile, 255.0);
    let bytes = frame(&codes, ELD_PIXELS_U8, 0);
    let with = |flags: u32| {
        let mut c = tile.c();
        c.image = eld_pixels_t { format: ELD_PIXELS_U8, flags, null_code: 1, saturated_from: 200, ..floats(&[]) };
        (c.image.data, c.image.data_bytes) = (bytes.as_ptr().cast(), bytes.len());
        let valid = heights_of(&c).1;
        valid.iter().map(|v| usize::from(*v)).sum::<usize>()
    };
    let none = with(0);
    let (null, saturated) = (with(ELD_PIXELS_HAS_NULL), with(ELD_PIXELS_HAS_SATURATED));
    let both = with(ELD_PIXELS_HAS_NULL | ELD_PIXELS_HAS_SATURATED);
    assert!(null < none && saturated < none && none - both == (none - null) + (none - saturated));
}

#[test]
fn a_tile_begun_in_pieces_is_the_one_begun_at_once() {
    for tile in [Tile::golden(), Tile::other()] {
        let (expected, c) = (tile.expected(), tile.c());
        for budget in [1, 5_000_000, u64::MAX] {
            let mut context = Context::new(nano());
            let mut pieces = 0;
            let begun = loop {
                match context.begin_step(&c, budget) {
                    ELD_RUNNING => pieces += 1,
                    status => break status,
                }
                assert_eq!(context.telemetry().phase, ELD_PHASE_PREPARING);
            };
            assert_eq!(begun, context_begin(&tile), "{budget}");
            assert!(
                match budget {
                    1 => pieces > 5 * ROWS,
                    5_000_000 => pieces > 2 && pieces < 100,
                    _ => pieces == 0,
                },
                "{pieces} pieces of {budget}"
            );
            context.finish();
            assert_same(&context.output().unwrap(), &expected, &format!("budget {budget}"));
        }
    }
}

/// Returns the status of a tile that is begun at once.
fn context_begin(tile: &Tile) -> eld_status_t {
    Context::new(nano()).begin(tile)
}

#[test]
fn another_structure_begins_another_tile() {
    let (tile, other, mut context) = (Tile::golden(), Tile::other(), Context::new(nano()));
    assert_eq!(context.begin_step(&tile.c(), STEP_MACS), ELD_RUNNING);
    // A structure that is refused leaves the tile in preparation.
    assert_eq!(context.begin_step(&eld_tile_t { pixel_m: 0.0, ..tile.c() }, 1), ELD_REFUSED_TILE_PIXEL);
    assert_eq!(context.begin_step(&eld_tile_t { sun_elevation_deg: 95.0, ..tile.c() }, 1), ELD_REFUSED_TILE_SUN);
    assert_eq!(context.begin_step(&tile.c(), 1), ELD_RUNNING);
    assert_eq!(context.telemetry().tiles_dropped, 0);
    // Another tile takes its place; the notice comes when that is begun.
    assert_eq!(context.begin_step(&other.c(), 1), ELD_RUNNING);
    assert_eq!(context.telemetry().tiles_dropped, 1);
    assert_eq!(context.begin_step(&other.c(), u64::MAX), ELD_NOTICE_DROPPED);
    context.finish();
    assert_same(&context.output().unwrap(), &other.expected(), "other");
    // Every field of the structure makes another tile.
    let changes: [fn(&mut eld_tile_t); 6] = [
        |tile| tile.coarse_px += 1.0,
        |tile| tile.sun_azimuth_deg += 1.0,
        |tile| tile.network_alone = 1,
        |tile| tile.processor_checks = 1,
        |tile| tile.image.gain = 2.0,
        |tile| (tile.valid, tile.valid_len) = (std::ptr::null(), 0),
    ];
    for change in changes {
        let mut changed = tile.c();
        change(&mut changed);
        let before = context.telemetry().tiles_dropped;
        assert_eq!(context.begin_step(&tile.c(), 1), ELD_RUNNING);
        assert_eq!(context.begin_step(&changed, 1), ELD_RUNNING);
        assert_eq!(context.telemetry().tiles_dropped, before + 1);
        assert_eq!(context.abort(), ELD_NOTICE_DROPPED);
    }
}

#[test]
fn a_tile_is_given_up_in_every_phase() {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    type Reach = (u32, eld_status_t, fn(&mut Context, &Tile));
    let reach: [Reach; 5] = [
        (ELD_PHASE_PREPARING, ELD_NOTICE_DROPPED, |context, tile| {
            assert_eq!(context.begin_step(&tile.c(), STEP_MACS), ELD_RUNNING);
        }),
        (ELD_PHASE_TILE, ELD_NOTICE_DROPPED, |context, tile| {
            assert_eq!((context.begin(tile), context.step(STEP_MACS)), (ELD_OK, ELD_RUNNING));
        }),
        (ELD_PHASE_TILE_DONE, ELD_OK, |context, tile| {
            assert_eq!(context.begin(tile), ELD_OK);
            context.finish();
        }),
        (ELD_PHASE_SELF_TEST, ELD_NOTICE_DROPPED, |context, _| assert_eq!(context.self_test_begin(), ELD_OK)),
        (ELD_PHASE_SELF_TEST_DONE, ELD_OK, |context, _| {
            assert_eq!(context.self_test_begin(), ELD_OK);
            context.finish();
        }),
    ];
    let mut dropped = 0;
    for (phase, expected, reach) in reach {
        reach(&mut context, &tile);
        assert_eq!(context.telemetry().phase, phase);
        assert_eq!(context.abort(), expected, "phase {phase}");
        dropped += u64::from(expected == ELD_NOTICE_DROPPED);
        let after = context.telemetry();
        assert_eq!((after.phase, after.valid_px, after.tiles_dropped), (ELD_PHASE_EMPTY, 0, dropped));
        assert_eq!((context.abort(), context.step(1)), (ELD_REFUSED_NO_TILE, ELD_REFUSED_NO_TILE));
        assert_eq!(context.output(), Err(ELD_REFUSED_NO_TILE));
    }
    // The same structure begins anew, without the notice of a tile that was dropped before.
    assert_eq!(context.begin(&tile), ELD_OK);
    context.finish();
    assert_same(&context.output().unwrap(), &tile.expected(), "after all");
}

#[test]
fn a_tile_that_shows_nothing_keeps_its_coarse_heights() {
    let tile = Tile { image: vec![50.0; PX], ..Tile::golden() };
    for budget in [1, u64::MAX] {
        let mut context = Context::new(nano());
        let begun = std::iter::repeat_with(|| context.begin_step(&tile.c(), budget)).find(|s| *s != ELD_RUNNING);
        assert_eq!(begun, Some(ELD_NOTICE_COARSE));
        context.finish();
        let found = context.output().unwrap();
        assert_same(&found, &tile.expected(), "coarse");
        let valid = found.1.iter().filter(|v| **v == 1).count();
        assert!(valid > PX / 2 && context.telemetry().valid_px as usize == valid);
        for (i, z) in found.0.iter().enumerate() {
            assert!(z.is_finite() && (found.1[i] == 0 || *z == tile.coarse_m[i]));
        }
        assert_eq!(context.errors().unwrap().explained, 0.0);
        // No light was needed.
        assert_eq!(context.telemetry().lights_assumed, 0);
    }
}

#[test]
fn the_network_alone_makes_other_heights() {
    let mut tile = Tile::golden();
    let usual = tile.expected();
    tile.network_alone = true;
    let alone = tile.expected();
    assert!(bits(&usual.0) != bits(&alone.0) && usual.1 == alone.1);
    assert_same(&heights_of(&tile.c()), &alone, "alone");
}

#[test]
fn a_processor_that_is_checked_makes_the_same_heights() {
    let mut tile = Tile::golden();
    let usual = tile.expected();
    tile.processor_checks = true;
    assert_same(&tile.expected(), &usual, "core");
    assert_same(&heights_of(&tile.c()), &usual, "C");
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
fn every_height_has_its_errors_and_its_origin() {
    let (mut dark, level) = (Tile::golden(), Tile { image: vec![50.0; PX], ..Tile::golden() });
    (0..PX).filter(|i| i % COLS > 200 && i / COLS > 150).for_each(|i| dark.image[i] *= 0.02);
    let mut seen = Vec::new();
    for tile in [Tile::golden(), dark, level] {
        let mut context = Context::new(nano());
        assert!(worked(context.begin(&tile)));
        context.finish();
        let (height_m, slope, origin) = context.error_maps().unwrap();
        let expected = tile.expected_maps();
        assert!(bits(&height_m) == bits(&expected.0) && bits(&slope) == bits(&expected.1) && origin == expected.2);
        let mut alone = vec![9; PX];
        // SAFETY: a context and a buffer of the test.
        let status = unsafe {
            let none = std::ptr::null_mut();
            ffi::eld_error_maps(context.handle, none, none, alone.as_mut_ptr(), PX)
        };
        assert!(status == ELD_OK && alone == origin);
        seen.extend(origin);
    }
    use elunar_core::photoclinometry::Origin;
    for (code, origin) in [
        (ELD_ORIGIN_IMAGE, Origin::Image),
        (ELD_ORIGIN_BLENDED, Origin::Blended),
        (ELD_ORIGIN_COARSE, Origin::Coarse),
        (ELD_ORIGIN_SHADOW, Origin::Shadow),
        (ELD_ORIGIN_VOID, Origin::Void),
    ] {
        assert_eq!(code, origin as u8);
        assert!(seen.contains(&code) || origin == Origin::Blended, "{origin:?}");
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
    // The rest of the budget went into sums that were rounded and bytes that were compared.
    assert!(halfway.entry > 0 && halfway.macs < STEP_MACS + needs.largest_unit_macs && halfway.steps == 1);
    assert!(halfway.macs > STEP_MACS / 2, "{}", halfway.macs);
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

#[test]
fn a_flipped_bit_of_the_program_changes_its_sum() {
    let mut code = nano()[..5_003].to_vec();
    let mut sum = 0;
    // SAFETY: memory of the test.
    let mut sum_of = |code: &[u8]| unsafe {
        assert_eq!(ffi::eld_code_sum(code.as_ptr().cast(), code.len(), &raw mut sum), ELD_OK);
        sum
    };
    let good = sum_of(&code);
    assert_eq!(good, elunar_core::nn::code_sum(&code));
    code[5_002] ^= 1;
    assert_ne!(sum_of(&code), good);
    let mut words = [0u32; 4];
    let place = words.as_mut_ptr();
    // SAFETY: as above; the library refuses memory that overlaps.
    assert_eq!(unsafe { ffi::eld_code_sum(place.cast(), 16, place.wrapping_add(3)) }, ELD_REFUSED_OVERLAP);
}

#[test]
fn a_refused_call_changes_nothing_of_the_tile() {
    let tile = Tile::golden();
    let mut context = Context::new(nano());
    assert_eq!(context.begin(&tile), ELD_OK);
    let mut status = ELD_RUNNING;
    while status == ELD_RUNNING {
        status = context.step(STEP_MACS);
        // All these calls are refused while a tile is in progress.
        if status == ELD_RUNNING {
            assert_eq!(context.output(), Err(ELD_REFUSED_NOT_DONE));
        }
        assert_eq!(context.self_test_check(), ELD_REFUSED_OTHER_TILE);
        let null = std::ptr::null_mut();
        // SAFETY: the test passes NULL.
        let output = unsafe { ffi::eld_output(context.handle, null, PX, null.cast(), 0) };
        // SAFETY: as above.
        let begin = unsafe { ffi::eld_begin(context.handle, std::ptr::null()) };
        assert_eq!((output, begin), (ELD_REFUSED_NULL, ELD_REFUSED_NULL));
    }
    assert_eq!(bits(&context.output().unwrap().0), bits(&tile.expected().0));
}
