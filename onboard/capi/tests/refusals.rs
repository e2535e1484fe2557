//! Reaches every status, by errors of the caller or faults of the machine.
#![allow(unsafe_code)] // C functions

mod common;
mod reach;
mod small;
use common::*;
use elunar_capi::ffi;
use elunar_capi::status::*;
use elunar_capi::types::*;
use elunar_core::nn::file::{ENTRY_BYTES, OPERATOR_BYTES, TENSOR_BYTES, set_word, word};
use reach::*;
use std::collections::BTreeMap;
use std::ptr::{null, null_mut};

/// A case: the expected status, a description, and a call that returns the status.
type Case = (eld_status_t, &'static str, fn() -> eld_status_t);

/// The tests of strips, which reach the statuses of strips.
const STRIPS: &str = include_str!("strips.rs");
/// The same of slots.
const SLOTS: &str = include_str!("slots.rs");

/// Statuses that no test on this machine can reach, with the reason.
const OUT_OF_REACH: [(eld_status_t, &str); 1] = [(ELD_REFUSED_MODEL_SIZE, "needs a machine of 32 bits")];

const CASES: &[Case] = &[
    (ELD_OK, "a tile begins", || begin_with(|_| {})),
    (ELD_RUNNING, "a step of many", || begun().step(1)),
    (ELD_NOTICE_DROPPED, "begin, begin", || begun().begin(&Tile::golden())),
    (ELD_NOTICE_DROPPED, "begin, step, self test", || {
        let mut context = begun();
        context.step(STEP_MACS);
        context.self_test_begin()
    }),
    (ELD_NOTICE_LIGHT_ASSUMED, "level ground, Sun unknown", || {
        begin_tile(|tile| (tile.coarse_m, tile.sun) = (vec![-1900.0; PX], [f32::NAN; 2]))
    }),
    (ELD_NOTICE_DROPPED_LIGHT_ASSUMED, "level ground, Sun unknown, begun over a tile at work", || {
        let (mut context, mut tile) = (begun(), Tile::golden());
        context.step(1);
        (tile.coarse_m, tile.sun) = (vec![-1900.0; PX], [f32::NAN; 2]);
        let status = context.begin(&tile);
        let counted = context.telemetry();
        assert_eq!((counted.tiles_dropped, counted.lights_assumed), (1, 1));
        status
    }),
    (ELD_NOTICE_COARSE, "one brightness", || begin_tile(|tile| tile.image = vec![100.0; PX])),
    (ELD_NOTICE_COARSE, "level ground for a model that scales by relief", || {
        begin_small("int8.eld", |tile| tile.coarse_m.fill(-1900.0)).1
    }),
    (ELD_NOTICE_DROPPED_COARSE, "one brightness, begun over a tile at work", || {
        let mut context = begun();
        let status = context.begin(&Tile { image: vec![100.0; PX], ..Tile::golden() });
        assert_eq!(context.telemetry().tiles_dropped, 1);
        status
    }),
    (ELD_RUNNING, "a tile in preparation", || Context::new(nano()).begin_step(&Tile::golden().c(), 1)),
    (ELD_NOTICE_DROPPED, "abort while a tile is prepared", || preparing().1.abort()),
    (ELD_NOTICE_DROPPED, "abort while a tile is at work", || begun().abort()),
    (ELD_NOTICE_REPAIRED, "a bit of the context flips", || {
        let mut context = finished();
        context.flip(99);
        context.step(1)
    }),
    (ELD_REFUSED_NULL, "no context", || {
        let mut none = Context { memory: vec![], handle: null_mut() };
        let all = [
            none.begin(&Tile::golden()),
            none.begin_step(&Tile::golden().c(), 1),
            none.abort(),
            none.light_add(&Tile::golden().c(), 1),
            none.light_decide([0.0; 2]).unwrap_err(),
            none.light_clear(),
            none.step(1),
            none.output().unwrap_err(),
            none.scrub(1),
            none.self_test_begin(),
            none.self_test_check(),
            none.try_telemetry().1,
        ];
        assert!(all.iter().all(|status| *status == ELD_REFUSED_NULL), "{all:x?}");
        all[0]
    }),
    (ELD_REFUSED_NULL, "no model", || {
        let mut needs = info(nano()).unwrap();
        // SAFETY: the test passes NULL; the structure is the test's.
        unsafe { ffi::eld_model_check(null(), 5, &raw mut needs) }
    }),
    // SAFETY: the test passes NULL.
    (ELD_REFUSED_NULL, "no info", || unsafe { ffi::eld_model_check(nano().as_ptr().cast(), nano().len(), null_mut()) }),
    (ELD_REFUSED_NULL, "no memory", || init(null_mut(), 1 << 30, nano())),
    // SAFETY: the test passes NULL.
    (ELD_REFUSED_NULL, "no place for the context", || unsafe {
        ffi::eld_init([0u64; 99].as_mut_ptr().cast(), 792, nano().as_ptr().cast(), nano().len(), null_mut())
    }),
    // SAFETY: the test passes NULL.
    (ELD_REFUSED_NULL, "no tile", || unsafe { ffi::eld_begin(Context::new(nano()).handle, null()) }),
    (ELD_REFUSED_NULL, "no image", || begin_with(|tile| tile.image.data = null())),
    (ELD_REFUSED_NULL, "no coarse DTM", || begin_with(|tile| tile.coarse_m = null())),
    (ELD_REFUSED_NULL, "a mask of length only", || begin_with(|tile| tile.valid = null())),
    (ELD_REFUSED_NULL, "no heights", || output_of(&finished(), null_mut(), PX, null_mut(), 0)),
    (ELD_REFUSED_NULL, "no counters", || {
        // SAFETY: the test passes NULL.
        unsafe { ffi::eld_telemetry(Context::new(nano()).handle, null_mut()) }
    }),
    // SAFETY: the test passes NULL.
    (ELD_REFUSED_NULL, "no program", || unsafe { ffi::eld_code_sum(null(), 4, &mut 0) }),
    // SAFETY: the test passes NULL.
    (ELD_REFUSED_NULL, "no name", || unsafe { ffi::eld_kernel_name(null_mut(), 64) }),
    (ELD_REFUSED_ALIGNMENT, "an odd coarse DTM", || {
        begin_with(|tile| tile.coarse_m = tile.coarse_m.wrapping_byte_add(1))
    }),
    (ELD_REFUSED_ALIGNMENT, "odd heights", || {
        output_of(&finished(), vec![0.0; PX + 1].as_mut_ptr().wrapping_byte_add(2), PX, null_mut(), 0)
    }),
    (ELD_REFUSED_ALIGNMENT, "an odd context", || {
        let mut context = Context::new(nano());
        context.handle = context.handle.wrapping_byte_add(4);
        context.step(1)
    }),
    (ELD_REFUSED_LENGTH, "an endless model", || {
        let mut needs = info(nano()).unwrap();
        // SAFETY: the test passes this length.
        unsafe { ffi::eld_model_check(nano().as_ptr().cast(), usize::MAX, &raw mut needs) }
    }),
    (ELD_REFUSED_LENGTH, "endless memory", || init(vec![0u64; 9].as_mut_ptr(), usize::MAX - 8, nano())),
    (ELD_REFUSED_LENGTH, "an endless image", || begin_with(|tile| tile.image.data_bytes = usize::MAX / 2 + 1)),
    (ELD_REFUSED_STRUCT_BYTES, "an info of another version", || {
        let mut needs = eld_model_info_t { struct_bytes: 8, ..info(nano()).unwrap() };
        // SAFETY: a structure of the test.
        unsafe { ffi::eld_model_check(nano().as_ptr().cast(), nano().len(), &raw mut needs) }
    }),
    (ELD_REFUSED_STRUCT_BYTES, "a tile of another version", || begin_with(|tile| tile.struct_bytes += 4)),
    (ELD_REFUSED_STRUCT_BYTES, "counters of another version", || {
        let mut out = eld_telemetry_t::default();
        // SAFETY: a structure of the test.
        unsafe { ffi::eld_telemetry(Context::new(nano()).handle, &raw mut out) }
    }),
    (ELD_REFUSED_OVERLAP, "memory within the model", || {
        let mut both = vec![0u64; 1_000_000];
        let at = both.as_mut_ptr();
        let mut handle = null_mut();
        // SAFETY: a buffer of the test, refused before it is used.
        unsafe { ffi::eld_init(at.cast(), 5_000_000, at.wrapping_add(100_000).cast(), 5_000_000, &raw mut handle) }
    }),
    (ELD_REFUSED_OVERLAP, "the image within the lent memory", || {
        let (tile, context) = (Tile::golden(), Context::new(nano()));
        let mut c = tile.c();
        c.image.data = context.memory.as_ptr().cast();
        // SAFETY: a context of the test, refused before the maps are read.
        unsafe { ffi::eld_begin(context.handle, &c) }
    }),
    (ELD_REFUSED_OVERLAP, "heights into the lent memory", || {
        let mut context = finished();
        let memory = context.memory.as_mut_ptr().cast();
        output_of(&context, memory, PX, null_mut(), 0)
    }),
    (ELD_REFUSED_OVERLAP, "heights over the mask", || {
        let mut heights = vec![0f32; PX];
        output_of(&finished(), heights.as_mut_ptr(), PX, heights.as_mut_ptr().cast(), PX)
    }),
    (ELD_REFUSED_STRUCT_BYTES, "errors of another version", || {
        let mut out = eld_errors_t::default();
        // SAFETY: a structure of the test.
        unsafe { ffi::eld_errors(finished().handle, &raw mut out) }
    }),
    (ELD_REFUSED_NO_TILE, "errors before begin", || Context::new(nano()).errors().unwrap_err()),
    (ELD_REFUSED_NO_TILE, "maps of errors before begin", || Context::new(nano()).error_maps().unwrap_err()),
    (ELD_REFUSED_NOT_DONE, "maps of errors before done", || begun().error_maps().unwrap_err()),
    (ELD_REFUSED_BUFFER, "maps of errors too short", || {
        let (context, mut map) = (finished(), vec![0.0; PX]);
        // SAFETY: a buffer of the test.
        unsafe { ffi::eld_error_maps(context.handle, map.as_mut_ptr(), null_mut(), null_mut(), PX - 1) }
    }),
    (ELD_REFUSED_OVERLAP, "a map of errors over another", || {
        let (context, mut map) = (finished(), vec![0.0; PX]);
        let map = map.as_mut_ptr();
        // SAFETY: as above.
        unsafe { ffi::eld_error_maps(context.handle, map, null_mut(), map.cast(), PX) }
    }),
    (ELD_REFUSED_NOT_DONE, "errors before done", || begun().errors().unwrap_err()),
    (ELD_REFUSED_NO_ERRORS, "errors of a model whose maps are not weighed", || {
        let (mut context, begun) = begin_small("guided.eld", |_| {});
        assert!(worked(begun), "{:?}", text(begun));
        context.finish();
        let mut origin = vec![0; 32 * 64];
        // SAFETY: a buffer of the test.
        let maps =
            unsafe { ffi::eld_error_maps(context.handle, null_mut(), null_mut(), origin.as_mut_ptr(), origin.len()) };
        assert_eq!(maps, ELD_REFUSED_NO_ERRORS);
        context.errors().unwrap_err()
    }),
    (ELD_REFUSED_OVERLAP, "counters into the lent memory", || {
        let mut context = Context::new(nano());
        let at: *mut eld_telemetry_t = context.memory.as_mut_ptr().wrapping_add(1000).cast();
        // SAFETY: within the lent memory; only the size is read.
        unsafe {
            (&raw mut (*at).struct_bytes).write(size_of::<eld_telemetry_t>() as u32);
            ffi::eld_telemetry(context.handle, at)
        }
    }),
    (ELD_REFUSED_BUFFER, "heights too short", || {
        output_of(&finished(), vec![0.0; PX].as_mut_ptr(), PX - 1, null_mut(), 0)
    }),
    (ELD_REFUSED_BUFFER, "a mask too short", || {
        output_of(&finished(), vec![0.0; PX].as_mut_ptr(), PX, vec![0; PX].as_mut_ptr(), PX - 1)
    }),
    (ELD_REFUSED_NO_TILE, "step before begin", || Context::new(nano()).step(1)),
    (ELD_REFUSED_NO_TILE, "output before begin", || Context::new(nano()).output().unwrap_err()),
    (ELD_REFUSED_NO_TILE, "self test checked before it began", || Context::new(nano()).self_test_check()),
    (ELD_REFUSED_NO_TILE, "abort before begin", || Context::new(nano()).abort()),
    (ELD_REFUSED_NOT_BEGUN, "step while a tile is prepared", || preparing().1.step(1)),
    (ELD_REFUSED_NOT_DONE, "output while a tile is prepared", || preparing().1.output().unwrap_err()),
    (ELD_REFUSED_NOT_DONE, "errors while a tile is prepared", || preparing().1.errors().unwrap_err()),
    (ELD_REFUSED_OTHER_TILE, "a tile that is prepared as a self test", || preparing().1.self_test_check()),
    (ELD_REFUSED_NOT_DONE, "output before done", || begun().output().unwrap_err()),
    (ELD_REFUSED_NOT_DONE, "self test checked before done", || {
        let mut context = Context::new(nano());
        context.self_test_begin();
        context.self_test_check()
    }),
    (ELD_REFUSED_OTHER_TILE, "the self test's heights", || {
        let mut context = Context::new(nano());
        context.self_test_begin();
        context.finish();
        context.output().unwrap_err()
    }),
    (ELD_REFUSED_OTHER_TILE, "the tile as a self test", || finished().self_test_check()),
    (ELD_REFUSED_MEMORY_SHORT, "one byte less", || {
        let needed = info(nano()).unwrap().memory_bytes as usize;
        let mut memory = vec![3u64; needed.div_ceil(8)];
        let status = init(memory.as_mut_ptr(), needed - 1, nano());
        assert!(memory.iter().all(|word| *word == 3), "refused, and yet changed");
        assert_eq!(init(memory.as_mut_ptr(), needed, nano()), ELD_OK);
        status
    }),
    (ELD_REFUSED_MEMORY_ALIGNMENT, "odd memory", || {
        let mut memory = vec![0u64; 1_000_000];
        init(memory.as_mut_ptr().wrapping_byte_add(4), 7_000_000, nano())
    }),
    (ELD_REFUSED_MODEL_MAGIC, "another file", || validated(b"\x89PNG\r\n\x1a\n and so on")),
    (ELD_REFUSED_MODEL_MAGIC, "nothing", || validated(&[])),
    (ELD_REFUSED_MODEL_VERSION, "a later version", || validated(&changed(|m| set_word(m, word::VERSION, 99)))),
    (ELD_REFUSED_MODEL_ENDIANNESS, "words swapped", || {
        let swapped: Vec<u8> =
            nano()[8..].as_chunks::<4>().0.iter().flat_map(|[a, b, c, d]| [*d, *c, *b, *a]).collect();
        validated(&[&nano()[..8], &swapped].concat())
    }),
    (ELD_REFUSED_MODEL_LENGTH, "cut short", || validated(&nano()[..nano().len() - 1])),
    (ELD_REFUSED_MODEL_HEADER_CHECKSUM, "a header bit flips", || {
        let mut model = nano().to_vec();
        model[4 * word::NR] ^= 1;
        validated(&model)
    }),
    (ELD_REFUSED_MODEL_CHECKSUM, "a weight's bit flips", || {
        let mut model = nano().to_vec();
        model[3_000_000] ^= 0x40;
        validated(&model)
    }),
    (ELD_REFUSED_MODEL_HEADER, "a negative range", || {
        validated(&changed(|m| set_word(m, word::NR, (-50f32).to_bits())))
    }),
    (ELD_REFUSED_MODEL_TENSOR, "a tensor of rubbish", || {
        validated(&changed(|m| {
            let at = header(m, word::TENSORS);
            m[at..at + 32].fill(0xff);
        }))
    }),
    (ELD_REFUSED_MODEL_OPERATOR, "an operator of rubbish", || {
        validated(&changed(|m| {
            let at = header(m, word::OPERATORS);
            m[at..at + 32].fill(0xff);
        }))
    }),
    (ELD_REFUSED_MODEL_SCHEDULE, "a schedule of nothing", || {
        validated(&changed(|m| {
            let at = header(m, word::SCHEDULE);
            let bytes = ENTRY_BYTES * header(m, word::SCHEDULE + 1);
            m[at..at + bytes].fill(0);
        }))
    }),
    (ELD_REFUSED_MODEL_WORK, "hundreds of maps in one place", || validated(&small::slow_model())),
    (ELD_REFUSED_MODEL_OPERATOR, "an output scale that makes heights infinite", || {
        validated(&changed(|m| {
            // The multipliers of the last operator, a convolution with an f32 output.
            let at = header(m, word::OPERATORS) + OPERATOR_BYTES * (header(m, word::OPERATORS + 1) - 1);
            let place = u32::from_le_bytes(m[at + 44..at + 48].try_into().unwrap()) as usize;
            let constants = header(m, word::CONSTANTS);
            m[constants + place..constants + place + 4].copy_from_slice(&1e35f32.to_le_bytes());
        }))
    }),
    (ELD_REFUSED_TILE_SIZE, "an image too short", || begin_with(|tile| tile.image.data_bytes -= 1)),
    (ELD_REFUSED_TILE_SIZE, "rows that overlap", || begin_with(|tile| tile.image.row_bytes = 4 * COLS - 1)),
    (ELD_REFUSED_TILE_SIZE, "rows beyond the frame", || begin_with(|tile| tile.image.row_bytes = 4 * COLS + 1)),
    (ELD_REFUSED_TILE_SIZE, "rows beyond the address space", || begin_with(|tile| tile.image.row_bytes = usize::MAX)),
    (ELD_REFUSED_TILE_FORMAT, "no format", || begin_with(|tile| tile.image.format = 5)),
    (ELD_REFUSED_TILE_FORMAT, "floats with a code", || begin_with(|tile| tile.image.flags = ELD_PIXELS_HAS_NULL)),
    (ELD_REFUSED_TILE_FORMAT, "a flag that does not exist", || {
        begin_with(|tile| (tile.image.format, tile.image.flags) = (ELD_PIXELS_U8, 4))
    }),
    (ELD_REFUSED_TILE_FORMAT, "a gain of NaN", || begin_with(|tile| tile.image.gain = f32::NAN)),
    (ELD_REFUSED_TILE_FORMAT, "an infinite offset", || begin_with(|tile| tile.image.offset = f32::INFINITY)),
    (ELD_REFUSED_TIME, "the Sun after 2100", || sun(36_890.0, 0.0)),
    (ELD_REFUSED_PLACE, "the Sun beyond the pole", || sun(0.0, 90.5)),
    (ELD_REFUSED_OPTIONS, "terrain maps of nothing", || {
        let struct_bytes = size_of::<eld_terrain_options_t>() as u32;
        let options = eld_terrain_options_t { struct_bytes, ..Default::default() };
        let mut bytes = 0;
        // SAFETY: structures of the test.
        unsafe { ffi::eld_terrain_plan(&raw const options, &raw mut bytes) }
    }),
    (ELD_NOTICE_NO_LINE, "the first line of a grid", || terrain_calls(Some(1), |_| {})),
    (ELD_REFUSED_UNFINISHED, "a grid into another", || terrain_calls(None, |_| {})),
    (ELD_FAULT_LINES, "a line changes", || terrain_calls(Some(2), |memory| *memory.last_mut().unwrap() ^= 4)),
    (ELD_REFUSED_TILE_LIGHT, "a light that is none", || {
        let light = eld_lighting_t { struct_bytes: size_of::<eld_lighting_t>() as u32, ..Default::default() };
        let (tile, mut context) = (Tile::golden(), Context::new(nano()));
        context.begin_step(&eld_tile_t { light: &raw const light, ..tile.c() }, 1)
    }),
    (ELD_FAULT_LIGHT, "the light of the scene changes twice", || {
        let mut context = Context::new(nano());
        assert_eq!(context.light_add(&Tile::golden().c(), u64::MAX), ELD_OK);
        let survey = context.parts().survey;
        [8 * survey.start + 77, 8 * survey.end - 77].into_iter().for_each(|bit| context.flip(bit));
        context.light_decide([f32::NAN; 2]).unwrap_err()
    }),
    (ELD_REFUSED_TILE_POSTS, "posts and a map", || begin_posts(|tile, _| tile.coarse_len = 1)),
    (ELD_REFUSED_TILE_POSTS, "no columns of posts", || begin_posts(|_, posts| posts.cols = 0)),
    (ELD_REFUSED_TILE_POSTS, "half a row of posts", || begin_posts(|_, posts| posts.posts_len -= 1)),
    (ELD_REFUSED_TILE_POSTS, "no posts", || begin_posts(|_, posts| posts.posts_len = 0)),
    (ELD_REFUSED_TILE_POSTS, "posts nowhere", || begin_posts(|_, posts| posts.row0 = f64::NAN)),
    (ELD_REFUSED_NULL, "posts of NULL", || begin_posts(|_, posts| posts.posts_m = null())),
    (ELD_REFUSED_ALIGNMENT, "odd posts", || begin_posts(|_, posts| posts.posts_m = posts.posts_m.wrapping_byte_add(1))),
    (ELD_REFUSED_ALIGNMENT, "an odd structure of posts", || {
        begin_posts(|tile, _| tile.posts = tile.posts.wrapping_byte_add(4))
    }),
    (ELD_REFUSED_LENGTH, "endless posts", || begin_posts(|_, posts| posts.posts_len = usize::MAX)),
    (ELD_REFUSED_TILE_MASKED, "posts without a height", || begin_posts_of(f32::NAN, |_, _| {})),
    (ELD_REFUSED_TILE_MASKED, "posts far away", || begin_posts(|_, posts| posts.col0 = 1e9)),
    (ELD_REFUSED_TILE_SIZE, "a coarse DTM too long", || begin_tile(|tile| tile.coarse_m.push(0.0))),
    (ELD_REFUSED_TILE_SIZE, "a mask without length", || begin_with(|tile| tile.valid_len = 0)),
    (ELD_REFUSED_TILE_OPTION, "a network that is neither alone nor not", || begin_with(|tile| tile.network_alone = 2)),
    (ELD_REFUSED_TILE_OPTION, "checks that are neither asked for nor not", || {
        begin_with(|tile| tile.processor_checks = 2)
    }),
    (ELD_REFUSED_TILE_MASK, "a mask of 2", || begin_tile(|tile| tile.valid.as_mut().unwrap()[77] = 2)),
    (ELD_REFUSED_TILE_PIXEL, "a pixel without size", || begin_with(|tile| tile.pixel_m = 0.0)),
    (ELD_REFUSED_TILE_PIXEL, "a coarse pixel of NaN", || begin_with(|tile| tile.coarse_px = f32::NAN)),
    (ELD_REFUSED_TILE_SUN, "a Sun below the horizon", || begin_with(|tile| tile.sun_elevation_deg = -1.0)),
    (ELD_REFUSED_TILE_SUN, "an infinite azimuth", || begin_with(|tile| tile.sun_azimuth_deg = f32::INFINITY)),
    (ELD_REFUSED_TILE_MASKED, "all masked", || begin_tile(|tile| tile.valid = Some(vec![0; PX]))),
    (ELD_REFUSED_TILE_MASKED, "an image of NaN", || begin_tile(|tile| tile.image = vec![f32::NAN; PX])),
    (ELD_REFUSED_TILE_MASKED, "a coarse DTM of infinity", || {
        begin_tile(|tile| tile.coarse_m = vec![f32::INFINITY; PX])
    }),
    (ELD_REFUSED_TILE_MASKED, "image and coarse DTM nowhere together", || {
        begin_tile(|tile| {
            tile.image[..PX / 2].fill(f32::NAN);
            tile.coarse_m[PX / 2..].fill(f32::NAN);
        })
    }),
    (ELD_REFUSED_TILE_MASKED, "every pixel saturated", || {
        begin_with(|tile| {
            let all = ELD_PIXELS_HAS_SATURATED;
            (tile.image.format, tile.image.flags, tile.image.saturated_from) = (ELD_PIXELS_U16_LE, all, 0);
        })
    }),
    (ELD_REFUSED_TILE_MASKED, "pixels that vanish while a tile is prepared", || {
        let (mut tile, mut context) = (Tile::golden(), Context::new(nano()));
        tile.image[..COLS].fill(f32::NAN);
        assert_eq!(context.begin_step(&tile.c(), 1), ELD_RUNNING);
        tile.image.fill(f32::NAN);
        let status = context.begin_step(&tile.c(), u64::MAX);
        assert_eq!(context.telemetry().phase, ELD_PHASE_EMPTY);
        status
    }),
    (ELD_FAULT_MODEL_CHANGED, "a weight changes after init", || {
        let (mut model, mut context) = own_model();
        model[3_000_000] ^= 1;
        let mut status = ELD_OK;
        while status == ELD_OK && context.telemetry().scrub_passes == 0 {
            status = context.scrub(65_536);
        }
        assert_eq!(context.telemetry().scrub_faults, 1);
        status
    }),
    (ELD_FAULT_MODEL_CHANGED, "the header changes after init", || {
        let (mut model, mut context) = own_model();
        model[4 * word::NR] ^= 1;
        assert_eq!(context.begin(&Tile::golden()), ELD_FAULT_MODEL_CHANGED);
        assert_eq!(context.telemetry().last_fault, ELD_FAULT_MODEL_CHANGED);
        // With the model restored, it continues.
        model[4 * word::NR] ^= 1;
        assert_eq!(context.begin(&Tile::golden()), ELD_OK);
        model[4 * word::NR] ^= 1;
        context.step(1)
    }),
    (ELD_FAULT_MODEL_CHANGED, "another model in its place", || {
        let (mut model, mut context) = own_model();
        let other = changed(|m| set_word(m, word::SELF_TEST_SEED, 5));
        model.copy_from_slice(&other);
        context.self_test_begin()
    }),
    (ELD_FAULT_MODEL_CHANGED, "a weight changes while a tile is at work", || {
        let (mut model, mut context) = own_model();
        assert_eq!((context.begin(&Tile::golden()), context.step(STEP_MACS)), (ELD_OK, ELD_RUNNING));
        model[3_000_000] ^= 1;
        to_the_end(&mut context)
    }),
    (ELD_FAULT_MODEL_CHANGED, "a record changes before the next tile begins", || {
        let (mut model, mut context) = own_model();
        assert_eq!((context.begin(&Tile::golden()), context.step(STEP_MACS)), (ELD_OK, ELD_RUNNING));
        // A change in the record of the coarse DTM's tensor is found when the image is in the arena already, over the maps of the current
        // tile.
        let record = header(&model, word::TENSORS) + TENSOR_BYTES * header(&model, word::COARSE);
        model[record + 4] ^= 1;
        let status = context.begin(&Tile::other());
        assert_eq!(context.step(1), ELD_REFUSED_NO_TILE, "neither tile is there");
        status
    }),
    (ELD_FAULT_DATA_CHANGED, "a map changes while a tile is at work", || {
        let mut context = begun();
        assert_eq!(context.step(STEP_MACS), ELD_RUNNING);
        let last = 8 * context.bytes().len();
        // The last tenth of the memory contains maps and their checksums, used and unused.
        (last - last / 10..last).step_by(101).for_each(|bit| context.flip(bit));
        let status = to_the_end(&mut context);
        assert_eq!(context.telemetry().tile_faults, 1);
        assert_eq!(context.step(1), ELD_REFUSED_NO_TILE, "the tile is lost");
        assert_eq!(context.begin(&Tile::golden()), ELD_OK);
        assert_eq!(to_the_end(&mut context), ELD_OK, "begun again, it comes out");
        status
    }),
    (ELD_FAULT_DATA_CHANGED, "a height changes", || {
        let mut context = finished();
        let at = context.parts().scratch.start;
        context.flip(8 * at + 12_345);
        let status = context.output().unwrap_err();
        assert_eq!(context.output(), Err(ELD_REFUSED_NO_TILE), "the tile is lost");
        status
    }),
    (ELD_FAULT_HEIGHT, "a network that adds ten thousand kilometres", || {
        // The context outlives this block.
        let mut context = Context::new(small::model().leak());
        let image = (0..small::PX).map(|i| (i * 7 % 11) as f32).collect();
        let coarse_m = (0..small::PX).map(|i| 1e8 * (i % 5) as f32).collect();
        let begun = context.begin(&Tile { image, coarse_m, valid: None, coarse_px: 4.0, ..Tile::golden() });
        assert!(worked(begun), "{:?}", text(begun));
        let status = to_the_end(&mut context);
        assert_eq!(context.step(1), ELD_REFUSED_NO_TILE, "the tile is lost");
        status
    }),
    (ELD_FAULT_RUN, "both copies of the job are damaged", || {
        let mut context = begun();
        let job = context.parts().job;
        context.flip(8 * job.start + 99);
        context.flip(8 * (job.start + job.len() / 2) + 99);
        let status = context.step(1);
        assert_eq!(context.step(1), ELD_REFUSED_NO_TILE, "the tile is lost");
        status
    }),
    (ELD_FAULT_CHECK, "a check that has changed", || check_step(1, |check| check.words[3] ^= 1)),
    (ELD_REFUSED_NOT_CHECKED, "a context with half a check", || init_checked(1)),
    (ELD_OK, "a context with a whole check", || init_checked(u64::MAX)),
    (ELD_FAULT_VALIDITY, "a validity bit flips", || {
        let mut context = finished();
        let at = context.parts().valid.start;
        context.flip(8 * at + 12_345);
        let status = context.output().unwrap_err();
        assert_eq!(context.output(), Err(ELD_REFUSED_NO_TILE), "the tile is lost");
        status
    }),
    (ELD_FAULT_SELF_TEST, "a result that differs", || {
        let model = changed(|m| set_word(m, word::SELF_TEST_CRC, 1));
        let mut context = Context::new(&model);
        context.self_test_begin();
        context.finish();
        let status = context.self_test_check();
        assert_eq!(context.telemetry().self_test_faults, 1);
        status
    }),
    (ELD_FAULT_RUN, "the schedule is wiped out under a tile", || {
        let (mut model, mut context) = own_model();
        assert_eq!(context.begin(&Tile::golden()), ELD_OK);
        let at = header(&model, word::SCHEDULE);
        let bytes = ENTRY_BYTES * header(&model, word::SCHEDULE + 1);
        model[at..at + bytes].fill(0);
        let status = context.step(1);
        assert_eq!(context.step(1), ELD_REFUSED_NO_TILE, "the tile is lost");
        assert_eq!(context.telemetry().tiles_dropped, 1);
        status
    }),
    (ELD_FAULT_INTERRUPTED, "a step that did not return", || {
        let mut context = begun();
        context.step(STEP_MACS);
        interrupt(&mut context);
        let status = context.step(STEP_MACS);
        assert_eq!(context.step(1), ELD_REFUSED_NO_TILE, "the tile is lost");
        assert_eq!(context.begin(&Tile::golden()), ELD_OK, "and the next one begins");
        context.finish();
        assert_eq!(bits(&context.output().unwrap().0), bits(&Tile::golden().expected().0));
        status
    }),
    (ELD_FAULT_CONTEXT_LOST, "memory that holds no context", || {
        let mut memory = vec![0u64; 1000];
        Context { handle: memory.as_mut_ptr().cast(), memory }.step(1)
    }),
    (ELD_FAULT_CONTEXT_LOST, "both copies damaged", || {
        let mut context = begun();
        let copy_bytes = context.head_bytes() / 2;
        context.flip(500);
        context.flip(8 * copy_bytes + 700);
        let before = context.memory.clone();
        let all = [context.step(1), context.scrub(1), context.output().unwrap_err(), context.try_telemetry().1];
        assert!(all.iter().all(|status| *status == ELD_FAULT_CONTEXT_LOST), "{all:x?}");
        assert!(context.memory == before, "nothing is touched");
        all[0]
    }),
    (ELD_FAULT_CONTEXT_MOVED, "a copy elsewhere", || {
        let context = begun();
        let mut memory = context.memory.clone();
        Context { handle: memory.as_mut_ptr().cast(), memory }.step(1)
    }),
];

#[test]
fn every_status_is_reached() {
    let mut reached: BTreeMap<eld_status_t, usize> = BTreeMap::new();
    let mut wrong = Vec::new();
    for (expected, what, call) in CASES {
        let found = call();
        *reached.entry(found).or_default() += 1;
        if found != *expected {
            wrong.push(format!("{what}: expected {:?}, found {:?}", text(*expected), text(found)));
        }
    }
    assert_eq!(wrong, [""; 0]);
    for known in STATUSES {
        let out_of_reach = OUT_OF_REACH.iter().find(|(status, _)| *status == known.status);
        match (reached.get(&known.status), out_of_reach) {
            (None, Some((_, why))) => println!("{}: not reached, {why}", known.name),
            (Some(_), None) => {}
            // Strips and slots have files of their own.
            (None, None) if known.name.contains("_STRIP_") => assert!(STRIPS.contains(known.name), "{}", known.name),
            (None, None) if known.name.contains("_SLOTS_") => assert!(SLOTS.contains(known.name), "{}", known.name),
            (found, _) => panic!("{}: reached {} times", known.name, found.unwrap_or(&0)),
        }
    }
    println!("{} statuses in {} ways", reached.len(), CASES.len());
}
