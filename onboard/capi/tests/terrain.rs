//! Terrain maps through C are those of the core, line by line; what changes in memory is repaired or reported.
#![allow(unsafe_code)] // C functions

mod common;
use common::{COLS, ROWS, Tile, bits, change_word};
use elunar_capi::ffi::*;
use elunar_capi::status::*;
use elunar_capi::types::*;
use elunar_core::terrain::{HazardLimits, LineMaps, LineOptions, PixelSize, Sun, TerrainLines, hazard};
use std::ptr::{null, null_mut};

const OPTIONS: eld_terrain_options_t = eld_terrain_options_t {
    struct_bytes: size_of::<eld_terrain_options_t>() as u32,
    cols: COLS as u32,
    radius_px: 2,
    row_m: 2.0,
    col_m: 2.5,
    slope_deg: 8.0,
    roughness_m: 0.2,
    sigmas: 2.0,
    sun_azimuth_deg: 300.0,
    sun_elevation_deg: 20.0,
};

/// The maps of a line.
#[derive(Debug, Clone, PartialEq, Default)]
struct Line {
    slope_deg: Vec<u32>,
    hillshade: Vec<u8>,
    footprint_slope_deg: Vec<u32>,
    roughness_m: Vec<u32>,
    hazard: Vec<u8>,
}

/// Buffers for a line.
struct Buffers {
    floats: [Vec<f32>; 3],
    bytes: [Vec<u8>; 2],
}

impl Buffers {
    fn new(cols: usize) -> Self {
        Self { floats: [vec![-7.0; cols], vec![-7.0; cols], vec![-7.0; cols]], bytes: [vec![77; cols], vec![77; cols]] }
    }

    fn c(&mut self) -> eld_terrain_maps_t {
        let [slope, footprint, roughness] = self.floats.each_mut().map(|map| map.as_mut_ptr());
        let [hillshade, hazard] = self.bytes.each_mut().map(|map| map.as_mut_ptr());
        let struct_bytes = size_of::<eld_terrain_maps_t>() as u32;
        eld_terrain_maps_t {
            struct_bytes,
            slope_deg: slope,
            hillshade,
            footprint_slope_deg: footprint,
            roughness_m: roughness,
            hazard,
        }
    }

    fn line(&self) -> Line {
        let [slope_deg, footprint_slope_deg, roughness_m] = self.floats.each_ref().map(|map| bits(map));
        let [hillshade, hazard] = self.bytes.clone();
        Line { slope_deg, hillshade, footprint_slope_deg, roughness_m, hazard }
    }
}

/// Terrain maps through C.
struct Terrain {
    memory: Vec<u64>,
    handle: *mut eld_terrain_t,
    cols: usize,
}

impl Terrain {
    fn new(options: &eld_terrain_options_t) -> Self {
        let mut bytes = 0;
        // SAFETY: structures and memory of the test, here and below.
        assert_eq!(unsafe { eld_terrain_plan(options, &raw mut bytes) }, ELD_OK);
        let mut memory = vec![0xa5a5_a5a5_a5a5_a5a5u64; (bytes as usize).div_ceil(8)];
        let mut handle = null_mut();
        // SAFETY: as above.
        let status = unsafe { eld_terrain_init(memory.as_mut_ptr().cast(), bytes as usize, options, &raw mut handle) };
        assert_eq!(status, ELD_OK);
        Self { memory, handle, cols: options.cols as usize }
    }

    fn flip(&mut self, bit: usize) {
        self.memory[bit / 64] ^= 1 << (bit % 64);
    }

    /// Pushes a line, or finishes.
    fn call(&mut self, line: Option<(&[f32], &[f32])>) -> Result<Option<(u64, Line)>, eld_status_t> {
        let (mut buffers, mut row) = (Buffers::new(self.cols), u64::MAX);
        let maps = buffers.c();
        // SAFETY: as above.
        let status = unsafe {
            match line {
                Some((heights, sd)) => {
                    let sd = if sd.is_empty() { null() } else { sd.as_ptr() };
                    eld_terrain_push(self.handle, heights.as_ptr(), sd, heights.len(), &raw const maps, &raw mut row)
                }
                None => eld_terrain_finish(self.handle, &raw const maps, &raw mut row),
            }
        };
        match status {
            ELD_NOTICE_NO_LINE => {
                assert_eq!(row, u64::MAX);
                Ok(None)
            }
            status if worked(status) => Ok(Some((row, buffers.line()))),
            status => {
                let kept = buffers.line() == Buffers::new(self.cols).line();
                assert!(kept && row == u64::MAX, "refused, and yet written");
                Err(status)
            }
        }
    }

    /// Returns the maps of a grid.
    fn grid(&mut self, heights_m: &[f32], sd: &[f32]) -> Vec<Line> {
        let mut all = Vec::new();
        let mut take = |found: Option<(u64, Line)>| {
            let is_line = found.is_some();
            if let Some((row, line)) = found {
                assert_eq!(row, all.len() as u64);
                all.push(line);
            }
            is_line
        };
        for (line, sd) in heights_m.chunks(self.cols).zip(sd.chunks(self.cols)) {
            take(self.call(Some((line, sd))).unwrap());
        }
        while take(self.call(None).unwrap()) {}
        all
    }
}

/// Returns the maps of a grid by the core.
fn expected(heights_m: &[f32], sd: &[f32], c: &eld_terrain_options_t) -> Vec<Line> {
    let limits = HazardLimits::new(c.slope_deg, c.roughness_m).unwrap().with_sigmas(c.sigmas).unwrap();
    let options = LineOptions {
        cols: c.cols as usize,
        pixel: PixelSize { row_m: c.row_m.into(), col_m: c.col_m.into() },
        radius_px: c.radius_px as usize,
        sun: Sun { azimuth_deg: c.sun_azimuth_deg.into(), elevation_deg: c.sun_elevation_deg.into(), ..Sun::default() },
        limits,
    };
    let mut memory = vec![0.0; options.memory_len()];
    let mut lines = TerrainLines::new(options, &mut memory).unwrap();
    let (mut all, mut rest) = (Vec::new(), heights_m.chunks(options.cols).zip(sd.chunks(options.cols)));
    loop {
        let mut buffers = Buffers::new(options.cols);
        let [slope_deg, footprint_slope_deg, roughness_m] = &mut buffers.floats;
        let [hillshade, hazard] = &mut buffers.bytes;
        let mut maps = LineMaps { slope_deg, hillshade, footprint_slope_deg, roughness_m, hazard };
        let (given, ended) = match rest.next() {
            Some((line, sd)) => (lines.push_with(line, sd, &mut maps).unwrap(), false),
            None => lines.finish(&mut maps).map(|given| (given, given.is_none())).unwrap(),
        };
        if given.is_some() {
            all.push(buffers.line());
        }
        if ended {
            return all;
        }
    }
}

/// The coarse heights of the golden tile, with some relief, and errors of slopes.
fn grid() -> (Vec<f32>, Vec<f32>) {
    let tile = Tile::golden();
    let rough = |(i, z): (usize, &f32)| if *z < -1e30 { f32::NAN } else { z + (i * 7919 % 11) as f32 * 0.05 };
    (tile.coarse_m.iter().enumerate().map(rough).collect(), (0..ROWS * COLS).map(|i| (i % 50) as f32 * 0.002).collect())
}

#[test]
fn maps_are_the_cores_for_one_grid_after_another() {
    let (heights_m, sd) = grid();
    for options in [OPTIONS, eld_terrain_options_t { sigmas: 0.0, radius_px: 1, ..OPTIONS }] {
        let (mut terrain, expected) = (Terrain::new(&options), expected(&heights_m, &sd, &options));
        assert_eq!(expected.len(), ROWS);
        assert!(terrain.grid(&heights_m, &sd) == expected && terrain.grid(&heights_m, &sd) == expected);
        let seen = expected.iter().flat_map(|line| &line.hazard).fold(0, |all, hazard| all | hazard);
        let maybe = if options.sigmas > 0.0 { ELD_HAZARD_MAYBE_TOO_STEEP } else { 0 };
        assert_eq!(seen, ELD_HAZARD_TOO_STEEP | ELD_HAZARD_TOO_ROUGH | ELD_HAZARD_UNKNOWN | maybe);
    }
    assert_eq!(
        [ELD_HAZARD_TOO_STEEP, ELD_HAZARD_TOO_ROUGH, ELD_HAZARD_UNKNOWN, ELD_HAZARD_MAYBE_TOO_STEEP],
        [hazard::TOO_STEEP, hazard::TOO_ROUGH, hazard::UNKNOWN, hazard::MAYBE_TOO_STEEP]
    );
}

#[test]
fn maps_that_are_not_wanted_are_not_written() {
    let (heights_m, _) = grid();
    let mut terrain = Terrain::new(&OPTIONS);
    let expected = expected(&heights_m[..5 * COLS], &[f32::NAN; 5 * COLS], &OPTIONS);
    let (mut hazards, mut row) = (vec![9; COLS], 0);
    let struct_bytes = size_of::<eld_terrain_maps_t>() as u32;
    let mut maps = Buffers::new(COLS).c();
    maps = eld_terrain_maps_t { struct_bytes, slope_deg: null_mut(), hillshade: null_mut(), ..maps };
    maps = eld_terrain_maps_t { footprint_slope_deg: null_mut(), roughness_m: null_mut(), ..maps };
    maps.hazard = hazards.as_mut_ptr();
    for (number, line) in heights_m.chunks(COLS).take(3).enumerate() {
        // SAFETY: buffers of the test.
        let status =
            unsafe { eld_terrain_push(terrain.handle, line.as_ptr(), null(), COLS, &raw const maps, &raw mut row) };
        assert_eq!(status, if number < 2 { ELD_NOTICE_NO_LINE } else { ELD_OK });
    }
    assert_eq!((row, &hazards), (0, &expected[0].hazard));
    // The rest of a grid comes out before the next one begins.
    assert_eq!(terrain.call(None).unwrap().unwrap().0, 1);
    assert_eq!(terrain.call(Some((&heights_m[..COLS], &[]))), Err(ELD_REFUSED_UNFINISHED));
    assert_eq!(terrain.call(None).unwrap().unwrap().0, 2);
    assert_eq!((terrain.call(None), terrain.call(None)), (Ok(None), Ok(None)));
    assert_eq!(terrain.call(Some((&heights_m[..COLS], &[]))), Ok(None));
}

#[test]
fn flipped_bits_of_the_state_are_repaired_and_those_of_lines_reported() {
    let (heights_m, sd) = grid();
    let (mut terrain, expected) = (Terrain::new(&OPTIONS), expected(&heights_m, &sd, &OPTIONS));
    let line = |row: usize| Some((&heights_m[row * COLS..][..COLS], &sd[row * COLS..][..COLS]));
    for row in 0..4 {
        terrain.call(line(row)).unwrap();
    }
    let clean = terrain.memory.clone();
    let words = (8..).find(|at| clean[*at] == clean[0]).unwrap();
    for bit in (0..128 * words).step_by(61) {
        terrain.flip(bit);
        assert_eq!(terrain.call(line(4)).unwrap().unwrap(), (2, expected[2].clone()), "bit {bit}");
        terrain.memory.copy_from_slice(&clean);
    }
    let first = (128 * words).next_multiple_of(512);
    for bit in (first..first + 32 * 10 * COLS).step_by(4099) {
        terrain.flip(bit);
        assert_eq!(terrain.call(line(4)), Err(ELD_FAULT_LINES), "bit {bit}");
        // The grid begins again.
        assert_eq!(terrain.call(line(0)), Ok(None));
        terrain.memory.copy_from_slice(&clean);
    }
    terrain.flip(777);
    terrain.flip(64 * words + 900);
    assert_eq!(terrain.call(line(4)), Err(ELD_FAULT_CONTEXT_LOST));
    let mut moved = clean.clone();
    terrain.memory.copy_from_slice(&clean);
    moved.copy_from_slice(&clean);
    terrain.handle = moved.as_mut_ptr().cast();
    assert_eq!(terrain.call(line(4)), Err(ELD_FAULT_CONTEXT_MOVED));
}

#[test]
fn what_is_wrong_has_a_status() {
    let plan = |options: &eld_terrain_options_t| {
        let mut bytes = 0;
        // SAFETY: structures of the test.
        unsafe { eld_terrain_plan(options, &raw mut bytes) }
    };
    let changes: [fn(&mut eld_terrain_options_t); 12] = [
        |o| o.cols = 0,
        |o| o.radius_px = 0,
        |o| o.radius_px = 17,
        |o| o.row_m = 0.0,
        |o| o.col_m = f32::NAN,
        |o| o.slope_deg = 91.0,
        |o| o.slope_deg = f32::NAN,
        |o| o.roughness_m = 0.0,
        |o| o.sigmas = -1.0,
        |o| o.sigmas = f32::INFINITY,
        |o| o.sun_azimuth_deg = f32::NAN,
        |o| o.sun_elevation_deg = f32::INFINITY,
    ];
    for (number, change) in changes.iter().enumerate() {
        let mut options = OPTIONS;
        change(&mut options);
        assert_eq!(plan(&options), ELD_REFUSED_OPTIONS, "change {number}");
    }
    assert_eq!(plan(&eld_terrain_options_t { struct_bytes: 8, ..OPTIONS }), ELD_REFUSED_STRUCT_BYTES);
    let mut terrain = Terrain::new(&OPTIONS);
    let (bytes, place) = (8 * terrain.memory.len(), terrain.memory.as_mut_ptr());
    let mut handle = null_mut();
    let mut init = |place: *mut u64, bytes: usize| {
        // SAFETY: memory of the test.
        unsafe { eld_terrain_init(place.cast(), bytes, &OPTIONS, &raw mut handle) }
    };
    assert_eq!(init(place, bytes - 8), ELD_REFUSED_MEMORY_SHORT);
    assert_eq!(init(place.wrapping_byte_add(4), bytes - 8), ELD_REFUSED_MEMORY_ALIGNMENT);
    assert_eq!((init(null_mut(), 8), init(place, usize::MAX)), (ELD_REFUSED_NULL, ELD_REFUSED_LENGTH));
    // SAFETY: refused before anything is written.
    let status = unsafe { eld_terrain_init(place.cast(), bytes, &OPTIONS, place.wrapping_add(2).cast()) };
    assert_eq!(status, ELD_REFUSED_OVERLAP);
    let (line, mut buffers, mut row) = (vec![0.0; COLS], Buffers::new(COLS), 0);
    let good = buffers.c();
    let mut push = |terrain: *mut eld_terrain_t, line: *const f32, len: usize, maps: &eld_terrain_maps_t| {
        // SAFETY: buffers of the test; what is wrong is refused before it is used.
        unsafe { eld_terrain_push(terrain, line, null(), len, maps, &raw mut row) }
    };
    let at = line.as_ptr();
    assert_eq!(push(null_mut(), at, COLS, &good), ELD_REFUSED_NULL);
    assert_eq!(push(terrain.handle, at, COLS - 1, &good), ELD_REFUSED_BUFFER);
    assert_eq!(push(terrain.handle, null(), COLS, &good), ELD_REFUSED_NULL);
    assert_eq!(push(terrain.handle, at.wrapping_byte_add(1), COLS, &good), ELD_REFUSED_ALIGNMENT);
    assert_eq!(push(terrain.handle, place.cast(), COLS, &good), ELD_REFUSED_OVERLAP);
    assert_eq!(push(terrain.handle, good.slope_deg, COLS, &good), ELD_REFUSED_OVERLAP);
    let over = eld_terrain_maps_t { hazard: good.hillshade, ..good };
    assert_eq!(push(terrain.handle, at, COLS, &over), ELD_REFUSED_OVERLAP);
    let short = eld_terrain_maps_t { struct_bytes: 4, ..good };
    assert_eq!(push(terrain.handle, at, COLS, &short), ELD_REFUSED_STRUCT_BYTES);
    assert_eq!(push(terrain.handle, at, COLS, &good), ELD_NOTICE_NO_LINE);
}

/// A call marks the memory while it works. The next call finds the mark if it did not return: the grid is lost and begins again.
#[test]
fn a_call_that_did_not_return_is_told_by_the_next() {
    const BUSY: usize = 9;
    let line = [5.0; COLS];
    let mut terrain = Terrain::new(&OPTIONS);
    terrain.call(Some((&line, &[]))).unwrap();
    change_word(&mut terrain.memory, BUSY, |_| 1);
    assert_eq!(terrain.call(Some((&line, &[]))).err(), Some(ELD_FAULT_INTERRUPTED));
    // The first line of a grid gives none yet.
    assert_eq!(terrain.call(Some((&line, &[]))).map(|given| given.is_none()), Ok(true));
}
