//! Terrain maps of a grid whose lines come one at a time: the state between two calls, under checksums, and the lines that are kept.
//!
//! ```text
//! | state, twice | lines under a footprint, f32 |
//! ```

use crate::context::Outcome;
use crate::sealed::{Sealed, block_bytes};
use crate::status::*;
use crate::types::{eld_status_t, eld_terrain_options_t};
use elunar_core::nn::file::Crc32c;
use elunar_core::terrain::{
    HazardLimits, LineMaps, LineOptions, LinesPaused, MAX_RADIUS_PX, PixelSize, Sun, TerrainError, TerrainLines,
};

/// Lines of the largest footprint, and as many of their slopes' errors.
const MOST_LINES: usize = 2 * (2 * MAX_RADIUS_PX + 1);
/// Words of the state: address, lengths, options, position, and the checksums of the lines, two in a word.
const WORDS: usize = 10 + MOST_LINES / 2;
/// Bytes of both copies of the state.
pub(crate) const STATE_BYTES: usize = block_bytes(WORDS);
/// "ELDTER" and the version of the state.
const SEALED: Sealed<WORDS> = Sealed { magic: u64::from_le_bytes(*b"ELDTER\x00\x01") };
/// Alignment of the lines (a cache line), if the memory has it.
const LINE_BYTES: usize = 64;

/// First byte of the lines.
pub(crate) const LINES_AT: usize = STATE_BYTES.next_multiple_of(LINE_BYTES);

/// Returns the options of a caller.
///
/// # Errors
/// [`ELD_REFUSED_OPTIONS`].
pub(crate) fn options(c: &eld_terrain_options_t) -> Result<LineOptions, eld_status_t> {
    let limits = HazardLimits::new(c.slope_deg, c.roughness_m).and_then(|limits| limits.with_sigmas(c.sigmas));
    let options = LineOptions {
        cols: c.cols as usize,
        pixel: PixelSize { row_m: c.row_m.into(), col_m: c.col_m.into() },
        radius_px: c.radius_px as usize,
        sun: Sun { azimuth_deg: c.sun_azimuth_deg.into(), elevation_deg: c.sun_elevation_deg.into(), ..Sun::default() },
        limits: limits.map_err(|_| ELD_REFUSED_OPTIONS)?,
    };
    let is_sun = c.sun_azimuth_deg.is_finite() && c.sun_elevation_deg.is_finite();
    if is_sun { options.check().map(|()| options).map_err(|_| ELD_REFUSED_OPTIONS) } else { Err(ELD_REFUSED_OPTIONS) }
}

/// Returns the number of bytes of memory; an error if this machine cannot address them.
pub(crate) fn bytes(options: &LineOptions) -> Result<usize, eld_status_t> {
    let lines = options.memory_len().checked_mul(size_of::<f32>()).and_then(|bytes| bytes.checked_add(LINES_AT));
    lines.filter(|bytes| *bytes <= isize::MAX as usize).ok_or(ELD_REFUSED_OPTIONS)
}

/// Returns the checksum of a line.
fn floats_crc(line: &[f32]) -> u32 {
    let mut crc = Crc32c::default();
    line.iter().for_each(|value| crc.update(&value.to_bits().to_le_bytes()));
    crc.value()
}

/// The state between two calls.
#[derive(Debug, Clone, Copy)]
pub(crate) struct State {
    home: u64,
    pub(crate) options: eld_terrain_options_t,
    paused: LinesPaused,
    /// 1 while a call changes the lines.
    busy: u32,
    crcs: [u32; MOST_LINES],
}

impl State {
    /// Writes a new state, whose lines are zero.
    pub(crate) fn make(block: &mut [u8], home: usize, options: eld_terrain_options_t) {
        let state = Self { home: home as u64, options, paused: LinesPaused::default(), busy: 0, crcs: [0; MOST_LINES] };
        state.write(block);
    }

    fn write(&self, block: &mut [u8]) {
        let eld_terrain_options_t { cols, radius_px, row_m, col_m, slope_deg, roughness_m, sigmas, .. } = self.options;
        let pair = |low: u32, high: u32| u64::from(low) | u64::from(high) << 32;
        let floats = |low: f32, high: f32| pair(low.to_bits(), high.to_bits());
        let LinesPaused { taken, given, finishing } = self.paused;
        let head = [
            self.home,
            pair(cols, radius_px),
            floats(row_m, col_m),
            floats(slope_deg, roughness_m),
            floats(sigmas, self.options.sun_azimuth_deg),
            pair(self.options.sun_elevation_deg.to_bits(), self.options.struct_bytes),
            taken,
            given,
            finishing.into(),
            self.busy.into(),
        ];
        let mut words = [0; WORDS];
        let crcs = self.crcs.as_chunks::<2>().0.iter().map(|[low, high]| pair(*low, *high));
        words.iter_mut().zip(head.into_iter().chain(crcs)).for_each(|(to, word)| *to = word);
        SEALED.write(block, &words);
    }

    /// Reads the state at address `home`.
    ///
    /// # Errors
    /// The status with which the call ends.
    pub(crate) fn open(block: &mut [u8], home: usize) -> Result<Open, eld_status_t> {
        let (words, repaired) = SEALED.read(block).ok_or(ELD_FAULT_CONTEXT_LOST)?;
        let Some((head, crcs)) = words.split_first_chunk::<10>() else { return Err(ELD_FAULT_CONTEXT_LOST) };
        let [home_word, sizes, pixel, limits, sigmas_sun, sun, taken, given, finishing, busy] = *head;
        let [low, high] = [|word: u64| word as u32, |word: u64| (word >> 32) as u32];
        let float = f32::from_bits;
        let options = eld_terrain_options_t {
            struct_bytes: high(sun),
            cols: low(sizes),
            radius_px: high(sizes),
            row_m: float(low(pixel)),
            col_m: float(high(pixel)),
            slope_deg: float(low(limits)),
            roughness_m: float(high(limits)),
            sigmas: float(low(sigmas_sun)),
            sun_azimuth_deg: float(high(sigmas_sun)),
            sun_elevation_deg: float(low(sun)),
        };
        let mut state = Self {
            home: home_word,
            options,
            paused: LinesPaused { taken, given, finishing: finishing != 0 },
            busy: busy as u32,
            crcs: [0; MOST_LINES],
        };
        let pairs = state.crcs.as_chunks_mut::<2>().0.iter_mut();
        pairs.zip(crcs).for_each(|(to, word)| *to = [low(*word), high(*word)]);
        if state.home != home as u64 {
            return Err(ELD_FAULT_CONTEXT_MOVED);
        }
        if state.busy != 0 {
            state.lose();
            state.write(block);
            return Err(ELD_FAULT_INTERRUPTED);
        }
        Ok(Open { state, repaired })
    }

    /// Begins a new grid.
    fn lose(&mut self) {
        (self.paused, self.busy) = (LinesPaused::default(), 0);
    }
}

/// An open state.
pub(crate) struct Open {
    pub(crate) state: State,
    repaired: bool,
}

impl Open {
    /// Takes a line, or, without one, returns the next of the remaining lines; writes its number to `row`.
    pub(crate) fn work(
        &mut self,
        block: &mut [u8],
        lines: &mut [f32],
        line: Option<(&[f32], &[f32])>,
        maps: &mut LineMaps<'_>,
        row: &mut u64,
    ) -> Outcome {
        let state = &mut self.state;
        let options = options(&state.options).map_err(|_| ELD_FAULT_CONTEXT_LOST)?;
        let cols = options.cols;
        let kept = lines.chunks_exact(cols).zip(&state.crcs);
        if state.paused.taken > 0 && kept.into_iter().any(|(line, crc)| floats_crc(line) != *crc) {
            state.lose();
            state.write(block);
            return Err(ELD_FAULT_LINES);
        }
        // What does not fit is refused before anything changes.
        state.busy = 1;
        state.write(block);
        state.busy = 0;
        let worked = TerrainLines::resume(options, lines, state.paused).and_then(|mut terrain| {
            let given = match line {
                Some((line_m, slope_sd)) => terrain.push_with(line_m, slope_sd, maps)?,
                None => terrain.finish(maps)?,
            };
            state.paused = terrain.pause();
            Ok(given)
        });
        state.crcs.iter_mut().zip(lines.chunks_exact(cols)).for_each(|(crc, line)| *crc = floats_crc(line));
        state.write(block);
        match worked {
            Ok(Some(given)) => {
                *row = given;
                Ok(if self.repaired { ELD_NOTICE_REPAIRED } else { ELD_OK })
            }
            Ok(None) => Ok(ELD_NOTICE_NO_LINE),
            Err(TerrainError::Unfinished { .. }) => Err(ELD_REFUSED_UNFINISHED),
            Err(TerrainError::Length(_)) => Err(ELD_REFUSED_BUFFER),
            // Options were validated.
            Err(_) => Err(ELD_FAULT_CONTEXT_LOST),
        }
    }
}
