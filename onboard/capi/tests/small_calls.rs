//! Strips, terrain maps, the light of a scene, model slots and checks in pieces with models so small that Miri runs them: `./ci.sh miri`.
#![allow(unsafe_code)] // C functions

mod small;
use elunar_capi::ffi::{self, slots::*, strip::*};
use elunar_capi::slots::types::*;
use elunar_capi::status::*;
use elunar_capi::strip::types::*;
use elunar_capi::types::*;
use small::{PX, SHAPE};
use std::ptr::{null, null_mut};

/// As aligned as the library asks for; an array of `u64` is not on every machine of 32 bits.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(8))]
struct Word([u8; 8]);

fn room(bytes: u64) -> Vec<Word> {
    vec![Word([0x55; 8]); (bytes as usize).div_ceil(8)]
}

/// Checks a model in pieces.
fn checked(model: &[u8]) -> (eld_check_t, eld_model_info_t) {
    let (mut check, mut info) = (eld_check_t::default(), eld_model_info_t::default());
    info.struct_bytes = size_of::<eld_model_info_t>() as u32;
    let mut pieces = 0;
    // SAFETY: structures and a model of the test, here and below.
    while unsafe { ffi::eld_model_check_step(model.as_ptr().cast(), model.len(), 1, &raw mut check, &raw mut info) }
        == ELD_RUNNING
    {
        pieces += 1;
    }
    assert!(pieces > 2 && info.memory_bytes > 0);
    (check, info)
}

fn context(model: &[u8], memory: &mut Vec<Word>) -> *mut eld_context_t {
    let (check, info) = checked(model);
    *memory = room(info.memory_bytes);
    let mut handle = null_mut();
    let place = memory.as_mut_ptr().cast();
    // SAFETY: memory of the test.
    let status = unsafe {
        let (file, bytes) = (model.as_ptr().cast(), info.memory_bytes as usize);
        ffi::eld_init_checked(place, bytes, file, model.len(), &raw const check, &raw mut handle)
    };
    assert_eq!(status, ELD_OK);
    handle
}

fn pixels(map: &[f32]) -> eld_pixels_t {
    eld_pixels_t {
        data: map.as_ptr().cast(),
        data_bytes: size_of_val(map),
        row_bytes: 0,
        format: ELD_PIXELS_F32,
        flags: 0,
        gain: 1.0,
        offset: 0.0,
        null_code: 0,
        saturated_from: 0,
    }
}

#[test]
fn a_self_test_and_the_light_of_a_scene() {
    let (model, mut memory) = (small::model(), Vec::new());
    let handle = context(&model, &mut memory);
    let image: Vec<f32> = (0..PX).map(|i| (i * 7 % 11) as f32).collect();
    let coarse_m: Vec<f32> = (0..PX).map(|i| (i % 5) as f32).collect();
    let tile = eld_tile_t {
        struct_bytes: size_of::<eld_tile_t>() as u32,
        pixel_m: 2.0,
        coarse_px: 4.0,
        sun_azimuth_deg: f32::NAN,
        sun_elevation_deg: f32::NAN,
        network_alone: 0,
        processor_checks: 0,
        image: pixels(&image),
        coarse_m: coarse_m.as_ptr(),
        coarse_len: PX,
        valid: null(),
        valid_len: 0,
        posts: null(),
        light: null(),
    };
    let mut light = eld_lighting_t { struct_bytes: size_of::<eld_lighting_t>() as u32, ..Default::default() };
    // SAFETY: structures of the test, here and below.
    unsafe {
        assert_eq!(ffi::eld_self_test_begin(handle), ELD_OK);
        while ffi::eld_step(handle, 1) == ELD_RUNNING {}
        assert_eq!(ffi::eld_self_test_check(handle), ELD_OK);
        while ffi::eld_light_add(handle, &raw const tile, 1000) == ELD_RUNNING {}
        assert_eq!(ffi::eld_light_decide(handle, f32::NAN, f32::NAN, &raw mut light), ELD_OK);
        let lit = eld_tile_t { light: &raw const light, ..tile };
        assert!(worked(ffi::eld_begin(handle, &raw const lit)));
        assert_eq!(ffi::eld_light_clear(handle), ELD_OK);
    }
}

#[test]
fn a_strip() {
    let (model, (rows, cols)) = (small::model(), SHAPE);
    let (check, _) = checked(&model);
    let settings = eld_strip_settings_t {
        struct_bytes: size_of::<eld_strip_settings_t>() as u32,
        cols: cols as u32 + 2,
        ring_lines: 0,
        overlap_px: 1,
        pixel_m: 2.0,
        coarse_px: 4.0,
        sun_azimuth_deg: 300.0,
        sun_elevation_deg: 30.0,
        network_alone: 0,
        expected_errors: 1,
        post_cols: 0,
        processor_checks: 0,
        post_row0: 0.0,
        post_rows_per_line: 0.0,
        post_col0: 0.0,
        post_cols_per_px: 0.0,
        pixels: pixels(&[]),
        light: null(),
        check: &raw const check,
    };
    let (mut bytes, mut strip, wide) = (0, null_mut(), cols + 2);
    let file = (model.as_ptr().cast(), model.len());
    // SAFETY: structures and memory of the test, here and below.
    assert_eq!(unsafe { eld_strip_plan(file.0, file.1, &raw const settings, &raw mut bytes) }, ELD_OK);
    let mut memory = room(bytes);
    // SAFETY: as above.
    let made = unsafe {
        let place = memory.as_mut_ptr().cast();
        eld_strip_init(place, bytes as usize, file.0, file.1, &raw const settings, &raw mut strip)
    };
    assert!(worked(made), "{:?}", text(made));
    let (mut pushed, mut taken, mut next) = (0, 0, ELD_RUNNING);
    let (mut a, mut b, mut c, mut origins) = (vec![0f32; wide], vec![0f32; wide], vec![0f32; wide], vec![0u8; wide]);
    while next != ELD_NOTICE_STRIP_DONE {
        // SAFETY: as above.
        next = unsafe { eld_strip_step(strip, 5000) };
        assert!(worked(next), "{:?}", text(next));
        if next == ELD_NOTICE_STRIP_PUSH && pushed < rows + 2 {
            let line: Vec<f32> = (0..wide).map(|col| ((pushed * 5 + col * 7) % 11) as f32).collect();
            // SAFETY: as above.
            let status = unsafe { eld_strip_push(strip, line.as_ptr().cast(), 4 * wide, line.as_ptr(), wide) };
            assert_eq!(status, ELD_OK);
            pushed += 1;
        } else if next == ELD_NOTICE_STRIP_PUSH {
            // SAFETY: as above.
            assert_eq!(unsafe { eld_strip_finish(strip) }, ELD_OK);
        }
        let mut line = 0;
        // SAFETY: as above.
        while unsafe {
            let errors = (b.as_mut_ptr(), c.as_mut_ptr(), origins.as_mut_ptr());
            eld_strip_take(strip, a.as_mut_ptr(), errors.0, errors.1, errors.2, wide, &raw mut line)
        } == ELD_OK
        {
            taken += 1;
        }
        // SAFETY: as above.
        assert_eq!(unsafe { eld_strip_scrub(strip, 100) }, ELD_OK);
    }
    assert_eq!(taken, rows + 2);
}

#[test]
fn terrain_maps() {
    const COLS: usize = 5;
    let options = eld_terrain_options_t {
        struct_bytes: size_of::<eld_terrain_options_t>() as u32,
        cols: COLS as u32,
        radius_px: 1,
        row_m: 2.0,
        col_m: 2.0,
        slope_deg: 10.0,
        roughness_m: 0.5,
        sigmas: 1.0,
        sun_azimuth_deg: 300.0,
        sun_elevation_deg: 30.0,
    };
    let (mut bytes, mut handle, mut row, mut lines) = (0, null_mut(), 0, 0);
    // SAFETY: structures and memory of the test, here and below.
    assert_eq!(unsafe { ffi::eld_terrain_plan(&raw const options, &raw mut bytes) }, ELD_OK);
    let mut memory = room(bytes);
    // SAFETY: as above.
    let made = unsafe {
        ffi::eld_terrain_init(memory.as_mut_ptr().cast(), bytes as usize, &raw const options, &raw mut handle)
    };
    assert_eq!(made, ELD_OK);
    let (mut slope, mut tilt, mut rough) = ([0f32; COLS], [0f32; COLS], [0f32; COLS]);
    let (mut shade, mut hazard) = ([0u8; COLS], [0u8; COLS]);
    let maps = eld_terrain_maps_t {
        struct_bytes: size_of::<eld_terrain_maps_t>() as u32,
        slope_deg: slope.as_mut_ptr(),
        hillshade: shade.as_mut_ptr(),
        footprint_slope_deg: tilt.as_mut_ptr(),
        roughness_m: rough.as_mut_ptr(),
        hazard: hazard.as_mut_ptr(),
    };
    for line in 0..7 {
        let line_m: [f32; COLS] = std::array::from_fn(|col| ((line * 3 + col) % 4) as f32 * 0.1);
        // SAFETY: as above.
        let status = unsafe {
            if line < 5 {
                let slopes = [0.01f32; COLS];
                ffi::eld_terrain_push(handle, line_m.as_ptr(), slopes.as_ptr(), COLS, &raw const maps, &raw mut row)
            } else {
                ffi::eld_terrain_finish(handle, &raw const maps, &raw mut row)
            }
        };
        lines += usize::from(status == ELD_OK);
    }
    assert_eq!(lines, 5);
}

#[test]
#[expect(clippy::too_many_lines, reason = "an update from its first step to its last")]
fn slots() {
    const SECTOR: usize = 128;
    let model = small::model();
    let slot_bytes = model.len().next_multiple_of(SECTOR);
    let mut regions = [vec![0xffu8; slot_bytes], vec![0xff; slot_bytes], vec![0xff; SECTOR], vec![0xff; SECTOR]];
    regions[0][..model.len()].copy_from_slice(&model);
    let storage = eld_slots_storage_t {
        struct_bytes: size_of::<eld_slots_storage_t>() as u32,
        slot_sector_bytes: SECTOR as u32,
        record_bytes: SECTOR as u32,
        record_sector_bytes: SECTOR as u32,
        slot_bytes: slot_bytes as u64,
    };
    let (mut memory, mut slots) = (room(ELD_SLOTS_BYTES.into()), null_mut());
    // SAFETY: structures and memory of the test, here and below.
    let made = unsafe {
        let place = memory.as_mut_ptr().cast();
        eld_slots_init(place, ELD_SLOTS_BYTES as usize, &raw const storage, &raw mut slots)
    };
    assert_eq!(made, ELD_OK);
    let mut drive = |begun: eld_status_t| {
        let struct_bytes = size_of::<eld_slots_want_t>() as u32;
        let mut want =
            eld_slots_want_t { struct_bytes, what: 0, region: 0, reserved: 0, offset_bytes: 0, bytes: 0, data: null() };
        let (mut status, mut read, mut has_read) = (begun, Vec::<u8>::new(), false);
        while status == ELD_RUNNING {
            let (data, len) = if has_read { (read.as_ptr(), read.len()) } else { (null(), 0) };
            // SAFETY: as above.
            status = unsafe { eld_slots_step(slots, data.cast(), len, 0, 1 << 20, &raw mut want) };
            let (at, len) = (want.offset_bytes as usize, want.bytes as usize);
            let region = &mut regions[want.region as usize];
            has_read = matches!(want.what, ELD_SLOTS_READ | ELD_SLOTS_READ_AGAIN);
            match want.what {
                ELD_SLOTS_READ => read = region[at..at + len].to_vec(),
                ELD_SLOTS_ERASE => region[at..at + SECTOR].fill(0xff),
                ELD_SLOTS_WRITE => {
                    // SAFETY: a record in the slots' memory, or the chunk.
                    let bytes = unsafe { std::slice::from_raw_parts(want.data.cast(), len) };
                    region[at..at + len].copy_from_slice(bytes);
                }
                _ => {}
            }
        }
        status
    };
    // SAFETY: as above.
    unsafe {
        assert_eq!(drive(eld_slots_boot(slots)), ELD_NOTICE_SLOTS_SALVAGED);
        let mut lent = Vec::new();
        let context = context(&model, &mut lent);
        assert_eq!(ffi::eld_self_test_begin(context), ELD_OK);
        while ffi::eld_step(context, u64::MAX) == ELD_RUNNING {}
        assert_eq!(drive(eld_slots_confirm(slots, context)), ELD_OK);
        let id = elunar_core::nn::slots::ModelId::of(&model);
        assert_eq!(drive(eld_slots_upload(slots, id.file_bytes, id.header_crc)), ELD_OK);
        for (number, chunk) in model.chunks(256).enumerate() {
            let begun = eld_slots_write(slots, 256 * number as u64, chunk.as_ptr().cast(), chunk.len());
            assert_eq!(drive(begun), ELD_OK);
        }
        assert_eq!(drive(eld_slots_start_trial(slots, 1)), ELD_OK);
        assert_eq!(drive(eld_slots_boot(slots)), ELD_NOTICE_SLOTS_TRIAL);
        assert_eq!(drive(eld_slots_reject(slots)), ELD_OK);
        let struct_bytes = size_of::<eld_slots_state_t>() as u32;
        let mut known = eld_slots_state_t { struct_bytes, ..Default::default() };
        assert_eq!(eld_slots_state(slots, &raw mut known), ELD_OK);
        assert_eq!((known.standing, known.rollbacks), (ELD_STANDING_CONFIRMED, 1));
    }
}
