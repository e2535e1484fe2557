//! The data of a context between two calls: plain numbers, so that any bit pattern is legal to read.

use elunar_core::nn::{Suspended, Telemetry, Verdict};

/// Number of eight-byte words of a record.
pub(crate) const WORDS: usize = 34;

/// No tile was begun.
pub(crate) const EMPTY: u32 = 0;
/// The arena contains a tile of the caller.
pub(crate) const TILE: u32 = 1;
/// The arena contains the tile of the self test.
pub(crate) const SELF_TEST: u32 = 2;

/// The data of a context.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Record {
    /// Address and length of the lent memory, bytes.
    pub(crate) home: u64,
    pub(crate) home_bytes: u64,
    /// Address of the model; the verdict has its length.
    pub(crate) model: u64,
    pub(crate) verdict: Verdict,
    /// The tile in the arena: [`EMPTY`], [`TILE`] or [`SELF_TEST`].
    pub(crate) tile: u32,
    /// 1 while a call changes the arena. A call finds 1 at its start only if the previous call did not return.
    pub(crate) busy: u32,
    /// The position of the runner.
    pub(crate) suspended: Suspended,
    /// The way back to metres: bits of the lowest height, the relief and NR; 1 for mirrored rows plus 2 for mirrored columns.
    pub(crate) scale_bits: [u32; 3],
    pub(crate) mirror: u32,
    /// Number of pixels with valid heights, and checksum of the validity bits.
    pub(crate) valid_px: u32,
    pub(crate) validity_crc: u32,
    /// Counters: see [`crate::types::eld_telemetry_t`].
    pub(crate) calls: u64,
    pub(crate) faults: u64,
    pub(crate) repairs: u64,
    /// Repairs that no status has reported yet.
    pub(crate) repairs_untold: u32,
    pub(crate) last_fault: u32,
    pub(crate) lights_assumed: u64,
    pub(crate) tiles_dropped: u64,
    /// Bits of [`elunar_core::photoclinometry::ExpectedErrors::to_values`].
    pub(crate) expected_bits: [u32; 6],
}

/// Returns a word of two numbers.
const fn pair(low: u32, high: u32) -> u64 {
    low as u64 | (high as u64) << 32
}

/// Returns the two numbers of [`pair`].
const fn halves(word: u64) -> [u32; 2] {
    [word as u32, (word >> 32) as u32]
}

impl Record {
    /// Returns the record as words, in a fixed order.
    pub(crate) fn words(&self) -> [u64; WORDS] {
        let (at, t) = (&self.suspended, &self.suspended.telemetry);
        let [min, relief, nr] = self.scale_bits;
        let [lit_m, lit_slope, explained, dark_m, dark_slope, dark_below] = self.expected_bits;
        [
            self.home,
            self.home_bytes,
            self.model,
            pair(self.verdict.header_crc, self.verdict.file_bytes),
            pair(self.verdict.scratch_offset, self.verdict.scratch_bytes),
            self.verdict.macs,
            pair(self.tile, self.busy),
            pair(at.phase, at.entry),
            pair(at.step, at.unit),
            pair(at.scrub_chunk, at.scrub_offset),
            pair(at.scrub_crc, self.mirror),
            pair(min, relief),
            pair(nr, self.valid_px),
            pair(self.validity_crc, self.repairs_untold),
            t.tiles,
            t.steps,
            t.macs,
            t.inputs_clamped,
            t.saturated,
            t.scrubbed_bytes,
            t.scrub_passes,
            t.scrub_faults,
            t.self_test_faults,
            self.calls,
            self.faults,
            self.repairs,
            self.lights_assumed,
            self.tiles_dropped,
            self.last_fault as u64,
            pair(self.verdict.sum_count, at.trusting),
            t.tile_faults,
            pair(lit_m, lit_slope),
            pair(explained, dark_m),
            pair(dark_slope, dark_below),
        ]
    }

    /// Returns the record of these words.
    pub(crate) fn of(words: &[u64; WORDS]) -> Self {
        let [
            home,
            home_bytes,
            model,
            identity,
            scratch,
            model_macs,
            tile,
            place,
            step,
            chunk,
            crc,
            range,
            nr,
            validity,
            rest @ ..,
        ] = *words;
        let [
            tiles,
            steps,
            macs,
            inputs_clamped,
            saturated,
            scrubbed_bytes,
            scrub_passes,
            scrub_faults,
            self_test_faults,
            rest @ ..,
        ] = rest;
        let [calls, faults, repairs, lights_assumed, tiles_dropped, last_fault, sums, tile_faults, a, b, c] = rest;
        let ([lit_m, lit_slope], [explained, dark_m], [dark_slope, dark_below]) = (halves(a), halves(b), halves(c));
        let ([header_crc, file_bytes], [scratch_offset, scratch_bytes]) = (halves(identity), halves(scratch));
        let ([tile, busy], [phase, entry], [step, unit]) = (halves(tile), halves(place), halves(step));
        let ([scrub_chunk, scrub_offset], [scrub_crc, mirror]) = (halves(chunk), halves(crc));
        let ([min, relief], [nr, valid_px], [validity_crc, repairs_untold]) =
            (halves(range), halves(nr), halves(validity));
        let telemetry = Telemetry {
            tiles,
            steps,
            macs,
            inputs_clamped,
            saturated,
            scrubbed_bytes,
            scrub_passes,
            scrub_faults,
            self_test_faults,
            tile_faults,
        };
        let [sum_count, trusting] = halves(sums);
        Self {
            home,
            home_bytes,
            model,
            verdict: Verdict { header_crc, file_bytes, scratch_offset, scratch_bytes, sum_count, macs: model_macs },
            tile,
            busy,
            suspended: Suspended {
                phase,
                trusting,
                entry,
                step,
                unit,
                scrub_chunk,
                scrub_offset,
                scrub_crc,
                telemetry,
            },
            scale_bits: [min, relief, nr],
            mirror,
            valid_px,
            validity_crc,
            calls,
            faults,
            repairs,
            repairs_untold,
            last_fault: last_fault as u32,
            lights_assumed,
            tiles_dropped,
            expected_bits: [lit_m, lit_slope, explained, dark_m, dark_slope, dark_below],
        }
    }

    /// Drops the tile and counts it; the other counters stay unchanged.
    pub(crate) fn lose_tile(&mut self) {
        self.tiles_dropped = self.tiles_dropped.wrapping_add(u64::from(self.tile != EMPTY));
        (self.tile, self.valid_px) = (EMPTY, 0);
        self.suspended = Suspended { phase: Suspended::IDLE, entry: 0, step: 0, unit: 0, ..self.suspended };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_come_back_as_they_were() {
        let words: [u64; WORDS] = core::array::from_fn(|i| 0x0101_0101_0101_0101 * (i as u64 + 1));
        let back = Record::of(&words).words();
        // The last fault is half a word.
        assert_eq!(back[..28], words[..28]);
        assert_eq!(back[28], words[28] & 0xffff_ffff);
        assert_eq!(back[29..], words[29..]);
        let all_ones = Record::of(&[u64::MAX; WORDS]);
        assert_eq!(Record::of(&all_ones.words()), all_ones);
    }
}
