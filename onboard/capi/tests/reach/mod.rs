//! How `refusals.rs` reaches the statuses.

use crate::common::*;
use elunar_capi::ffi;
use elunar_capi::status::*;
use elunar_capi::types::*;
use elunar_core::nn::file::crc32c;
use elunar_core::strip::PostGrid;
use std::ptr::{null, null_mut};

pub(crate) fn init(memory: *mut u64, bytes: usize, model: &[u8]) -> eld_status_t {
    let mut handle = null_mut();
    // SAFETY: buffers of the test, or refused before they are used.
    let status = unsafe { ffi::eld_init(memory.cast(), bytes, model.as_ptr().cast(), model.len(), &raw mut handle) };
    assert_eq!(handle.is_null(), !worked(status));
    status
}

/// Returns the status of a changed model, after a check that both validating functions refuse it.
pub(crate) fn validated(model: &[u8]) -> eld_status_t {
    let mut memory = vec![7u64; 200_000];
    let checked = info(model).unwrap_err();
    assert_eq!(init(memory.as_mut_ptr(), 8 * memory.len(), model), checked);
    assert!(memory.iter().all(|word| *word == 7), "refused, and yet changed");
    checked
}

/// Checks nano, a piece of so much at first; then all of the rest after a change.
pub(crate) fn check_step(first: u64, change: fn(&mut eld_check_t)) -> eld_status_t {
    let mut check = eld_check_t::default();
    let mut info = eld_model_info_t { struct_bytes: size_of::<eld_model_info_t>() as u32, ..Default::default() };
    let model = (nano().as_ptr().cast(), nano().len());
    // SAFETY: a slice and structures of the test.
    unsafe {
        let status = ffi::eld_model_check_step(model.0, model.1, first, &raw mut check, &raw mut info);
        assert_eq!(status, ELD_RUNNING);
        change(&mut check);
        ffi::eld_model_check_step(model.0, model.1, u64::MAX, &raw mut check, &raw mut info)
    }
}

/// Makes a context with a check of so much of nano.
pub(crate) fn init_checked(budget_macs: u64) -> eld_status_t {
    let (mut check, mut handle) = (eld_check_t::default(), null_mut());
    let mut info = info(nano()).unwrap();
    let mut memory = vec![7u64; (info.memory_bytes as usize).div_ceil(8)];
    let model = (nano().as_ptr().cast(), nano().len());
    // SAFETY: buffers and structures of the test.
    unsafe {
        ffi::eld_model_check_step(model.0, model.1, budget_macs, &raw mut check, &raw mut info);
        let place = memory.as_mut_ptr().cast();
        ffi::eld_init_checked(place, info.memory_bytes as usize, model.0, model.1, &raw const check, &raw mut handle)
    }
}

pub(crate) fn begun() -> Context {
    let mut context = Context::new(nano());
    assert_eq!(context.begin(&Tile::golden()), ELD_OK);
    context
}

/// Begins the golden tile with a change of the structure.
pub(crate) fn begin_with(change: impl FnOnce(&mut eld_tile_t)) -> eld_status_t {
    let (tile, context) = (Tile::golden(), Context::new(nano()));
    let mut c = tile.c();
    change(&mut c);
    // SAFETY: a context and a tile of the test; wrong fields are refused before they are used.
    unsafe { ffi::eld_begin(context.handle, &c) }
}

/// Begins the golden tile with posts, with a change of the structures.
pub(crate) fn begin_posts(change: fn(&mut eld_tile_t, &mut eld_posts_t)) -> eld_status_t {
    begin_posts_of(-1900.0, change)
}

pub(crate) fn begin_posts_of(height_m: f32, change: fn(&mut eld_tile_t, &mut eld_posts_t)) -> eld_status_t {
    let (tile, context, posts_m) = (Tile::golden(), Context::new(nano()), [height_m; 12]);
    let mut posts = posts(&posts_m, PostGrid::spaced(4, (0.0, 0.0), (100.0, 100.0)));
    let mut c = eld_tile_t { coarse_m: null(), coarse_len: 0, ..tile.c() };
    c.posts = &raw const posts;
    change(&mut c, &mut posts);
    // SAFETY: a context and a tile of the test; wrong fields are refused before they are used.
    unsafe { ffi::eld_begin(context.handle, &c) }
}

/// Asks for the Sun at a time and a latitude.
pub(crate) fn sun(days: f64, lat_deg: f64) -> eld_status_t {
    let mut out = eld_sun_t { struct_bytes: size_of::<eld_sun_t>() as u32, ..Default::default() };
    // SAFETY: a structure of the test.
    unsafe { ffi::eld_sun_position(days, lat_deg, 0.0, &raw mut out) }
}

/// Pushes so many lines of three pixels, the last after a change of the memory; or two, finishes one, and pushes another.
pub(crate) fn terrain_calls(lines: Option<usize>, change: fn(&mut [u64])) -> eld_status_t {
    let options = eld_terrain_options_t {
        struct_bytes: size_of::<eld_terrain_options_t>() as u32,
        cols: 3,
        radius_px: 2,
        row_m: 2.0,
        col_m: 2.0,
        slope_deg: 10.0,
        roughness_m: 0.5,
        ..Default::default()
    };
    let (mut memory, mut handle, mut row, line) = (vec![7u64; 200], null_mut(), 0, [1.0f32; 3]);
    let mut hazard = [0u8; 3];
    let maps = eld_terrain_maps_t {
        struct_bytes: size_of::<eld_terrain_maps_t>() as u32,
        slope_deg: null_mut(),
        hillshade: null_mut(),
        footprint_slope_deg: null_mut(),
        roughness_m: null_mut(),
        hazard: hazard.as_mut_ptr(),
    };
    // SAFETY: memory and structures of the test.
    unsafe {
        let mut bytes = 0;
        assert_eq!(ffi::eld_terrain_plan(&raw const options, &raw mut bytes), ELD_OK);
        let needed = (bytes as usize).div_ceil(8);
        memory.truncate(needed);
        let status =
            ffi::eld_terrain_init(memory.as_mut_ptr().cast(), bytes as usize, &raw const options, &raw mut handle);
        assert_eq!(status, ELD_OK);
        let mut push = || ffi::eld_terrain_push(handle, line.as_ptr(), null(), 3, &raw const maps, &raw mut row);
        for _ in 1..lines.unwrap_or(3) {
            push();
        }
        if lines.is_none() {
            let mut row = 0;
            assert_eq!(ffi::eld_terrain_finish(handle, &raw const maps, &raw mut row), ELD_OK);
            return ffi::eld_terrain_push(handle, line.as_ptr(), null(), 3, &raw const maps, &raw mut row);
        }
        // The memory is lent between calls only.
        change(std::slice::from_raw_parts_mut(handle.cast(), needed));
        ffi::eld_terrain_push(handle, line.as_ptr(), null(), 3, &raw const maps, &raw mut row)
    }
}

pub(crate) fn begin_tile(change: impl FnOnce(&mut Tile)) -> eld_status_t {
    let mut tile = Tile::golden();
    change(&mut tile);
    Context::new(nano()).begin(&tile)
}

pub(crate) fn output_of(
    context: &Context,
    heights_m: *mut f32,
    heights_len: usize,
    valid: *mut u8,
    valid_len: usize,
) -> eld_status_t {
    // SAFETY: a context of the test; the buffers are refused before they are used.
    unsafe { ffi::eld_output(context.handle, heights_m, heights_len, valid, valid_len) }
}

/// Returns a tile that is prepared in a context.
pub(crate) fn preparing() -> (Tile, Context) {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    assert_eq!(context.begin_step(&tile.c(), STEP_MACS / 10), ELD_RUNNING);
    assert_eq!(context.telemetry().phase, ELD_PHASE_PREPARING);
    (tile, context)
}

pub(crate) fn finished() -> Context {
    let mut context = begun();
    context.finish();
    context
}

/// Begins a tile of 2,048 pixels, changed by `change`, with a model of `tests/golden/provoked`.
pub(crate) fn begin_small(model: &str, change: fn(&mut Tile)) -> (Context, eld_status_t) {
    // The context outlives this function.
    let model = std::fs::read(repository().join("tests/golden/provoked").join(model)).unwrap().leak();
    let mut context = Context::new(model);
    let mut tile = Tile { valid: None, ..Tile::golden() };
    tile.image.truncate(32 * 64);
    tile.coarse_m.truncate(32 * 64);
    change(&mut tile);
    let status = context.begin(&tile);
    (context, status)
}

/// Returns a model on the heap, whose bytes may change, and its context.
pub(crate) fn own_model() -> (Vec<u8>, Context) {
    let model = nano().to_vec();
    let context = Context::new(&model);
    (model, context)
}

/// Sets the word of the context that says "a call is changing the arena", under valid checksums, as after a call that did not return.
pub(crate) fn interrupt(context: &mut Context) {
    let copy_bytes = context.head_bytes() / 2;
    // Behind the magic, in half of the seventh word.
    let busy = 8 * (1 + 6) + 4;
    for copy in context.bytes()[..2 * copy_bytes].chunks_mut(copy_bytes) {
        assert_eq!(copy[busy], 0);
        copy[busy] = 1;
        let crc = crc32c(&copy[..copy_bytes - 8]);
        let seal = u64::from(crc) | u64::from(!crc) << 32;
        copy[copy_bytes - 8..].copy_from_slice(&seal.to_le_bytes());
    }
}

/// Steps until a tile is done or lost; returns the status.
pub(crate) fn to_the_end(context: &mut Context) -> eld_status_t {
    loop {
        match context.step(STEP_MACS) {
            ELD_RUNNING => {}
            status => return status,
        }
    }
}
