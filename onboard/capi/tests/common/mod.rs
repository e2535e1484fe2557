//! Shared by the tests of the C interface: the shipped model, a tile of real size, lent memory, and the functions as C calls them.
#![allow(dead_code, unsafe_code)] // each test file uses only some functions; C functions

use elunar_capi::ffi;
use elunar_capi::status::*;
use elunar_capi::types::*;
use elunar_core::job::LightSurvey;
use elunar_core::nn::file::{seal_file, u32_at};
use elunar_core::photoclinometry::{Errors, ExpectedErrors, Origin};
use elunar_core::samples::is_set;
use elunar_core::strip::PostGrid;
use elunar_core::{KnownSun, Model, Progress, Runner, TileInput, TileJob, TileLight, TileMemory, TileRules, required};
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Reports that a program for a test is absent: the check is skipped, or fails if `ELUNAR_REQUIRE_ORACLES` is 1. Does not use `eprintln!`,
/// because the test runner hides its text for tests that pass.
pub(crate) fn absent(why: &str) {
    let required = std::env::var("ELUNAR_REQUIRE_ORACLES").is_ok_and(|value| !value.is_empty() && value != "0");
    assert!(!required, "ELUNAR_REQUIRE_ORACLES=1, but {why}");
    let _ = writeln!(std::io::stderr(), "SKIPPED: {why}");
}

/// Rows and columns of the tile.
pub(crate) const ROWS: usize = 256;
pub(crate) const COLS: usize = 320;
pub(crate) const PX: usize = ROWS * COLS;

/// Budget of a step of some milliseconds.
pub(crate) const STEP_MACS: u64 = 20_000_000;

pub(crate) fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Returns the shipped model.
pub(crate) fn nano() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| std::fs::read(repository().join("host-train/models/nano.eld")).unwrap())
}

/// A tile of the caller.
#[derive(Clone)]
pub(crate) struct Tile {
    pub(crate) image: Vec<f32>,
    pub(crate) coarse_m: Vec<f32>,
    pub(crate) valid: Option<Vec<u8>>,
    pub(crate) pixel_m: f32,
    pub(crate) coarse_px: f32,
    pub(crate) sun: [f32; 2],
    pub(crate) network_alone: bool,
    pub(crate) processor_checks: bool,
}

impl Tile {
    /// Returns the tile of `tests/golden/flight_tile`.
    pub(crate) fn golden() -> Self {
        let folder = repository().join("tests/golden/flight_tile");
        let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
        let floats = |name: &str| read(name).as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect::<Vec<f32>>();
        let tile = Self {
            image: floats("image.f32"),
            coarse_m: floats("coarse_m.f32"),
            valid: Some(read("valid.u8")),
            pixel_m: 2.0,
            coarse_px: 29.61,
            sun: [189.488_53, 25.614_722],
            network_alone: false,
            processor_checks: false,
        };
        assert_eq!([tile.image.len(), tile.coarse_m.len(), tile.valid.as_ref().unwrap().len()], [PX; 3]);
        tile
    }

    /// Returns another tile: the same ground upside down, with the Sun in another place, without a mask.
    pub(crate) fn other() -> Self {
        let Self { mut image, mut coarse_m, .. } = Self::golden();
        image.reverse();
        coarse_m.reverse();
        Self { image, coarse_m, valid: None, sun: [9.0, f32::NAN], ..Self::golden() }
    }

    /// Returns the structure for C.
    pub(crate) fn c(&self) -> eld_tile_t {
        eld_tile_t {
            struct_bytes: size_of::<eld_tile_t>() as u32,
            pixel_m: self.pixel_m,
            coarse_px: self.coarse_px,
            sun_azimuth_deg: self.sun[0],
            sun_elevation_deg: self.sun[1],
            network_alone: self.network_alone.into(),
            processor_checks: self.processor_checks.into(),
            image: floats(&self.image),
            coarse_m: self.coarse_m.as_ptr(),
            coarse_len: self.coarse_m.len(),
            valid: self.valid.as_ref().map_or(std::ptr::null(), |mask| mask.as_ptr()),
            valid_len: self.valid.as_ref().map_or(0, Vec::len),
            posts: std::ptr::null(),
            light: std::ptr::null(),
        }
    }

    /// Returns heights and validity computed by the core without the C interface.
    pub(crate) fn expected(&self) -> (Vec<f32>, Vec<u8>) {
        let (heights_m, valid, _) = self.expected_with_errors();
        (heights_m, valid)
    }

    /// As [`Self::expected`], with the errors that heights and slopes are expected to have.
    pub(crate) fn expected_with_errors(&self) -> (Vec<f32>, Vec<u8>, ExpectedErrors) {
        let model = Model::new(nano()).unwrap();
        let (shape, rules) = (model.tile(), model.input_rules());
        let mut arena = vec![0; required(&model)];
        let mut runner = Runner::new(model, &mut arena).unwrap();
        // A masked pixel is a void of both maps.
        let counts = |i: usize| self.valid.as_ref().is_none_or(|mask| mask[i] == 1);
        let under_mask = |map: &[f32]| -> Vec<f32> {
            map.iter().enumerate().map(|(i, v)| if counts(i) { *v } else { f32::NAN }).collect()
        };
        let (image, coarse_m) = (under_mask(&self.image), under_mask(&self.coarse_m));
        let [azimuth_deg, elevation_deg] = self.sun.map(|deg| (!deg.is_nan()).then_some(f64::from(deg)));
        let light = TileLight::Own(KnownSun { azimuth_deg, elevation_deg });
        let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: shape, light };
        let (mut coarse, mut valid) = (vec![0.0; PX], vec![0; TileMemory::valid_len(shape)]);
        let (mut scratch, mut lines) =
            (vec![0.0; TileMemory::scratch_len(&rules, shape)], vec![0.0; TileMemory::lines_len(shape)]);
        let mut memory =
            TileMemory { coarse_m: &mut coarse, valid: &mut valid, scratch: &mut scratch, lines: &mut lines };
        let how = TileRules {
            pixel_m: self.pixel_m,
            coarse_px: self.coarse_px,
            anchor: !self.network_alone,
            checked: self.processor_checks,
        };
        let mut job = TileJob::new(how, rules, shape);
        while job.prepare(&mut runner, &tile, &mut memory, u64::MAX).unwrap() == Progress::Running {}
        while job.run(&mut runner, &mut memory, u64::MAX).unwrap() == Progress::Running {}
        let valid = (0..PX).map(|i| u8::from(is_set(job.valid(&memory), i))).collect();
        (job.heights_m(&memory).to_vec(), valid, job.expected().unwrap())
    }
}

impl Tile {
    /// Returns the expected errors of every height, and its origin, from those of the tile and its image, as the ground writes them.
    pub(crate) fn expected_maps(&self) -> ErrorMaps {
        let (_, valid, expected) = self.expected_with_errors();
        let at = |i: usize| if valid[i] == 1 { expected.at(self.image[i]) } else { Errors::VOID };
        let all: Vec<Errors> = (0..PX).map(at).collect();
        let origin = |e: &Errors| Origin::of(e.explained, e.dark) as u8;
        let (height_m, slope) = (all.iter().map(|e| e.height_m), all.iter().map(|e| e.slope));
        (height_m.collect(), slope.collect(), all.iter().map(origin).collect())
    }
}

/// Returns floats as pixels for C.
pub(crate) fn floats(map: &[f32]) -> eld_pixels_t {
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

/// Returns posts for C.
pub(crate) fn posts(posts_m: &[f32], grid: PostGrid) -> eld_posts_t {
    let PostGrid { cols, row0, rows_per_line, col0, cols_per_px } = grid;
    eld_posts_t { posts_m: posts_m.as_ptr(), posts_len: posts_m.len(), cols, row0, rows_per_line, col0, cols_per_px }
}

/// Returns the bits of floats, for exact comparison.
pub(crate) fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

/// Returns the requirements of a model.
pub(crate) fn info(model: &[u8]) -> Result<eld_model_info_t, eld_status_t> {
    let mut info =
        eld_model_info_t { struct_bytes: size_of::<eld_model_info_t>() as u32, ..eld_model_info_t::default() };
    // SAFETY: a slice and a structure of our own.
    let status = unsafe { ffi::eld_model_check(model.as_ptr().cast(), model.len(), &raw mut info) };
    if status == ELD_OK { Ok(info) } else { Err(status) }
}

/// Expected errors of heights and slopes, and origins.
pub(crate) type ErrorMaps = (Vec<f32>, Vec<f32>, Vec<u8>);

/// Byte ranges of the lent memory of nano, behind the context.
pub(crate) struct Parts {
    pub(crate) job: Range<usize>,
    pub(crate) survey: Range<usize>,
    pub(crate) valid: Range<usize>,
    pub(crate) dark: Range<usize>,
    pub(crate) coarse: Range<usize>,
    pub(crate) scratch: Range<usize>,
    pub(crate) lines: Range<usize>,
    pub(crate) arena: Range<usize>,
}

/// A context with its lent memory.
pub(crate) struct Context {
    pub(crate) memory: Vec<u64>,
    pub(crate) handle: *mut eld_context_t,
}

// SAFETY: contexts do not depend on a thread; only sharing is forbidden.
unsafe impl Send for Context {}

impl Context {
    /// Makes a context in exactly as much memory as the model needs. The model must outlive it.
    pub(crate) fn new(model: &[u8]) -> Self {
        let needed = info(model).unwrap().memory_bytes as usize;
        // The lent memory has any contents.
        let mut memory = vec![0xa5a5_a5a5_a5a5_a5a5; needed.div_ceil(8)];
        let mut handle = std::ptr::null_mut();
        // SAFETY: memory and model of our own.
        let status = unsafe {
            ffi::eld_init(memory.as_mut_ptr().cast(), needed, model.as_ptr().cast(), model.len(), &raw mut handle)
        };
        assert_eq!(status, ELD_OK, "{:?}", text(status));
        Self { memory, handle }
    }

    pub(crate) fn bytes(&mut self) -> &mut [u8] {
        let len = 8 * self.memory.len();
        // SAFETY: the memory lent, between calls.
        unsafe { std::slice::from_raw_parts_mut(self.memory.as_mut_ptr().cast(), len) }
    }

    pub(crate) fn flip(&mut self, bit: usize) {
        self.bytes()[bit / 8] ^= 1 << (bit % 8);
    }

    pub(crate) fn begin(&mut self, tile: &Tile) -> eld_status_t {
        // SAFETY: a context and a tile of our own, here and below.
        unsafe { ffi::eld_begin(self.handle, &tile.c()) }
    }

    pub(crate) fn begin_step(&mut self, tile: &eld_tile_t, budget_macs: u64) -> eld_status_t {
        // SAFETY: a context of our own; the caller's maps live.
        unsafe { ffi::eld_begin_step(self.handle, tile, budget_macs) }
    }

    /// Adds a tile to the light of the scene.
    pub(crate) fn light_add(&mut self, tile: &eld_tile_t, budget_macs: u64) -> eld_status_t {
        // SAFETY: as above.
        unsafe { ffi::eld_light_add(self.handle, tile, budget_macs) }
    }

    pub(crate) fn light_decide(&mut self, [azimuth, elevation]: [f32; 2]) -> Result<eld_lighting_t, eld_status_t> {
        let struct_bytes = size_of::<eld_lighting_t>() as u32;
        let mut out = eld_lighting_t { struct_bytes, ..eld_lighting_t::default() };
        // SAFETY: as above.
        let status = unsafe { ffi::eld_light_decide(self.handle, azimuth, elevation, &raw mut out) };
        if worked(status) { Ok(out) } else { Err(status) }
    }

    pub(crate) fn light_clear(&mut self) -> eld_status_t {
        // SAFETY: as above.
        unsafe { ffi::eld_light_clear(self.handle) }
    }

    pub(crate) fn abort(&mut self) -> eld_status_t {
        // SAFETY: as above.
        unsafe { ffi::eld_abort(self.handle) }
    }

    pub(crate) fn step(&mut self, budget_macs: u64) -> eld_status_t {
        // SAFETY: as above.
        unsafe { ffi::eld_step(self.handle, budget_macs) }
    }

    /// Steps until the tile is done.
    pub(crate) fn finish(&mut self) {
        loop {
            match self.step(STEP_MACS) {
                ELD_RUNNING => {}
                status => break assert!(worked(status), "{:?}", text(status)),
            }
        }
    }

    pub(crate) fn output(&mut self) -> Result<(Vec<f32>, Vec<u8>), eld_status_t> {
        let (mut heights_m, mut valid) = (vec![-1.0f32; PX], vec![9u8; PX]);
        // SAFETY: as above.
        let status = unsafe { ffi::eld_output(self.handle, heights_m.as_mut_ptr(), PX, valid.as_mut_ptr(), PX) };
        if worked(status) { Ok((heights_m, valid)) } else { Err(status) }
    }

    pub(crate) fn errors(&mut self) -> Result<eld_errors_t, eld_status_t> {
        let mut out = eld_errors_t { struct_bytes: size_of::<eld_errors_t>() as u32, ..eld_errors_t::default() };
        // SAFETY: as above.
        let status = unsafe { ffi::eld_errors(self.handle, &raw mut out) };
        if worked(status) { Ok(out) } else { Err(status) }
    }

    /// Returns the expected errors of heights and slopes, and the origins.
    pub(crate) fn error_maps(&mut self) -> Result<ErrorMaps, eld_status_t> {
        let (mut height_m, mut slope, mut origin) = (vec![-1.0f32; PX], vec![-1.0f32; PX], vec![99u8; PX]);
        // SAFETY: as above.
        let status = unsafe {
            ffi::eld_error_maps(self.handle, height_m.as_mut_ptr(), slope.as_mut_ptr(), origin.as_mut_ptr(), PX)
        };
        let kept = height_m.iter().chain(&slope).all(|v| *v == -1.0) && origin.iter().all(|o| *o == 99);
        assert!(worked(status) || kept, "refused, and yet written");
        if worked(status) { Ok((height_m, slope, origin)) } else { Err(status) }
    }

    pub(crate) fn scrub(&mut self, max_bytes: usize) -> eld_status_t {
        // SAFETY: as above.
        unsafe { ffi::eld_scrub(self.handle, max_bytes) }
    }

    pub(crate) fn self_test_begin(&mut self) -> eld_status_t {
        // SAFETY: as above.
        unsafe { ffi::eld_self_test_begin(self.handle) }
    }

    pub(crate) fn self_test_check(&mut self) -> eld_status_t {
        // SAFETY: as above.
        unsafe { ffi::eld_self_test_check(self.handle) }
    }

    pub(crate) fn telemetry(&mut self) -> eld_telemetry_t {
        let (out, status) = self.try_telemetry();
        assert!(worked(status), "{:?}", text(status));
        out
    }

    pub(crate) fn try_telemetry(&mut self) -> (eld_telemetry_t, eld_status_t) {
        let mut out =
            eld_telemetry_t { struct_bytes: size_of::<eld_telemetry_t>() as u32, ..eld_telemetry_t::default() };
        // SAFETY: as above.
        let status = unsafe { ffi::eld_telemetry(self.handle, &raw mut out) };
        (out, status)
    }

    /// Returns the places of the parts of the lent memory, from sizes that the core tells: `elunar_capi::layout`, a second time.
    pub(crate) fn parts(&mut self) -> Parts {
        let model = Model::new(nano()).unwrap();
        let (tile, rules) = (model.tile(), model.input_rules());
        let mut end = self.head_bytes();
        let mut next = |bytes: usize| {
            let start = end.next_multiple_of(64);
            end = start + bytes;
            start..end
        };
        Parts {
            job: next(2 * 8 * (TileJob::WORDS + 2)),
            valid: next(TileMemory::valid_len(tile)),
            dark: next(TileMemory::valid_len(tile)),
            coarse: next(4 * tile.pixels()),
            scratch: next(4 * TileMemory::scratch_len(&rules, tile)),
            lines: next(8 * TileMemory::lines_len(tile)),
            survey: next(2 * 8 * (LightSurvey::WORDS + 2)),
            arena: next(required(&model)),
        }
    }

    /// Returns the number of bytes of both copies of the context. They begin with the same bytes and have the same length.
    pub(crate) fn head_bytes(&mut self) -> usize {
        let bytes = self.bytes();
        let magic: [u8; 8] = bytes[..8].try_into().unwrap();
        2 * (8..4096).find(|&at| bytes[at..at + 8] == magic).unwrap()
    }
}

/// Returns word `index` of a model's header.
pub(crate) fn header(model: &[u8], index: usize) -> usize {
    u32_at(model, 4 * index) as usize
}

/// Returns the shipped model with changes and valid checksums.
pub(crate) fn changed(change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    let mut model = nano().to_vec();
    change(&mut model);
    seal_file(&mut model);
    model
}

/// Changes a word of a state at the start of the memory, in both of its copies, each with a magic before it and a seal behind it that is made right.
pub(crate) fn change_word(memory: &mut [u64], word: usize, change: impl Fn(u64) -> u64) {
    let seal = |words: &[u64]| {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_ne_bytes()).collect();
        let crc = elunar_core::nn::file::crc32c(&bytes);
        u64::from(crc) | u64::from(!crc) << 32
    };
    let end = (2..memory.len()).find(|end| memory[*end] == seal(&memory[..*end])).expect("a sealed copy");
    for copy in memory.chunks_exact_mut(end + 1).take(2) {
        copy[1 + word] = change(copy[1 + word]);
        copy[end] = seal(&copy[..end]);
    }
}
