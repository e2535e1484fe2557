//! Pointers into each other's memory: refused before anything is read or written. The tests are small enough for Miri, which finds what
//! the language forbids: `./ci.sh miri`.
#![allow(unsafe_code)] // C functions

mod small;
use elunar_capi::ffi::*;
use elunar_capi::status::*;
use elunar_capi::types::*;
use small::PX;
use std::mem::{align_of, size_of};
use std::ptr::{null, null_mut};

/// As aligned as the library may ask; an array of `u64` is not on every machine of 32 bits.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
struct Line([u8; 64]);

/// Bytes that a C program may have anywhere.
struct Block {
    lines: Vec<Line>,
    bytes: usize,
}

impl Block {
    fn of(bytes: &[u8]) -> Self {
        let mut lines = vec![Line([0x55; 64]); bytes.len() / 64 + 1];
        // SAFETY: the lines are longer.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), lines.as_mut_ptr().cast(), bytes.len()) };
        Self { lines, bytes: bytes.len() }
    }

    fn at<T>(&mut self, byte: usize) -> *mut T {
        assert!(byte <= self.bytes);
        self.lines.as_mut_ptr().wrapping_byte_add(byte).cast()
    }
}

fn needs(model: &[u8]) -> eld_model_info_t {
    let mut info =
        eld_model_info_t { struct_bytes: size_of::<eld_model_info_t>() as u32, ..eld_model_info_t::default() };
    // SAFETY: a slice and a structure of the test.
    assert_eq!(unsafe { eld_model_check(model.as_ptr().cast(), model.len(), &raw mut info) }, ELD_OK);
    info
}

/// A context in lent memory, with its model.
struct Rig {
    model: Block,
    memory: Block,
    context: *mut eld_context_t,
}

impl Rig {
    fn new() -> Self {
        let file = small::model();
        let mut memory = Block::of(&vec![0x55; needs(&file).memory_bytes as usize]);
        let (mut model, mut context) = (Block::of(&file), null_mut());
        let (memory_bytes, model_bytes) = (memory.bytes, model.bytes);
        // SAFETY: buffers of the test.
        let status =
            unsafe { eld_init(memory.at(0), memory_bytes, model.at::<u8>(0).cast(), model_bytes, &raw mut context) };
        assert_eq!(status, ELD_OK);
        Self { model, memory, context }
    }

    /// Returns places for a `T` that share bytes with the lent memory or the model.
    fn places<T>(&mut self) -> Vec<*mut T> {
        let mut places = Vec::new();
        for block in [&mut self.memory, &mut self.model] {
            let last = block.bytes - 1;
            let offsets = [0, 8, 64, 600, last / 2, last.saturating_sub(size_of::<T>()), last];
            places.extend(offsets.map(|at| block.at::<T>(at.min(last) / align_of::<T>() * align_of::<T>())));
        }
        places
    }
}

struct Inputs {
    image: Vec<f32>,
    coarse_m: Vec<f32>,
    valid: Vec<u8>,
}

fn maps() -> Inputs {
    let image = (0..PX).map(|i| (i * 7 % 11) as f32).collect();
    Inputs { image, coarse_m: (0..PX).map(|i| i as f32).collect(), valid: vec![1; PX] }
}

fn tile(maps: &Inputs) -> eld_tile_t {
    eld_tile_t {
        struct_bytes: size_of::<eld_tile_t>() as u32,
        pixel_m: 2.0,
        coarse_px: 4.0,
        sun_azimuth_deg: 300.0,
        sun_elevation_deg: 30.0,
        network_alone: 0,
        processor_checks: 0,
        image: eld_pixels_t {
            data: maps.image.as_ptr().cast(),
            data_bytes: size_of_val(&maps.image[..]),
            row_bytes: 0,
            format: ELD_PIXELS_F32,
            flags: 0,
            gain: 1.0,
            offset: 0.0,
            null_code: 0,
            saturated_from: 0,
        },
        coarse_m: maps.coarse_m.as_ptr(),
        coarse_len: PX,
        valid: maps.valid.as_ptr(),
        valid_len: PX,
        posts: null(),
        light: null(),
    }
}

fn telemetry() -> eld_telemetry_t {
    eld_telemetry_t { struct_bytes: size_of::<eld_telemetry_t>() as u32, ..eld_telemetry_t::default() }
}

#[test]
fn init_writes_no_context_into_the_memory_or_the_model() {
    let file = small::model();
    let needed = needs(&file).memory_bytes as usize;
    let (mut memory, mut model) = (Block::of(&vec![0x55; needed]), Block::of(&file));
    let (memory_before, model_before) = (memory.lines.clone(), model.lines.clone());
    let stride = if cfg!(miri) { 512 } else { 8 };
    for inside_model in [false, true] {
        let last = if inside_model { file.len() } else { needed } - 1;
        for at in (0..last).step_by(stride).chain([last / 8 * 8]) {
            let block = if inside_model { &mut model } else { &mut memory };
            let context: *mut *mut eld_context_t = block.at(at);
            // Whatever else is wrong with the call: memory too short, misaligned, or NULL; a model cut short, or NULL.
            let (home, source): (*mut u8, *const u8) = (memory.at(0), model.at::<u8>(0));
            for (home, home_bytes, source, source_bytes) in [
                (home, needed, source, file.len()),
                (home, last + 1, source, file.len()),
                (home, usize::MAX, source, file.len()),
                (if inside_model { null_mut() } else { home }, needed, source, file.len()),
                (home, needed, if inside_model { source } else { null() }, file.len()),
                (home, needed, source, usize::MAX),
            ] {
                // SAFETY: buffers of the test; lengths that are not theirs are refused before they are used.
                let status = unsafe { eld_init(home.cast(), home_bytes, source.cast(), source_bytes, context) };
                let wraps = home_bytes == usize::MAX || source_bytes == usize::MAX;
                let expected = status == ELD_REFUSED_OVERLAP || (wraps && status == ELD_REFUSED_LENGTH);
                assert!(expected, "{status:#x}: context at byte {at}, in the model: {inside_model}");
            }
        }
    }
    assert!(memory.lines == memory_before && model.lines == model_before);
}

#[test]
fn a_refused_init_writes_null_and_nothing_else() {
    let file = small::model();
    let mut memory = Block::of(&vec![0x55; needs(&file).memory_bytes as usize]);
    let before = memory.lines.clone();
    for (short, model_bytes) in [(1, file.len()), (0, file.len() - 1)] {
        let mut context: *mut eld_context_t = memory.at(8);
        let bytes = memory.bytes - short;
        // SAFETY: buffers of the test.
        let status = unsafe { eld_init(memory.at(0), bytes, file.as_ptr().cast(), model_bytes, &raw mut context) };
        assert!(!worked(status) && context.is_null());
    }
    assert_eq!(memory.lines, before);
}

#[test]
fn a_model_is_not_checked_into_itself() {
    let mut model = Block::of(&small::model());
    let (before, bytes) = (model.lines.clone(), model.bytes);
    for at in [0, 128, bytes / 8 * 8 - size_of::<eld_model_info_t>(), (bytes - 1) / 8 * 8] {
        // SAFETY: buffers of the test.
        let status = unsafe { eld_model_check(model.at::<u8>(0).cast(), bytes, model.at(at)) };
        assert_eq!(status, ELD_REFUSED_OVERLAP, "byte {at}");
    }
    assert_eq!(model.lines, before);
}

#[test]
fn structures_inside_the_lent_memory_or_the_model_are_neither_read_nor_written() {
    let maps = maps();
    let mut rig = Rig::new();
    // SAFETY: a context and buffers of the test, here and below; what overlaps is refused before it is used.
    unsafe {
        assert_eq!(eld_begin(rig.context, &tile(&maps)), ELD_OK);
        while eld_step(rig.context, 300) == ELD_RUNNING {}
        let mut expected = vec![0f32; PX];
        assert_eq!(eld_output(rig.context, expected.as_mut_ptr(), PX, null_mut(), 0), ELD_OK);
        for place in rig.places::<eld_tile_t>() {
            assert_eq!(eld_begin(rig.context, place), ELD_REFUSED_OVERLAP);
            assert_eq!(eld_begin_step(rig.context, place, 1), ELD_REFUSED_OVERLAP);
        }
        for place in rig.places::<eld_telemetry_t>() {
            assert_eq!(eld_telemetry(rig.context, place), ELD_REFUSED_OVERLAP);
        }
        for place in rig.places::<eld_errors_t>() {
            assert_eq!(eld_errors(rig.context, place), ELD_REFUSED_OVERLAP);
        }
        for place in rig.places::<f32>() {
            let mut heights = vec![0f32; PX];
            assert_eq!(eld_output(rig.context, place, PX, null_mut(), 0), ELD_REFUSED_OVERLAP);
            assert_eq!(eld_output(rig.context, heights.as_mut_ptr(), PX, place.cast(), PX), ELD_REFUSED_OVERLAP);
            let none = null_mut();
            for [height_m, slope, origin] in [[place, none, none], [none, place, none], [none, none, place]] {
                assert_eq!(eld_error_maps(rig.context, height_m, slope, origin.cast(), PX), ELD_REFUSED_OVERLAP);
            }
            for change in [
                (|t, p| t.image.data = p.cast()) as fn(&mut eld_tile_t, *mut f32),
                // Pixels of bytes may begin anywhere; a frame may reach into our memory with its last byte only.
                |t, p| (t.image.data, t.image.format) = (p.wrapping_byte_add(1).cast(), ELD_PIXELS_U8),
                |t, p| (t.image.data, t.image.data_bytes) = (p.wrapping_byte_sub(PX * 4).cast(), PX * 4 + 1),
                |t, p| t.coarse_m = p,
                |t, p| t.valid = p.cast(),
            ] {
                let mut tile = tile(&maps);
                change(&mut tile, place);
                assert_eq!(eld_begin(rig.context, &tile), ELD_REFUSED_OVERLAP);
                assert_eq!(eld_begin_step(rig.context, &tile, 1), ELD_REFUSED_OVERLAP);
            }
        }
        // A whole tile structure that a caller has written over the end of the arena.
        let mut found = vec![0f32; PX];
        assert_eq!(eld_output(rig.context, found.as_mut_ptr(), PX, null_mut(), 0), ELD_OK);
        assert_eq!(found, expected, "nothing has changed");
        let inside = (rig.memory.bytes - size_of::<eld_tile_t>()) / 8 * 8;
        let place: *mut eld_tile_t = rig.memory.at(inside);
        place.write(tile(&maps));
        assert_eq!(eld_begin(rig.context, place), ELD_REFUSED_OVERLAP);
    }
}

#[test]
fn posts_and_lights_inside_the_lent_memory_or_the_model_are_refused() {
    let maps = maps();
    let mut rig = Rig::new();
    // SAFETY: a context and buffers of the test; what overlaps is refused before it is used.
    unsafe {
        for place in rig.places::<eld_lighting_t>() {
            let tile = eld_tile_t { light: place, ..tile(&maps) };
            assert_eq!(eld_begin(rig.context, &tile), ELD_REFUSED_OVERLAP);
            assert_eq!(eld_light_add(rig.context, &tile, 1), ELD_REFUSED_OVERLAP);
            assert_eq!(eld_light_decide(rig.context, 0.0, 1.0, place), ELD_REFUSED_OVERLAP);
        }
        for place in rig.places::<eld_posts_t>() {
            let tile = eld_tile_t { posts: place, ..tile(&maps) };
            assert_eq!(eld_begin(rig.context, &tile), ELD_REFUSED_OVERLAP);
        }
        for place in rig.places::<f32>() {
            let (row0, rows_per_line, col0, cols_per_px) = (0.0, 0.5, 0.0, 0.5);
            let posts = eld_posts_t { posts_m: place, posts_len: 6, cols: 3, row0, rows_per_line, col0, cols_per_px };
            let tile = eld_tile_t { posts: &raw const posts, coarse_m: null(), coarse_len: 0, ..tile(&maps) };
            assert_eq!(eld_begin(rig.context, &tile), ELD_REFUSED_OVERLAP);
        }
    }
}

#[test]
fn every_function_in_the_life_of_a_context() {
    let maps = maps();
    let mut rig = Rig::new();
    let mut name = [0 as std::ffi::c_char; 64];
    // SAFETY: a context and buffers of the test.
    unsafe {
        assert_eq!(eld_kernel_name(name.as_mut_ptr(), name.len()), ELD_OK);
        assert!(name[0] != 0);
        assert_eq!(eld_begin(rig.context, &tile(&maps)), ELD_OK);
        assert_eq!(eld_step(rig.context, 1), ELD_RUNNING);
        assert_eq!(eld_begin_step(rig.context, &tile(&maps), 1), ELD_RUNNING);
        assert_eq!(eld_step(rig.context, 1), ELD_REFUSED_NOT_BEGUN);
        while eld_begin_step(rig.context, &tile(&maps), 1) == ELD_RUNNING {}
        while eld_step(rig.context, 100) == ELD_RUNNING {}
        let (mut heights, mut valid) = (vec![f32::NAN; PX], vec![7u8; PX]);
        assert_eq!(eld_output(rig.context, heights.as_mut_ptr(), PX, valid.as_mut_ptr(), PX), ELD_OK);
        assert!(heights.iter().all(|h| h.is_finite()) && valid.iter().all(|v| *v == 1));
        assert_eq!(eld_scrub(rig.context, 10_000), ELD_OK);
        assert_eq!(eld_self_test_begin(rig.context), ELD_OK);
        while eld_step(rig.context, 300) == ELD_RUNNING {}
        assert_eq!(eld_self_test_check(rig.context), ELD_OK);
        let mut counted = telemetry();
        assert_eq!(eld_telemetry(rig.context, &raw mut counted), ELD_OK);
        assert_eq!((counted.tiles, counted.tiles_dropped, counted.faults), (2, 1, 0));
        assert_eq!(eld_abort(rig.context), ELD_OK);
        assert_eq!(eld_abort(rig.context), ELD_REFUSED_NO_TILE);
        while eld_light_add(rig.context, &tile(&maps), 1) == ELD_RUNNING {}
        let struct_bytes = size_of::<eld_lighting_t>() as u32;
        let mut light = eld_lighting_t { struct_bytes, ..eld_lighting_t::default() };
        assert_eq!(eld_light_decide(rig.context, f32::NAN, f32::NAN, &raw mut light), ELD_OK);
        assert_eq!(eld_begin(rig.context, &eld_tile_t { light: &raw const light, ..tile(&maps) }), ELD_OK);
        assert_eq!(eld_light_clear(rig.context), ELD_OK);
        // A bit of the context flips between two calls.
        rig.memory.at::<u8>(40).write(rig.memory.at::<u8>(40).read() ^ 4);
        assert_eq!(eld_telemetry(rig.context, &raw mut counted), ELD_NOTICE_REPAIRED);
    }
}

#[test]
fn heights_are_finite_whatever_the_coarse_heights() {
    let mut rig = Rig::new();
    let (mut accepted, mut coarse, mut beyond) = (0, 0, 0);
    for exponent in if cfg!(miri) { 0 } else { -8 }..39 {
        for (low, high) in [(0.0, 1.0), (-1.0, 1.0), (0.999, 1.0), (-1.0, -0.999)] {
            let size = 10f64.powi(exponent);
            let mut maps = maps();
            let height = |i: usize| (size * (low + (high - low) * (i % 5) as f64 / 4.0)) as f32;
            maps.coarse_m = (0..PX).map(height).collect();
            let (mut heights, mut valid) = (vec![f32::NAN; PX], vec![7u8; PX]);
            // SAFETY: a context and buffers of the test.
            unsafe {
                let status = eld_begin(rig.context, &tile(&maps));
                if !worked(status) {
                    // What is 1e30 or more from zero is a void.
                    let voids = maps.coarse_m.iter().filter(|z| z.abs() >= 1e30).count();
                    assert_eq!((voids, status), (PX, ELD_REFUSED_TILE_MASKED), "{size:e}");
                    continue;
                }
                coarse += usize::from(matches!(status, ELD_NOTICE_COARSE | ELD_NOTICE_DROPPED_COARSE));
                let mut status = ELD_RUNNING;
                while status == ELD_RUNNING {
                    status = eld_step(rig.context, u64::MAX);
                }
                if status == ELD_FAULT_HEIGHT {
                    // A network may add to the relief of its tile no more than a million metres.
                    assert!(size >= 1e6, "{size:e}");
                    beyond += 1;
                    continue;
                }
                assert_eq!(
                    eld_output(rig.context, heights.as_mut_ptr(), PX, valid.as_mut_ptr(), PX),
                    ELD_OK,
                    "{size:e}"
                );
            }
            accepted += 1;
            assert!(heights.iter().all(|h| h.is_finite()), "{size:e}: {heights:?}");
        }
        if cfg!(miri) && accepted > 2 {
            break;
        }
    }
    println!("{accepted} accepted, {coarse} of them coarse; {beyond} beyond all ground");
    assert!(accepted > 2 && accepted > coarse && (coarse > 2 || cfg!(miri)) && beyond < 13);
    rig.context = null_mut();
}
