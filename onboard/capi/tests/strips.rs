//! Strips by the C functions: the core's heights, refusals, and bits that flip between two calls.
#![allow(unsafe_code)] // C functions

mod common;
use common::*;
use elunar_capi::ffi::strip::*;
use elunar_capi::status::*;
use elunar_capi::strip::types::*;
use elunar_capi::types::*;
use elunar_core::nn::{KnownSun, Lighting};
use elunar_core::norm::LightFit;
use elunar_core::pixels::{PixelForm, PixelFormat};
use elunar_core::strip::{LineErrors, Next, PostGrid, Strip, StripMemory, StripPlan, StripSettings};
use elunar_core::{Model, Runner};
use std::ptr::null_mut;

/// Lines and columns: two rows of two tiles.
const LINES: usize = 270;
const WIDE: usize = 340;
const POST_COLS: usize = 16;

fn settings() -> eld_strip_settings_t {
    let pixels = eld_pixels_t {
        data: std::ptr::null(),
        data_bytes: 0,
        row_bytes: 0,
        format: ELD_PIXELS_U16_BE,
        flags: ELD_PIXELS_HAS_NULL,
        gain: 0.5,
        offset: 3.0,
        null_code: 0,
        saturated_from: 0,
    };
    eld_strip_settings_t {
        struct_bytes: size_of::<eld_strip_settings_t>() as u32,
        cols: WIDE as u32,
        ring_lines: 0,
        overlap_px: 100,
        pixel_m: 2.0,
        coarse_px: 29.61,
        sun_azimuth_deg: 189.488_53,
        sun_elevation_deg: 25.614_722,
        network_alone: 0,
        processor_checks: 0,
        expected_errors: 1,
        post_cols: POST_COLS as u32,
        post_row0: 1.25,
        post_rows_per_line: 1.0 / 29.61,
        post_col0: 1.5,
        post_cols_per_px: 1.0 / 29.61,
        pixels,
        light: std::ptr::null(),
        check: std::ptr::null(),
    }
}

/// Returns a line of the golden tile, repeated, as the camera has it.
fn line(number: usize) -> Vec<u8> {
    static TILE: std::sync::OnceLock<Tile> = std::sync::OnceLock::new();
    let tile = TILE.get_or_init(Tile::golden);
    let at = |col: usize| tile.image[number % ROWS * COLS + col % COLS];
    let code = |v: f32| if v.is_finite() && v.abs() < 1e30 { ((v - 3.0) / 0.5).clamp(1.0, 65_535.0) as u16 } else { 0 };
    (0..WIDE).flat_map(|col| code(at(col)).to_be_bytes()).collect()
}

fn posts(row: usize) -> Vec<f32> {
    (0..POST_COLS).map(|col| -1900.0 + 30.0 * ((row * 5 + col * 7) as f32 * 0.3).sin()).collect()
}

/// What leaves a strip: heights, errors of heights and slopes, origins.
#[derive(Debug, Clone, Default, PartialEq)]
struct Made {
    values: Vec<u32>,
    origins: Vec<u8>,
}

impl Made {
    fn add(&mut self, [heights, height, slope]: [&[f32]; 3], origins: &[u8]) {
        let bits = |v: &f32| if v.is_nan() { u32::MAX } else { v.to_bits() };
        self.values.extend(heights.iter().chain(height).chain(slope).map(bits));
        self.origins.extend(origins);
    }
}

/// A strip in C.
struct CStrip {
    memory: Vec<u64>,
    handle: *mut eld_strip_t,
    made: Made,
    lines: usize,
    rows: usize,
    /// The status of `eld_strip_init`.
    begun: eld_status_t,
}

impl CStrip {
    fn new(settings: &eld_strip_settings_t) -> Result<Self, eld_status_t> {
        let model = nano();
        let (mut bytes, mut handle) = (0, null_mut());
        // SAFETY: memory, model and settings of our own.
        unsafe {
            match eld_strip_plan(model.as_ptr().cast(), model.len(), settings, &raw mut bytes) {
                ELD_OK => {}
                status => return Err(status),
            }
            let mut memory = vec![0xa5a5_a5a5_a5a5_a5a5_u64; bytes.div_ceil(8) as usize];
            let place = memory.as_mut_ptr().cast();
            let init = |bytes: u64, handle: &mut *mut eld_strip_t| {
                eld_strip_init(place, bytes as usize, model.as_ptr().cast(), model.len(), settings, &raw mut *handle)
            };
            assert_eq!(init(bytes - 1, &mut handle), ELD_REFUSED_MEMORY_SHORT);
            let status = init(bytes, &mut handle);
            assert!(worked(status), "{:?}", text(status));
            Ok(Self { memory, handle, made: Made::default(), lines: 0, rows: 0, begun: status })
        }
    }

    fn step(&self, budget_macs: u64) -> eld_status_t {
        // SAFETY: a strip of our own, here and below.
        unsafe { eld_strip_step(self.handle, budget_macs) }
    }

    fn push(&mut self) -> eld_status_t {
        let line = line(self.lines);
        // SAFETY: as above.
        let status = unsafe { eld_strip_push(self.handle, line.as_ptr().cast(), line.len(), std::ptr::null(), 0) };
        self.lines += usize::from(worked(status));
        status
    }

    fn push_posts(&mut self) -> eld_status_t {
        let posts = posts(self.rows);
        self.rows += 1;
        // SAFETY: as above.
        unsafe { eld_strip_push_posts(self.handle, posts.as_ptr(), posts.len()) }
    }

    fn take(&mut self) -> eld_status_t {
        let (mut a, mut b, mut c, mut origins) = (vec![0.0; WIDE], vec![0.0; WIDE], vec![0.0; WIDE], vec![9; WIDE]);
        let mut line = u64::MAX;
        // SAFETY: as above.
        let status = unsafe {
            let (a, b, c) = (a.as_mut_ptr(), b.as_mut_ptr(), c.as_mut_ptr());
            eld_strip_take(self.handle, a, b, c, origins.as_mut_ptr(), WIDE, &raw mut line)
        };
        if status != ELD_NOTICE_STRIP_NO_LINE && worked(status) {
            assert_eq!(line as usize, self.made.origins.len() / WIDE);
            self.made.add([&a, &b, &c], &origins);
        }
        status
    }

    fn telemetry(&self) -> eld_strip_telemetry_t {
        let struct_bytes = size_of::<eld_strip_telemetry_t>() as u32;
        let mut out = eld_strip_telemetry_t { struct_bytes, ..Default::default() };
        // SAFETY: as above.
        let status = unsafe { eld_strip_telemetry(self.handle, &raw mut out) };
        assert!(worked(status), "{:?}", text(status));
        out
    }

    fn flip(&mut self, bit: usize) {
        self.memory[bit / 64] ^= 1 << (bit % 64);
    }

    /// Makes the call that the strip asks for; returns whether there is another one.
    fn advance(&mut self, budget_macs: u64) -> bool {
        let status = match self.step(budget_macs) {
            ELD_RUNNING => return true,
            ELD_NOTICE_STRIP_PUSH if self.lines < LINES => self.push(),
            // SAFETY: as above.
            ELD_NOTICE_STRIP_PUSH => unsafe { eld_strip_finish(self.handle) },
            ELD_NOTICE_STRIP_POSTS if self.rows < 9 => self.push_posts(),
            // SAFETY: as above.
            ELD_NOTICE_STRIP_POSTS => unsafe { eld_strip_finish_posts(self.handle) },
            ELD_NOTICE_STRIP_TAKE => self.take(),
            ELD_NOTICE_STRIP_DONE if self.made.origins.len() == LINES * WIDE => return false,
            ELD_NOTICE_STRIP_DONE => self.take(),
            status => status,
        };
        assert!(worked(status), "{:?}", text(status));
        true
    }
}

/// Makes the same strip by the core.
fn expected() -> Made {
    let model = Model::new(nano()).unwrap();
    let sun = KnownSun { azimuth_deg: Some(189.488_53_f32.into()), elevation_deg: Some(25.614_722_f32.into()) };
    let format = PixelFormat::U16Be;
    let per_px = 1.0 / 29.61;
    let grid = PostGrid { cols: POST_COLS, row0: 1.25, rows_per_line: per_px, col0: 1.5, cols_per_px: per_px };
    let settings = StripSettings {
        cols: WIDE,
        ring_lines: StripPlan::least_lines(&model),
        overlap_px: 100,
        pixel_m: 2.0,
        coarse_px: 29.61,
        anchor: true,
        checked: false,
        light: Lighting::decide(model.illumination(), sun, &LightFit::default()),
        pixels: PixelForm { format, gain: 0.5, offset: 3.0, null_code: Some(0), saturated_from: None },
        posts: Some(grid),
        expected_errors: true,
    };
    let plan = StripPlan::new(&model, settings).unwrap();
    let (mut arena, mut bytes) = (vec![0; plan.arena_bytes()], vec![0; plan.bytes_len()]);
    let (mut samples, mut sums) = (vec![0.0; plan.samples_len()], vec![0.0; plan.sums_len()]);
    let memory = StripMemory { bytes: &mut bytes, samples: &mut samples, sums: &mut sums };
    let mut strip = Strip::new(plan, Runner::new(model, &mut arena).unwrap(), memory).unwrap();
    let (mut made, mut lines, mut rows) = (Made::default(), 0, 0);
    loop {
        match strip.wants() {
            Next::Step => _ = strip.step(u64::MAX),
            Next::Push if lines < LINES => {
                strip.push_pixels(&line(lines), &[]).unwrap();
                lines += 1;
            }
            Next::Push => strip.finish(),
            Next::Posts if rows < 9 => {
                strip.push_posts(&posts(rows)).unwrap();
                rows += 1;
            }
            Next::Posts => strip.finish_posts(),
            Next::Done if strip.ready() == 0 => return made,
            Next::Take | Next::Done => {
                let (mut a, mut b, mut c, mut origin) =
                    (vec![0.0; WIDE], vec![0.0; WIDE], vec![0.0; WIDE], vec![9; WIDE]);
                let errors = LineErrors { height_m: &mut b, slope: &mut c, origin: &mut origin };
                strip.take_line_with(&mut a, errors).unwrap();
                made.add([&a, &b, &c], &origin);
            }
        }
    }
}

#[test]
fn a_strip_in_c_is_the_cores() {
    let expected = expected();
    let mut strip = CStrip::new(&settings()).unwrap();
    while strip.advance(STEP_MACS) {}
    let counters = strip.telemetry();
    assert!(strip.made == expected, "other heights, errors or origins");
    assert_eq!((counters.tiles, counters.tiles_again, counters.faults, counters.ready), (4, 0, 0, 0));
    assert!(counters.macs > 4 * 2_000_000_000 && counters.calls > 2 * LINES as u64);
}

#[test]
fn every_flipped_bit_of_the_state_is_repaired() {
    let mut strip = CStrip::new(&settings()).unwrap();
    for _ in 0..300 {
        strip.advance(STEP_MACS);
    }
    let magic = strip.memory[0];
    let head = 64 * 2 * (1..4096).find(|at| strip.memory[*at] == magic).unwrap();
    let flips: Vec<usize> = (0..head).step_by(7).collect();
    for &bit in &flips {
        strip.flip(bit);
        strip.telemetry();
    }
    let counters = strip.telemetry();
    assert_eq!((counters.context_repairs as usize, counters.faults), (flips.len(), 0));
    // The same bit in both copies.
    strip.flip(1_000);
    strip.flip(head / 2 + 1_000);
    assert_eq!(strip.step(1), ELD_FAULT_CONTEXT_LOST);
    strip.flip(1_000);
    assert_eq!(strip.step(1), ELD_RUNNING);
}

#[test]
fn flipped_bits_of_the_memory_are_counted_or_change_nothing() {
    let expected = expected();
    let bits = 64 * CStrip::new(&settings()).unwrap().memory.len();
    let (mut state, mut told) = (3_u64, 0);
    let mut random = |below: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % below
    };
    for _ in 0..24 {
        let mut strip = CStrip::new(&settings()).unwrap();
        let (moment, bit, mut calls) = (random(700), random(bits), 0);
        while strip.advance(10 * STEP_MACS) {
            calls += 1;
            if calls == moment {
                strip.flip(bit);
            }
        }
        let c = strip.telemetry();
        let faults = c.pieces_lost + c.memory_faults + c.tiles_again + c.context_repairs;
        assert!(faults > 0 || strip.made == expected, "bit {bit} before call {moment}");
        told += u64::from(faults > 0);
    }
    assert!(told > 3, "{told}");
}

#[test]
fn settings_that_cannot_be_are_refused() {
    let good = settings();
    let refused = |settings: eld_strip_settings_t| CStrip::new(&settings).err();
    assert_eq!(refused(eld_strip_settings_t { struct_bytes: 7, ..good }), Some(ELD_REFUSED_STRUCT_BYTES));
    for settings in [
        eld_strip_settings_t { overlap_px: 256, ..good },
        eld_strip_settings_t { ring_lines: 256, ..good },
        eld_strip_settings_t { network_alone: 2, ..good },
        eld_strip_settings_t { expected_errors: 2, ..good },
        eld_strip_settings_t { processor_checks: 2, ..good },
    ] {
        assert_eq!(refused(settings), Some(ELD_REFUSED_STRIP_SETTINGS));
    }
    assert_eq!(refused(eld_strip_settings_t { cols: 0, ..good }), Some(ELD_REFUSED_STRIP_SIZE));
    assert_eq!(refused(eld_strip_settings_t { pixel_m: -1.0, ..good }), Some(ELD_REFUSED_TILE_PIXEL));
    assert_eq!(refused(eld_strip_settings_t { sun_elevation_deg: 90.0, ..good }), Some(ELD_REFUSED_TILE_SUN));
    assert_eq!(refused(eld_strip_settings_t { post_rows_per_line: 0.0, ..good }), Some(ELD_REFUSED_STRIP_GRID));
    let pixels = eld_pixels_t { format: 9, ..good.pixels };
    assert_eq!(refused(eld_strip_settings_t { pixels, ..good }), Some(ELD_REFUSED_TILE_FORMAT));
}

#[test]
fn calls_out_of_order_and_bad_buffers_are_refused() {
    let good = settings();
    let mut strip = CStrip::new(&good).unwrap();
    // SAFETY: buffers of our own; those of the strip are refused before they are used.
    unsafe {
        let handle = strip.handle;
        let (line, posts) = (line(0), posts(0));
        let push = |bytes: usize| eld_strip_push(handle, line.as_ptr().cast(), bytes, std::ptr::null(), 0);
        assert_eq!(push(line.len()), ELD_REFUSED_STRIP_POSTS_FIRST);
        assert_eq!(push(line.len() - 1), ELD_REFUSED_BUFFER);
        assert_eq!(eld_strip_push(handle, std::ptr::null(), 9, std::ptr::null(), 0), ELD_REFUSED_NULL);
        assert_eq!(eld_strip_push(handle, handle.cast(), line.len(), std::ptr::null(), 0), ELD_REFUSED_OVERLAP);
        assert_eq!(eld_strip_push_posts(handle, posts.as_ptr(), 3), ELD_REFUSED_BUFFER);
        while strip.step(1) == ELD_NOTICE_STRIP_POSTS {
            assert_eq!(eld_strip_push_posts(handle, posts.as_ptr(), posts.len()), ELD_OK);
        }
        assert_eq!(push(line.len()), ELD_OK);
        assert_eq!((strip.step(1), strip.take()), (ELD_NOTICE_STRIP_PUSH, ELD_NOTICE_STRIP_NO_LINE));
        let (mut heights_m, mut number) = (vec![0.0; WIDE], 0);
        let mut take = |len: usize| {
            let (no, none) = (null_mut(), null_mut());
            eld_strip_take(handle, heights_m.as_mut_ptr(), no, none, null_mut(), len, &raw mut number)
        };
        assert_eq!((take(WIDE - 1), take(WIDE)), (ELD_REFUSED_BUFFER, ELD_NOTICE_STRIP_NO_LINE));
        assert_eq!(eld_strip_finish_posts(handle), ELD_OK);
        assert_eq!(eld_strip_push_posts(handle, posts.as_ptr(), posts.len()), ELD_REFUSED_STRIP_ENDED);
        for _ in 1..257 {
            assert_eq!(push(line.len()), ELD_OK);
        }
        assert_eq!(push(line.len()), ELD_REFUSED_STRIP_FULL);
        assert_eq!(eld_strip_finish(handle), ELD_OK);
        assert_eq!(push(line.len()), ELD_REFUSED_STRIP_ENDED);
        let mut out = eld_strip_telemetry_t::default();
        assert_eq!(eld_strip_telemetry(handle, &raw mut out), ELD_REFUSED_STRUCT_BYTES);
        assert_eq!(eld_strip_step(null_mut(), 1), ELD_REFUSED_NULL);
        let mut elsewhere = strip.memory.clone();
        assert_eq!(eld_strip_step(elsewhere.as_mut_ptr().cast(), 1), ELD_FAULT_CONTEXT_MOVED);
        let mut zeros = vec![0u64; 1024];
        assert_eq!(eld_strip_step(zeros.as_mut_ptr().cast(), 1), ELD_FAULT_CONTEXT_LOST);
    }
    let lines = eld_strip_settings_t { post_cols: 0, ..good };
    let strip = CStrip::new(&lines).unwrap();
    let posts = posts(0);
    // SAFETY: as above.
    unsafe {
        assert_eq!(eld_strip_push_posts(strip.handle, posts.as_ptr(), posts.len()), ELD_REFUSED_STRIP_NO_POSTS);
        assert_eq!(eld_strip_scrub(strip.handle, 4096), ELD_OK);
    }
    assert_eq!(strip.telemetry().scrubbed_bytes, 4096);
}

/// A model that changes is told by the strip's counters or statuses; loaded again, it serves the strip on.
#[test]
fn a_model_that_is_loaded_again_serves_the_strip() {
    let expected = expected();
    let mut model = nano().to_vec();
    let good = settings();
    let mut strip = CStrip::new(&good).unwrap();
    let mut memory = vec![0u64; strip.memory.len()];
    // SAFETY: memory and model of our own; the model is changed between calls.
    unsafe {
        let (place, bytes) = (memory.as_mut_ptr().cast(), 8 * memory.len());
        let source = model.as_ptr().cast();
        assert_eq!(eld_strip_init(place, bytes, source, model.len(), &good, &raw mut strip.handle), ELD_OK);
    }
    for _ in 0..300 {
        strip.advance(STEP_MACS);
    }
    // The header: no call works, and nothing is lost.
    model[60] ^= 1;
    assert_eq!(strip.step(STEP_MACS), ELD_FAULT_MODEL_CHANGED);
    model[60] ^= 1;
    // A weight: the tile at work is begun again.
    let last = model.len() - 100_000;
    model[last] ^= 16;
    while strip.telemetry().tiles_again == 0 {
        strip.advance(10 * STEP_MACS);
    }
    model[last] ^= 16;
    while strip.advance(10 * STEP_MACS) {}
    let counters = strip.telemetry();
    assert!(strip.made == expected);
    assert_eq!((counters.tiles_again, counters.tiles_lost, counters.faults), (1, 0, 1));
    assert_eq!(counters.last_fault, ELD_FAULT_MODEL_CHANGED);
}

#[test]
fn a_strip_of_one_tile_under_the_light_of_its_scene_equals_the_tile() {
    let mut tile = Tile { sun: [f32::NAN; 2], ..Tile::golden() };
    // A strip has no mask: voids are no numbers.
    let masked = tile.valid.take().unwrap();
    for i in (0..PX).filter(|i| masked[*i] == 0) {
        (tile.image[i], tile.coarse_m[i]) = (f32::NAN, f32::NAN);
    }
    let mut context = Context::new(nano());
    while context.light_add(&tile.c(), 5_000_000) == ELD_RUNNING {}
    let light = context.light_decide(tile.sun).unwrap();
    let c = eld_tile_t { light: &raw const light, ..tile.c() };
    while context.begin_step(&c, 5_000_000) == ELD_RUNNING {}
    context.finish();
    let (expected, valid) = context.output().unwrap();

    let eld_tile_t { pixel_m, coarse_px, image, .. } = c;
    let one = eld_strip_settings_t {
        cols: COLS as u32,
        pixel_m,
        coarse_px,
        expected_errors: 0,
        post_cols: 0,
        pixels: image,
        light: &raw const light,
        ..settings()
    };
    let strip = CStrip::new(&one).unwrap();
    let (mut lines, mut taken, mut heights_m) = (0, 0, vec![0.0f32; COLS]);
    while taken < ROWS {
        // SAFETY: buffers of our own, each as long as a line.
        let status = unsafe {
            match strip.step(5_000_000) {
                ELD_NOTICE_STRIP_PUSH if lines < ROWS => {
                    let (image, coarse_m) = (&tile.image[lines * COLS..], &tile.coarse_m[lines * COLS..]);
                    lines += 1;
                    eld_strip_push(strip.handle, image.as_ptr().cast(), 4 * COLS, coarse_m.as_ptr(), COLS)
                }
                ELD_NOTICE_STRIP_PUSH => eld_strip_finish(strip.handle),
                ELD_NOTICE_STRIP_DONE => {
                    let (out, none, mut line) = (heights_m.as_mut_ptr(), null_mut(), 0);
                    let status = eld_strip_take(strip.handle, out, none, none, null_mut(), COLS, &raw mut line);
                    let same = |(i, z): (usize, &f32)| valid[i] != 1 || z.to_bits() == expected[i].to_bits();
                    let first = (taken * COLS..).zip(&heights_m).find(|one| !same(*one));
                    let found = first.map(|(i, z)| (i, *z, expected[i]));
                    assert_eq!(found, None, "line {taken}: place, height of the strip, height of the tile");
                    taken += 1;
                    status
                }
                status => status,
            }
        };
        assert!(worked(status), "{:?}", text(status));
    }
}

/// The second word of the state is the length of the lent memory; the seventh says in its upper half that a call is
/// at work.
#[test]
fn a_call_that_did_not_return_and_a_state_of_another_plan_are_told() {
    let mut strip = CStrip::new(&settings()).unwrap();
    assert!(worked(strip.step(1)));
    change_word(&mut strip.memory, 6, |word| word | 1 << 32);
    assert_eq!(strip.step(1), ELD_FAULT_INTERRUPTED);
    assert!(worked(strip.step(1)), "the strip goes on");
    change_word(&mut strip.memory, 1, |bytes| bytes - 8);
    assert_eq!(strip.step(1), ELD_FAULT_MODEL_CHANGED);
}

#[test]
fn errors_of_a_line_are_taken_all_or_none() {
    let strip = CStrip::new(&settings()).unwrap();
    let (mut values, mut origins, mut line) = ([vec![0.0; WIDE], vec![0.0; WIDE], vec![0.0; WIDE]], vec![9; WIDE], 0);
    let [heights, height, slope] = values.each_mut().map(|map| map.as_mut_ptr());
    let all = [height.cast::<u8>(), slope.cast(), origins.as_mut_ptr()];
    for given in 0..8 {
        let [height, slope, origins] = std::array::from_fn(|i| if given >> i & 1 == 1 { all[i] } else { null_mut() });
        // SAFETY: a strip and buffers of our own; NULL is refused before anything is written.
        let status =
            unsafe { eld_strip_take(strip.handle, heights, height.cast(), slope.cast(), origins, WIDE, &raw mut line) };
        let expected = if given == 0 || given == 7 { ELD_NOTICE_STRIP_NO_LINE } else { ELD_REFUSED_NULL };
        assert_eq!(status, expected, "{given:03b}");
    }
}

#[test]
fn a_strip_whose_sun_nobody_knows_says_so() {
    assert_eq!(CStrip::new(&settings()).unwrap().begun, ELD_OK);
    let unknown = eld_strip_settings_t { sun_azimuth_deg: f32::NAN, sun_elevation_deg: f32::NAN, ..settings() };
    assert_eq!(CStrip::new(&unknown).unwrap().begun, ELD_NOTICE_LIGHT_ASSUMED);
}
