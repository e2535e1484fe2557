//! Arbitrary calls on strips, terrain maps, model slots and checks of models by the C interface, for the fuzz target `c_lines` and its seeded
//! replay. Bytes choose the next function and errors in its arguments; bits of the lent memory flip between calls.
#![allow(unsafe_code)] // C functions

use crate::c_abi::{Tally, odd_light};
use crate::model::{Reader, sound_models};
use alloc::vec;
use alloc::vec::Vec;
use core::ffi::c_void;
use core::ptr::{null, null_mut};
use elunar_capi::ffi;
use elunar_capi::ffi::{slots::*, strip::*};
use elunar_capi::slots::types::*;
use elunar_capi::status::*;
use elunar_capi::strip::types::*;
use elunar_capi::types::*;
use elunar_core::nn::file::crc32c;
use elunar_core::nn::slots::ModelId;

/// Words before and after lent memory, which must not change.
const GUARD: usize = 16;
const GUARD_WORD: u64 = 0xc3c3_c3c3_c3c3_c3c3;
/// Most bytes of lent memory.
const LARGEST: u64 = 1 << 21;
/// Most columns of a line, and of a row of posts.
const COLS: usize = 40;
const POST_COLS: usize = 4;
/// Bytes of a slot and of a sector.
const SLOT: usize = 1 << 17;
const SECTOR: usize = 4096;

/// Lent memory between guards.
struct Room {
    memory: Vec<u64>,
    /// Whether nothing was damaged.
    whole: bool,
}

impl Room {
    fn new(bytes: usize) -> Self {
        Self { memory: vec![GUARD_WORD; bytes.div_ceil(8) + 2 * GUARD], whole: true }
    }

    fn at<T>(&mut self) -> *mut T {
        self.memory[GUARD..].as_mut_ptr().cast()
    }

    fn flip(&mut self, bit: usize) {
        let words = self.memory.len() - 2 * GUARD;
        self.memory[GUARD + bit / 64 % words] ^= 1 << (bit % 64);
        self.whole = false;
    }

    /// Changes bits of a word of the sealed state at the start of the memory, in both copies and under valid checksums; a copy that is
    /// damaged stays as it is.
    fn reseal(&mut self, word: usize, bits: u64) {
        let len = 8 * (self.memory.len() - 2 * GUARD);
        // SAFETY: the words of the memory as bytes, between calls.
        let bytes = unsafe { core::slice::from_raw_parts_mut(self.at::<u8>(), len) };
        let second = (16..len.min(1 << 12)).step_by(8).find(|&at| bytes[at..at + 8] == bytes[..8]);
        let seal_of = |body: &[u8]| u64::from(crc32c(body)) | u64::from(!crc32c(body)) << 32;
        for copy in bytes.chunks_exact_mut(second.unwrap_or(len)).take(2) {
            let (body, seal) = copy.split_at_mut(copy.len() - 8);
            if *seal == seal_of(body).to_le_bytes() {
                body[8 + 8 * word..][..8].iter_mut().zip(bits.to_le_bytes()).for_each(|(byte, flips)| *byte ^= flips);
                seal.copy_from_slice(&seal_of(body).to_le_bytes());
            }
        }
        self.whole = false;
    }

    /// Does the harm that `how` asks for, mostly none: a word of these of the sealed state says another place or length, or that a call did not
    /// return; or a bit flips.
    fn harm(&mut self, how: u8, words: &[usize], reader: &mut Reader<'_>) {
        match how {
            246..252 => self.reseal(words[how as usize % words.len()], 8 | 1 << 32),
            252.. => self.flip(reader.word() as usize),
            _ => {}
        }
    }

    fn guarded(&self) {
        let (front, rest) = self.memory.split_at(GUARD);
        let guards = front.iter().chain(&rest[rest.len() - GUARD..]);
        assert!(guards.copied().all(|word| word == GUARD_WORD), "memory that was not lent has changed");
    }
}

fn count(tally: &mut Tally, status: eld_status_t, may_fault: bool) -> eld_status_t {
    assert!(STATUSES.iter().any(|known| known.status == status), "{status:08x} is no status");
    tally.calls += 1;
    match severity(status) {
        GOOD | NOTICE => tally.worked += 1,
        REFUSED => tally.refused += 1,
        _ => {
            assert!(may_fault, "nothing was damaged: {:?}", text(status));
            tally.faults += 1;
        }
    }
    status
}

/// Runs calls chosen by `bytes`.
///
/// # Panics
/// If a status is unknown, undamaged memory leads to a fault, or memory that was not lent has changed.
pub fn c_lines(bytes: &[u8]) -> Tally {
    let (mut reader, mut tally) = (Reader(bytes), Tally::default());
    match reader.byte() % 4 {
        0 => terrain(&mut reader, &mut tally),
        1 => strip(&mut reader, &mut tally),
        2 => slots(&mut reader, &mut tally),
        _ => check(&mut reader, &mut tally),
    }
    tally
}

fn terrain(reader: &mut Reader<'_>, tally: &mut Tally) {
    let mut options = eld_terrain_options_t {
        struct_bytes: size_of::<eld_terrain_options_t>() as u32,
        cols: 1 + u32::from(reader.byte()) % COLS as u32,
        radius_px: 1 + u32::from(reader.byte()) % 3,
        row_m: 2.0,
        col_m: 1.5,
        slope_deg: 10.0,
        roughness_m: 0.5,
        sigmas: f32::from(reader.byte() % 3),
        sun_azimuth_deg: 300.0,
        sun_elevation_deg: 30.0,
    };
    match reader.byte() {
        0..16 => options.radius_px = reader.word(),
        16..32 => options.row_m = f32::from_bits(reader.word()),
        32..48 => options.cols = reader.word(),
        _ => {}
    }
    let (mut bytes, mut handle, mut row) = (0, null_mut(), 0);
    // SAFETY: structures and memory of the test, here and below.
    let planned = unsafe { ffi::eld_terrain_plan(&raw const options, &raw mut bytes) };
    if count(tally, planned, false) != ELD_OK || bytes > LARGEST {
        return;
    }
    let (mut room, cols) = (Room::new(bytes as usize), options.cols as usize);
    // SAFETY: as above.
    let made = unsafe { ffi::eld_terrain_init(room.at(), bytes as usize, &raw const options, &raw mut handle) };
    assert_eq!(count(tally, made, false), ELD_OK);
    let (mut line_m, slopes) = (vec![0f32; cols + 1], vec![0.1f32; cols]);
    let (mut floats, mut codes) = (vec![0f32; 3 * cols], vec![0u8; 2 * cols]);
    while !reader.0.is_empty() {
        let how = reader.byte();
        line_m.iter_mut().for_each(|z| *z = f32::from(reader.byte()) * if how == 9 { f32::NAN } else { 0.1 });
        let struct_bytes = size_of::<eld_terrain_maps_t>() as u32;
        let base = floats.as_mut_ptr();
        let part = |at: usize| base.wrapping_add(at * cols);
        let maps = eld_terrain_maps_t {
            struct_bytes: if how == 1 { 3 } else { struct_bytes },
            slope_deg: part(0),
            hillshade: codes.as_mut_ptr(),
            footprint_slope_deg: if how == 2 { part(0) } else { null_mut() },
            roughness_m: if how == 3 { room.at() } else { part(2) },
            hazard: codes.as_mut_ptr().wrapping_add(cols),
        };
        room.harm(how, &[0, 9], reader);
        let finishes = how % 8 == 7;
        // SAFETY: as above.
        let status = unsafe {
            if finishes {
                ffi::eld_terrain_finish(handle, &raw const maps, &raw mut row)
            } else {
                let slopes = if how & 64 == 0 { slopes.as_ptr() } else { null() };
                let line = if how == 4 { room.at::<f32>() } else { line_m.as_mut_ptr() };
                let len = if how == 5 { cols + 1 } else { cols };
                ffi::eld_terrain_push(handle, line, slopes, len, &raw const maps, &raw mut row)
            }
        };
        count(tally, status, !room.whole);
        room.guarded();
    }
}

fn strip_settings(
    reader: &mut Reader<'_>,
    check: *const eld_check_t,
    light: *const eld_lighting_t,
) -> eld_strip_settings_t {
    let pixels = eld_pixels_t {
        data: null(),
        data_bytes: 0,
        row_bytes: 0,
        format: u32::from(reader.byte()) % 6,
        flags: u32::from(reader.byte()) % 4,
        gain: 0.5,
        offset: 1.0,
        null_code: 0,
        saturated_from: 250,
    };
    let mut choice = || match reader.byte() {
        240.. => 2,
        byte => u32::from(byte) % 2,
    };
    let (network_alone, expected_errors) = (choice(), choice());
    eld_strip_settings_t {
        struct_bytes: size_of::<eld_strip_settings_t>() as u32,
        cols: 1 + u32::from(reader.byte()) % COLS as u32,
        ring_lines: [0, 0, 0, 70, reader.word()][reader.byte() as usize % 5],
        overlap_px: u32::from(reader.byte()) % 6,
        pixel_m: 2.0,
        coarse_px: 8.0,
        sun_azimuth_deg: if reader.byte().is_multiple_of(4) { f32::NAN } else { 300.0 },
        sun_elevation_deg: 30.0,
        network_alone,
        expected_errors,
        post_cols: u32::from(reader.byte()) % (POST_COLS as u32 + 1),
        processor_checks: u32::from(reader.byte() == 0),
        post_row0: 1.0,
        post_rows_per_line: 0.125,
        post_col0: 1.0,
        post_cols_per_px: 0.125,
        pixels,
        light,
        check,
    }
}

/// Makes a strip, after refusals of memory that is not aligned and that is too short.
fn make_strip(
    room: &mut Room,
    bytes: usize,
    (model, len): (*const c_void, usize),
    settings: *const eld_strip_settings_t,
    tally: &mut Tally,
) -> *mut eld_strip_t {
    let mut handle = null_mut();
    let attempts = [
        (4, bytes - 4, Some(ELD_REFUSED_MEMORY_ALIGNMENT)),
        (0, bytes - 1, Some(ELD_REFUSED_MEMORY_SHORT)),
        (0, bytes, None),
    ];
    for (shift, bytes, refusal) in attempts {
        let place = room.at::<c_void>().wrapping_byte_add(shift);
        // SAFETY: structures and memory of the test.
        let made = unsafe { eld_strip_init(place, bytes, model, len, settings, &raw mut handle) };
        count(tally, made, false);
        assert!(refusal.map_or(worked(made), |refusal| made == refusal), "{:?}", text(made));
    }
    handle
}

/// Asks a strip what it counted: into a structure on the stack, behind the model, or at a place that is refused.
fn strip_telemetry(handle: *mut eld_strip_t, room: &Room, how: u8, behind: *mut u8, own: *mut u8) -> eld_status_t {
    let struct_bytes = size_of::<eld_strip_telemetry_t>() as u32;
    let mut out = eld_strip_telemetry_t { struct_bytes, ..Default::default() };
    let told = if how % 5 == 1 { behind.cast() } else { &raw mut out };
    // SAFETY: a strip and structures of the test, or refused.
    let status = unsafe {
        told.write(out);
        eld_strip_telemetry(handle, if how.is_multiple_of(5) { own.cast() } else { told })
    };
    // SAFETY: written above.
    let out = unsafe { told.read() };
    let lost = out.memory_faults + out.pieces_lost + out.tiles_again;
    assert!(!room.whole || worked(status) != how.is_multiple_of(5) && lost == 0, "{out:?}");
    status
}

fn strip(reader: &mut Reader<'_>, tally: &mut Tally) {
    let sound = sound_models()[reader.byte() as usize % sound_models().len()];
    let mut model = [sound, &[0; 256]].concat();
    let mut info = eld_model_info_t { struct_bytes: size_of::<eld_model_info_t>() as u32, ..Default::default() };
    let place = model.as_mut_ptr();
    let behind = place.wrapping_add(sound.len().next_multiple_of(8));
    let (mut check, file) = (eld_check_t::default(), (place.cast_const().cast(), sound.len()));
    // SAFETY: structures and memory of the test, here and below.
    let checked = unsafe { ffi::eld_model_check_step(file.0, file.1, u64::MAX, &raw mut check, &raw mut info) };
    assert_eq!(checked, ELD_OK);
    let known = if reader.byte().is_multiple_of(2) { &raw const check } else { null() };
    let light = odd_light(reader);
    let stated = if reader.byte() < 64 { &raw const light } else { null() };
    let (settings, mut bytes) = (strip_settings(reader, known, stated), 0);
    // SAFETY: as above.
    let planned = unsafe { eld_strip_plan(file.0, file.1, &raw const settings, &raw mut bytes) };
    if count(tally, planned, false) != ELD_OK || bytes > LARGEST {
        return;
    }
    let mut room = Room::new(bytes as usize);
    let handle = make_strip(&mut room, bytes as usize, file, &settings, tally);
    let cols = settings.cols as usize;
    let pixel_bytes = [4, 1, 2, 2, 2][settings.pixels.format as usize % 5];
    // A row of posts may have more columns than a line.
    let (mut floats, mut origins, mut line) = (vec![0f32; 3 * cols.max(POST_COLS)], vec![0u8; cols], 0);
    while !reader.0.is_empty() {
        let (how, noise) = (reader.byte(), reader.byte());
        let pixels: Vec<u8> =
            (0..pixel_bytes * cols).map(|i| (i * 37 % 97) as u8 ^ noise.wrapping_mul(i as u8)).collect();
        floats.iter_mut().enumerate().for_each(|(i, z)| *z = (i * 5 % 17) as f32 + f32::from(noise) * 0.1);
        let base = floats.as_mut_ptr();
        let part = |at: usize| base.wrapping_add(at * cols);
        let (a, b, c) = (part(0), part(1), part(2));
        let own = if noise.is_multiple_of(2) { room.at() } else { place };
        if noise < 64 {
            room.harm(how, &[0, 1, 6, 6, 6, 6], reader);
            if how >= 254 {
                // SAFETY: a byte of the model, between calls; what flips in the memory is told, too.
                unsafe { *place.add(reader.word() as usize % sound.len()) ^= how };
            }
        }
        // SAFETY: as above.
        let status = unsafe {
            match how % 12 {
                0..=3 => {
                    let coarse = if settings.post_cols > 0 { (null(), 0) } else { (a.cast_const(), cols) };
                    let data = if how == 24 { own } else { pixels.as_ptr().cast_mut() };
                    eld_strip_push(handle, data.cast(), pixels.len(), coarse.0, coarse.1)
                }
                4 => {
                    let posts = if how.is_multiple_of(5) { own.cast() } else { a };
                    eld_strip_push_posts(handle, posts, settings.post_cols as usize)
                }
                5..=7 => eld_strip_step(handle, [1, 1 << 14, u64::MAX][how as usize % 3]),
                8 => eld_strip_take(handle, a, b, c, origins.as_mut_ptr(), cols, &raw mut line),
                9 => eld_strip_take(handle, a, null_mut(), null_mut(), null_mut(), cols, &raw mut line),
                10 if how > 240 => eld_strip_finish(handle),
                10 if how > 200 => eld_strip_finish_posts(handle),
                10 => eld_strip_scrub(handle, reader.byte() as usize * 64),
                _ => strip_telemetry(handle, &room, how, behind, own),
            }
        };
        count(tally, status, !room.whole);
        tally.tiles += usize::from(status == ELD_NOTICE_STRIP_DONE);
        room.guarded();
    }
}

/// The storage of slots, and how the driver has it wrong.
struct Driver {
    regions: [Vec<u8>; 4],
    read: Vec<u8>,
    has_read: bool,
}

fn slots(reader: &mut Reader<'_>, tally: &mut Tally) {
    let models = sound_models();
    let model = models[reader.byte() as usize % models.len()];
    let mut driver = Driver {
        regions: [vec![0xff; SLOT], vec![0xff; SLOT], vec![0xff; SECTOR], vec![0xff; SECTOR]],
        read: Vec::new(),
        has_read: false,
    };
    if !reader.byte().is_multiple_of(4) && model.len() <= SLOT {
        driver.regions[0][..model.len()].copy_from_slice(model);
    }
    let storage = eld_slots_storage_t {
        struct_bytes: size_of::<eld_slots_storage_t>() as u32,
        slot_sector_bytes: SECTOR as u32,
        record_bytes: SECTOR as u32,
        record_sector_bytes: if reader.byte() == 0 { 0 } else { SECTOR as u32 },
        slot_bytes: SLOT as u64,
    };
    let (mut room, mut handle) = (Room::new(ELD_SLOTS_BYTES as usize), null_mut());
    // SAFETY: structures and memory of the test, here and below.
    let made = unsafe { eld_slots_init(room.at(), ELD_SLOTS_BYTES as usize, &raw const storage, &raw mut handle) };
    if count(tally, made, false) != ELD_OK {
        return;
    }
    let upload = models[reader.byte() as usize % models.len()];
    let id = ModelId::of(upload);
    while !reader.0.is_empty() {
        let how = reader.byte();
        let mut state = eld_slots_state_t { struct_bytes: size_of::<eld_slots_state_t>() as u32, ..Default::default() };
        if how >= 252 {
            room.flip(reader.word() as usize);
        }
        // SAFETY: as above.
        let begun = unsafe {
            count(tally, eld_slots_state(handle, &raw mut state), !room.whole);
            match how % 8 {
                0 | 1 => eld_slots_boot(handle),
                2 => eld_slots_reject(handle),
                3 => eld_slots_upload(handle, id.file_bytes ^ u32::from(how == 3), id.header_crc),
                4 | 5 => {
                    let at = (state.uploaded_bytes as usize).min(upload.len());
                    let len = (reader.size(upload.len().max(1)) % (1 << 15)).min(upload.len() - at);
                    eld_slots_write(handle, at as u64, upload.as_ptr().wrapping_add(at).cast(), len)
                }
                6 => eld_slots_start_trial(handle, u32::from(reader.byte() % 20)),
                _ => eld_slots_confirm(handle, null_mut()),
            }
        };
        let status = count(tally, begun, !room.whole);
        if status == ELD_RUNNING {
            drive(handle, &mut driver, reader, tally, room.whole);
        }
        room.guarded();
    }
}

/// Does what is wanted, mostly.
fn drive(handle: *mut eld_slots_t, driver: &mut Driver, reader: &mut Reader<'_>, tally: &mut Tally, whole: bool) {
    let struct_bytes = size_of::<eld_slots_want_t>() as u32;
    let mut want =
        eld_slots_want_t { struct_bytes, what: 0, region: 0, reserved: 0, offset_bytes: 0, bytes: 0, data: null() };
    (driver.has_read, driver.read) = (false, Vec::new());
    // Begun and left, sometimes.
    let most = if reader.byte() == 1 { 3 } else { usize::MAX };
    for _ in 0..most {
        let (data, len) = if driver.has_read { (driver.read.as_ptr(), driver.read.len()) } else { (null(), 0) };
        let error = u32::from(reader.byte() == 200);
        // SAFETY: a buffer and structures of the test.
        let status = unsafe { eld_slots_step(handle, data.cast(), len, error, 1 << 20, &raw mut want) };
        if count(tally, status, true) != ELD_RUNNING {
            assert!(!whole || severity(status) != FAULT || status >> 16 & 0xff == 8, "{:?}", text(status));
            break;
        }
        let (at, len) = (want.offset_bytes as usize, want.bytes as usize);
        let region = &mut driver.regions[want.region as usize];
        match want.what {
            ELD_SLOTS_READ => {
                driver.read = region[at..at + len].to_vec();
                if reader.byte() == 201 {
                    driver.read.iter_mut().take(1).for_each(|byte| *byte ^= 1);
                }
            }
            ELD_SLOTS_ERASE => region[at..at + SECTOR].fill(0xff),
            ELD_SLOTS_WRITE => {
                // SAFETY: a record in the slots' memory, or the chunk.
                region[at..at + len].copy_from_slice(unsafe { core::slice::from_raw_parts(want.data.cast(), len) });
            }
            _ => {}
        }
        driver.has_read = matches!(want.what, ELD_SLOTS_READ | ELD_SLOTS_READ_AGAIN);
    }
}

fn check(reader: &mut Reader<'_>, tally: &mut Tally) {
    let mut model = sound_models()[reader.byte() as usize % sound_models().len()].to_vec();
    let mut info = eld_model_info_t { struct_bytes: size_of::<eld_model_info_t>() as u32, ..Default::default() };
    let (mut check, mut harmed) = (eld_check_t::default(), false);
    while !reader.0.is_empty() {
        let (how, word) = (reader.byte(), reader.word() as usize);
        match how {
            0..16 => {
                check.words[word / 64 % 11] ^= 1 << (word % 64);
                harmed = true;
            }
            16..24 => {
                let at = word % model.len();
                model[at] ^= how | 1;
                harmed = true;
            }
            _ => {}
        }
        let budget = 1u64 << (how % 24);
        // SAFETY: structures and a model of the test.
        let status = unsafe {
            let (bytes, len) = (model.as_ptr().cast(), model.len());
            ffi::eld_model_check_step(bytes, len, budget, &raw mut check, &raw mut info)
        };
        count(tally, status, harmed);
        assert!(worked(status) || harmed, "a sound model: {:?}", text(status));
        assert!(worked(status) || check == eld_check_t::default(), "and yet something is kept");
    }
}
