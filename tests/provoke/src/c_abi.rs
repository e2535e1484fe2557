//! Arbitrary calls of the C interface, for the fuzz target `c_abi` and its seeded replay.
//!
//! Bytes choose the next function, one of two contexts, and errors in its arguments; bits flip between calls. A second implementation of
//! the header's rules says which statuses are possible.
#![allow(unsafe_code)] // C functions

mod alone;
mod errors;
mod light;

pub(crate) use light::odd_light;

use crate::model::{Reader, mutated, sound_models};
use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;
use core::ffi::CStr;
use core::ptr::{null, null_mut};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use elunar_capi::ffi;
use elunar_capi::status::*;
use elunar_capi::types::*;
use elunar_core::nn::file::crc32c;

/// Words before and after lent memory, which must not change.
const GUARD: usize = 16;
const GUARD_WORD: u64 = 0xc3c3_c3c3_c3c3_c3c3;
/// Largest amount of lent memory, bytes: boards have little.
const LARGEST: u64 = 1 << 21;
/// Multiply-accumulates after which a changed model is not run any further.
const MOST_MACS: u64 = 1 << 22;
/// Number of good tiles.
const TILES: usize = 3;

/// The results of some calls.
#[derive(Debug, Clone, Copy, Default)]
pub struct Tally {
    /// Number of calls.
    pub calls: usize,
    /// Numbers of calls that did their work, that were refused, and that ended with a fault.
    pub worked: usize,
    /// See [`Self::worked`].
    pub refused: usize,
    /// See [`Self::worked`].
    pub faults: usize,
    /// Number of tiles with the expected heights.
    pub tiles: usize,
    /// Number of flipped bits of a context that were repaired.
    pub repairs: usize,
}

/// The contents of the arena in an undamaged slot.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Empty,
    /// A tile is prepared: a good one by its number, or another.
    Preparing {
        good: Option<usize>,
    },
    /// A good tile by its number, or another tile.
    Tile {
        good: Option<usize>,
        done: bool,
    },
    SelfTest {
        done: bool,
    },
    Light,
}

/// A context with its memory, its model and its known state.
struct Slot {
    memory: Vec<u64>,
    model: Vec<u8>,
    /// Number of the sound model, if the model is one.
    sound: Option<usize>,
    handle: *mut eld_context_t,
    info: eld_model_info_t,
    phase: Phase,
    /// The tile that is prepared.
    prepared: Option<Tile>,
    /// Whether nothing was ever damaged except one copy of the context.
    whole: bool,
    macs: u64,
}

/// A tile with the arrays it points to.
struct Tile {
    image: Vec<f32>,
    coarse_m: Vec<f32>,
    mask: Option<Vec<u8>>,
    posts: Option<Box<eld_posts_t>>,
    c: eld_tile_t,
}

impl Tile {
    /// Returns good tile `number` of a shape.
    fn good(number: usize, (rows, cols): (usize, usize)) -> Self {
        let at = |i: usize| ((i / cols) as f32, (i % cols) as f32);
        let wave = |i: usize, p: f32| libm::sinf(at(i).0 / p) + libm::cosf(at(i).1 / (p + 1.0) + number as f32);
        let image = (0..rows * cols).map(|i| 100.0 + 20.0 * wave(i, 3.0) + (i * 7919 % 13) as f32).collect();
        let coarse_m = (0..rows * cols).map(|i| -1900.0 + 9.0 * wave(i, 11.0)).collect();
        let mask = (number == 1).then(|| (0..rows * cols).map(|i| (i % 31 != 5) as u8).collect());
        let c = eld_tile_t {
            struct_bytes: size_of::<eld_tile_t>() as u32,
            pixel_m: 2.0,
            coarse_px: 9.0,
            sun_azimuth_deg: 70.0 * number as f32,
            sun_elevation_deg: if number == 2 { f32::NAN } else { 30.0 },
            network_alone: 0,
            processor_checks: 0,
            image: eld_pixels_t {
                data: null(),
                data_bytes: 0,
                row_bytes: 0,
                format: ELD_PIXELS_F32,
                flags: 0,
                gain: 1.0,
                offset: 0.0,
                null_code: 0,
                saturated_from: 0,
            },
            coarse_m: null(),
            coarse_len: 0,
            valid: null(),
            valid_len: 0,
            posts: null(),
            light: null(),
        };
        Self { image, coarse_m, mask, posts: None, c }.pointed()
    }

    fn pointed(mut self) -> Self {
        (self.c.image.data, self.c.image.data_bytes) = (self.image.as_ptr().cast(), size_of_val(&self.image[..]));
        (self.c.coarse_m, self.c.coarse_len) = (self.coarse_m.as_ptr(), self.coarse_m.len());
        (self.c.valid, self.c.valid_len) = self.mask.as_ref().map_or((null(), 0), |mask| (mask.as_ptr(), mask.len()));
        self
    }

    /// Returns the tile with changes that may be errors.
    fn odd(mut self, reader: &mut Reader<'_>, memory: *const u64) -> Self {
        let (how, value) = (reader.byte(), reader.word());
        let (at, float) = (value as usize % self.image.len(), f32::from_bits(reader.word()));
        match how % 22 {
            0 => self.c.image.data = null(),
            1 => self.c.coarse_m = self.c.coarse_m.wrapping_byte_add(1 + at % 3),
            2 => self.c.image.data_bytes = reader.size(4 * self.image.len()),
            3 => self.c.coarse_len = reader.size(1 << 20),
            4 => self.c.valid_len = reader.size(1 << 20),
            5 => self.c.struct_bytes = value,
            6 => (self.c.network_alone, self.c.processor_checks) = (value % 3, value / 3 % 3),
            7 => self.c.pixel_m = float,
            8 => self.c.coarse_px = float,
            9 => (self.c.sun_azimuth_deg, self.c.sun_elevation_deg) = (float, f32::from_bits(reader.word())),
            10 => self.c.image.data = memory.cast(),
            11 => self.image[..=at].fill(float),
            12 => self.coarse_m[at..].fill(float),
            13 => self.image.fill(float),
            14 => self.mask = Some(vec![value as u8; self.image.len()]),
            15 => (self.c.image.gain, self.c.image.offset) = (float, f32::from_bits(reader.word())),
            16 => (self.c.image.format, self.c.image.row_bytes) = (value % 6, reader.size(1 << 10)),
            // Any bytes are codes.
            17 => (self.c.image.format, self.c.image.null_code) = (1 + value % 4, value >> 20),
            18 => {
                (self.c.image.format, self.c.image.flags) = (1 + value % 4, value >> 8 & 7);
                (self.c.image.null_code, self.c.image.saturated_from) = (value >> 16, reader.word() >> 16);
            }
            19 | 20 => {
                let (posts_m, most) = (self.coarse_m.as_ptr(), self.coarse_m.len());
                let [row0, rows_per_line, col0, cols_per_px] = [(); 4].map(|()| match reader.byte() {
                    255 => f64::from(float),
                    byte => f64::from(byte) / 16.0 - 4.0,
                });
                let (cols, posts_len) = (reader.byte() as usize % 9, at.min(most) + usize::from(how % 22 == 20) % 2);
                let posts_len = if cols > 0 && value & 1 == 0 { posts_len / cols * cols } else { posts_len };
                let posts = eld_posts_t { posts_m, posts_len, cols, row0, rows_per_line, col0, cols_per_px };
                self.c.posts = &raw const **self.posts.insert(Box::new(posts));
                // Mostly in place of the coarse DTM.
                (self.c.coarse_m, self.c.coarse_len) = match value >> 1 & 7 {
                    0 => (self.c.coarse_m, self.c.coarse_len),
                    1 => (null(), self.c.coarse_len),
                    _ => (null(), 0),
                };
            }
            _ => self.mask.get_or_insert(vec![1; self.image.len()])[at] = value as u8,
        }
        if matches!(how % 22, 14 | 21) { self.pointed() } else { self }
    }
}

/// Returns the checksum of a model's heights for a good tile, computed in one step with a separate context; computed once.
fn expected(model: usize, tile: usize) -> u32 {
    // 0 is not known: it is then computed again.
    static KNOWN: [[AtomicU32; TILES]; 4] = [const { [const { AtomicU32::new(0) }; TILES] }; 4];
    let known = &KNOWN[model][tile];
    if known.load(Relaxed) != 0 {
        return known.load(Relaxed);
    }
    let mut slot = Slot::new(sound_models()[model].to_vec(), Some(model)).expect("a sound model");
    let good = Tile::good(tile, slot.shape());
    // SAFETY: a context and a tile of the test.
    let statuses = unsafe { [ffi::eld_begin(slot.handle, &good.c), ffi::eld_step(slot.handle, u64::MAX)] };
    assert!(statuses.iter().all(|status| worked(*status)), "{statuses:x?}");
    let crc = slot.heights().expect("a finished tile");
    known.store(crc, Relaxed);
    crc
}

impl Slot {
    /// Makes a slot with a context; the error is the status of the refusal.
    fn new(model: Vec<u8>, sound: Option<usize>) -> Result<Self, eld_status_t> {
        let mut info = eld_model_info_t { struct_bytes: size_of::<eld_model_info_t>() as u32, ..Default::default() };
        // SAFETY: a buffer and a structure of the test.
        let status = unsafe { ffi::eld_model_check(model.as_ptr().cast(), model.len(), &raw mut info) };
        if status != ELD_OK {
            return Err(status);
        }
        let words = if info.memory_bytes > LARGEST { 0 } else { (info.memory_bytes as usize).div_ceil(8) };
        let memory = vec![GUARD_WORD; words + 2 * GUARD];
        let (phase, handle) = (Phase::Empty, null_mut());
        let mut slot = Self { memory, model, sound, handle, info, phase, prepared: None, whole: true, macs: 0 };
        let status = if words == 0 { ELD_REFUSED_MEMORY_SHORT } else { slot.init(info.memory_bytes as usize, 0) };
        if status == ELD_OK { Ok(slot) } else { Err(status) }
    }

    fn init(&mut self, bytes: usize, shift: usize) -> eld_status_t {
        let memory = self.memory[GUARD..].as_mut_ptr().wrapping_byte_add(shift);
        let (model, len) = (self.model.as_ptr().cast(), self.model.len());
        // SAFETY: within memory of the test, or refused.
        unsafe {
            if self.info.header_crc.is_multiple_of(2) {
                return ffi::eld_init(memory.cast(), bytes, model, len, &raw mut self.handle);
            }
            let (mut check, mut status) = (eld_check_t::default(), ELD_RUNNING);
            while status == ELD_RUNNING {
                status = ffi::eld_model_check_step(model, len, 10_000, &raw mut check, &raw mut self.info);
            }
            if status != ELD_OK {
                self.handle = null_mut();
                return status;
            }
            ffi::eld_init_checked(memory.cast(), bytes, model, len, &raw const check, &raw mut self.handle)
        }
    }

    fn shape(&self) -> (usize, usize) {
        (self.info.tile_rows as usize, self.info.tile_cols as usize)
    }

    /// Returns the lent memory as bytes.
    fn bytes(&mut self) -> &mut [u8] {
        let words = self.memory.len() - 2 * GUARD;
        // SAFETY: memory of the test, between calls.
        unsafe { core::slice::from_raw_parts_mut(self.memory[GUARD..].as_mut_ptr().cast(), 8 * words) }
    }

    fn heights(&mut self) -> Result<u32, eld_status_t> {
        let px = self.shape().0 * self.shape().1;
        let (mut heights_m, mut valid) = (vec![0f32; px], vec![2u8; px]);
        // SAFETY: a context and buffers of the test.
        let status = unsafe { ffi::eld_output(self.handle, heights_m.as_mut_ptr(), px, valid.as_mut_ptr(), px) };
        if !worked(status) {
            assert!(valid.iter().all(|v| *v == 2), "refused, and yet written");
            return Err(status);
        }
        assert!(valid.iter().all(|v| *v < 2));
        let bytes: Vec<u8> = heights_m.iter().flat_map(|v| v.to_le_bytes()).chain(valid).collect();
        Ok(crc32c(&bytes))
    }

    /// Returns the number of bytes of both copies of the context.
    fn head_bytes(&mut self) -> usize {
        let bytes = self.bytes();
        let second = (8..2048).find(|&at| bytes[at..at + 7] == bytes[..7]);
        2 * second.unwrap_or(256)
    }

    fn guarded(&self) {
        let (front, rest) = self.memory.split_at(GUARD);
        let guards = front.iter().chain(&rest[rest.len() - GUARD..]);
        assert!(guards.copied().all(|word| word == GUARD_WORD), "memory that was not lent has changed");
    }
}

/// The state of the test.
struct Play<'b> {
    reader: Reader<'b>,
    slots: [Option<Slot>; 2],
    tally: Tally,
}

/// Runs calls chosen by `bytes`.
///
/// # Panics
/// If a status is unknown, a sound context reports a fault, heights differ, or memory that was not lent has changed.
pub fn c_abi(bytes: &[u8]) -> Tally {
    let mut play = Play { reader: Reader(bytes), slots: [None, None], tally: Tally::default() };
    while !play.reader.0.is_empty() {
        let which = play.reader.byte() as usize % 2;
        match play.slots[which].take() {
            None => play.slots[which] = play.make(),
            Some(slot) => play.slots[which] = play.call(slot),
        }
    }
    play.tally
}

impl Play<'_> {
    fn count(&mut self, status: eld_status_t) -> eld_status_t {
        assert!(STATUSES.iter().any(|known| known.status == status), "{status:08x} is no status");
        // SAFETY: a text of the library.
        let text = unsafe { CStr::from_ptr(ffi::eld_status_text(status)) };
        assert!(!text.is_empty());
        self.tally.calls += 1;
        match severity(status) {
            GOOD | NOTICE => self.tally.worked += 1,
            REFUSED => self.tally.refused += 1,
            _ => self.tally.faults += 1,
        }
        status
    }

    /// Makes a slot with a context, mostly of a sound model.
    fn make(&mut self) -> Option<Slot> {
        let (how, which) = (self.reader.byte(), self.reader.byte() as usize % sound_models().len());
        let sound = sound_models()[which];
        let made = match how % 8 {
            0 => {
                let patches: Vec<u8> = (0..1 + 10 * (1 + how as usize / 64)).map(|_| self.reader.byte()).collect();
                Slot::new(mutated(&patches), None)
            }
            1 => Slot::new(self.reader.0.to_vec(), None),
            2 => {
                let mut model = sound.to_vec();
                let at = self.reader.word() as usize % model.len();
                model[at] ^= 1 << (how / 32);
                Slot::new(model, None)
            }
            _ => Slot::new(sound.to_vec(), Some(which)),
        };
        match made {
            Ok(slot) => {
                self.count(ELD_OK);
                Some(slot)
            }
            Err(status) => {
                assert_eq!(severity(self.count(status)), REFUSED);
                assert!(how % 8 < 3, "a sound model is refused: {status:08x}");
                None
            }
        }
    }

    /// Does one call on a slot, or damages it.
    fn call(&mut self, mut slot: Slot) -> Option<Slot> {
        let what = self.reader.byte() % 22;
        let status = match what {
            0 => {
                // A new context, with an error in the arguments.
                let needed = slot.info.memory_bytes as usize;
                let (bytes, shift) =
                    [(needed - 1, 0), (needed, 4), (needed, 0), (0, 0)][self.reader.byte() as usize % 4];
                let before = slot.handle;
                let status = slot.init(bytes, shift);
                assert_eq!(slot.handle.is_null(), !worked(status));
                if worked(status) {
                    (slot.phase, slot.macs) = (Phase::Empty, 0);
                } else {
                    slot.handle = before;
                }
                status
            }
            1..=3 => self.begin(&mut slot),
            4..=7 | 17..=19 => self.step(&mut slot),
            8 | 20..=21 => self.output(&mut slot),
            9 => {
                let max_bytes = self.reader.size(1 << 16).min(1 << 20);
                // SAFETY: a context of the test, here and below.
                unsafe { ffi::eld_scrub(slot.handle, max_bytes) }
            }
            10 => self.self_test(&mut slot),
            11 => self.telemetry(&mut slot),
            12 => return self.nothing_there(slot),
            16 => self.light(&mut slot),
            _ => return self.damage(slot),
        };
        self.count(status);
        slot.guarded();
        if slot.whole {
            let known = slot.sound.is_some() || status != ELD_FAULT_SELF_TEST;
            // Heights beyond all ground come of any tile but a good one, and of changed weights.
            let good = matches!(slot.phase, Phase::Tile { good: Some(_), .. }) && slot.sound.is_some();
            let known = known && (good || status != ELD_FAULT_HEIGHT);
            assert!(severity(status) != FAULT || !known, "a sound context reports {:?}", text(status));
            if status == ELD_FAULT_HEIGHT {
                slot.phase = Phase::Empty;
            }
        }
        Some(slot)
    }

    fn begin(&mut self, slot: &mut Slot) -> eld_status_t {
        let (how, pieces) = (self.reader.byte(), self.reader.byte());
        let budget = [1, 1 << 12, 1 << 20, u64::MAX, u64::MAX, u64::MAX, u64::MAX, u64::MAX][pieces as usize % 8];
        let goes_on = matches!(slot.phase, Phase::Preparing { .. }) && pieces & 8 == 0 || pieces > 240;
        if let (Some(tile), true) = (&slot.prepared, goes_on) {
            // Goes on with a tile that is prepared; with one that was prepared before another call took its place, it begins again.
            let c = tile.c;
            let good = match slot.phase {
                Phase::Preparing { good } => good,
                _ => None,
            };
            return Self::begin_step(slot, &c, budget, good);
        }
        let good = how as usize / 8 % TILES;
        let mut tile = Tile::good(good, slot.shape());
        let odd = how % 8 < 4;
        if odd {
            tile = tile.odd(&mut self.reader, slot.memory[GUARD..].as_ptr());
        }
        let c = tile.c;
        let status = Self::begin_step(slot, &c, budget, (!odd).then_some(good));
        assert!(odd || worked(status) || !slot.whole || slot.sound.is_none(), "a good tile: {:?}", text(status));
        if status == ELD_RUNNING {
            slot.prepared = Some(tile);
        }
        status
    }

    fn begin_step(slot: &mut Slot, tile: &eld_tile_t, budget: u64, good: Option<usize>) -> eld_status_t {
        // SAFETY: a context of the test; wrong fields of the tile are refused before they are used.
        let status = unsafe { ffi::eld_begin_step(slot.handle, tile, budget) };
        if status == ELD_RUNNING {
            slot.phase = Phase::Preparing { good };
        } else if worked(status) {
            slot.phase = Phase::Tile { good, done: false };
        }
        // That no post covers a valid pixel shows only when the tile is prepared; then it is lost.
        if status == ELD_REFUSED_TILE_MASKED && !tile.posts.is_null() {
            let mut out = eld_telemetry_t { struct_bytes: size_of::<eld_telemetry_t>() as u32, ..Default::default() };
            // SAFETY: a context and a structure of the test.
            let told = unsafe { ffi::eld_telemetry(slot.handle, &raw mut out) };
            slot.phase = if worked(told) && out.phase == ELD_PHASE_EMPTY { Phase::Empty } else { slot.phase };
        }
        assert!(budget < u64::MAX || status != ELD_RUNNING, "all work at once");
        status
    }

    fn step(&mut self, slot: &mut Slot) -> eld_status_t {
        let budget = [0, 1, 1 << 14, 1 << 18, 1 << 30, u64::MAX][self.reader.byte() as usize % 6];
        if slot.sound.is_none() && (slot.macs > MOST_MACS || slot.info.largest_unit_macs > MOST_MACS) {
            return ELD_OK;
        }
        let budget = if slot.sound.is_some() { budget } else { budget.min(1 << 18) };
        // SAFETY: a context of the test.
        let status = unsafe { ffi::eld_step(slot.handle, budget) };
        slot.macs = slot.macs.saturating_add(budget.min(slot.info.tile_macs).max(slot.info.largest_unit_macs));
        if slot.whole {
            assert_eq!(
                status == ELD_REFUSED_NO_TILE,
                matches!(slot.phase, Phase::Empty | Phase::Light),
                "{:?}",
                text(status)
            );
            let preparing = matches!(slot.phase, Phase::Preparing { .. });
            assert_eq!(status == ELD_REFUSED_NOT_BEGUN, preparing, "{:?}", text(status));
        }
        let finished = worked(status) && status != ELD_RUNNING;
        match &mut slot.phase {
            Phase::Tile { done, .. } | Phase::SelfTest { done } => *done |= finished,
            Phase::Empty | Phase::Light | Phase::Preparing { .. } => {}
        }
        status
    }

    fn output(&mut self, slot: &mut Slot) -> eld_status_t {
        let found = slot.heights();
        if slot.whole {
            match (slot.phase, found) {
                (Phase::Empty | Phase::Light, found) => assert_eq!(found, Err(ELD_REFUSED_NO_TILE)),
                (Phase::SelfTest { .. }, found) => assert_eq!(found, Err(ELD_REFUSED_OTHER_TILE)),
                (Phase::Preparing { .. } | Phase::Tile { done: false, .. }, found) => {
                    assert_eq!(found, Err(ELD_REFUSED_NOT_DONE))
                }
                (Phase::Tile { good, done: true }, found) => {
                    let crc = found.expect("a finished tile");
                    if let (Some(model), Some(tile)) = (slot.sound, good) {
                        assert_eq!(crc, expected(model, tile), "other heights than in one step");
                        self.tally.tiles += 1;
                    }
                }
            }
        }
        found.map_or_else(|status| status, |_| ELD_OK)
    }

    fn self_test(&mut self, slot: &mut Slot) -> eld_status_t {
        let how = self.reader.byte();
        if how % 8 == 7 {
            // SAFETY: a context of the test.
            let status = unsafe { ffi::eld_abort(slot.handle) };
            if slot.whole {
                assert_eq!(status == ELD_REFUSED_NO_TILE, slot.phase == Phase::Empty, "{:?}", text(status));
            }
            if worked(status) {
                slot.phase = Phase::Empty;
            }
            return status;
        }
        if how.is_multiple_of(2) {
            // SAFETY: a context of the test.
            let status = unsafe { ffi::eld_self_test_begin(slot.handle) };
            if worked(status) {
                slot.phase = Phase::SelfTest { done: false };
            }
            return status;
        }
        // SAFETY: a context of the test.
        let status = unsafe { ffi::eld_self_test_check(slot.handle) };
        if slot.whole && slot.sound.is_some() {
            assert_eq!(worked(status), slot.phase == Phase::SelfTest { done: true }, "{:?}", text(status));
        }
        status
    }

    fn telemetry(&mut self, slot: &mut Slot) -> eld_status_t {
        let struct_bytes = size_of::<eld_telemetry_t>() as u32;
        let mut out = eld_telemetry_t { struct_bytes, ..Default::default() };
        // SAFETY: a context and a structure of the test.
        let status = unsafe { ffi::eld_telemetry(slot.handle, &raw mut out) };
        if slot.whole {
            let phase = match slot.phase {
                Phase::Empty => ELD_PHASE_EMPTY,
                Phase::Preparing { .. } => ELD_PHASE_PREPARING,
                Phase::Light => ELD_PHASE_LIGHT,
                Phase::Tile { done, .. } => ELD_PHASE_TILE + done as u32,
                Phase::SelfTest { done } => ELD_PHASE_SELF_TEST + done as u32,
            };
            assert_eq!((worked(status), out.phase), (true, phase));
        }
        self.errors(slot);
        status
    }

    /// Flips bits.
    fn damage(&mut self, mut slot: Slot) -> Option<Slot> {
        let (how, bit) = (self.reader.byte(), self.reader.word() as usize);
        let head = slot.head_bytes();
        match how % 8 {
            // One bit of the context, which must have no effect.
            0..=3 => {
                let (place, whole) = (bit % (8 * head), slot.whole);
                slot.bytes()[place / 8] ^= 1 << (place % 8);
                self.telemetry(&mut slot);
                self.tally.repairs += usize::from(whole);
            }
            // A bit anywhere behind the context.
            4 => {
                let place = bit % (8 * (slot.bytes().len() - head)) + 8 * head;
                slot.bytes()[place / 8] ^= 1 << (place % 8);
                slot.whole = false;
            }
            // Bytes of both copies.
            5 => {
                for at in [bit % (head / 2), head / 2 + bit / 64 % (head / 2)] {
                    slot.bytes()[at] ^= how | 1;
                }
                slot.whole = false;
            }
            // A bit of the model in use.
            6 => {
                let place = bit % (8 * slot.model.len());
                slot.model[place / 8] ^= 1 << (place % 8);
                slot.whole = false;
            }
            _ => return None,
        }
        Some(slot)
    }
}
